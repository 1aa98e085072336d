"""A simulator of which only the output is known."""

import numpy as np

from narx_sklearn._validation import as_signals
from narx_sklearn.discrepancy.simulators.ode import check_period, describe
from narx_sklearn.discrepancy.surrogates.twin import TwinSimulator, identify_twin


class TraceSimulator(TwinSimulator):
    """Stand in for a simulator of which only a simulated output is known.

    A model, the twin, is identified from the input and the simulated output: a differential equation where
    one runs like the trace, else a NARX model. It takes effects, initial states and parameter changes; on the
    record itself its error is added back, so that a run there is the trace. How well it stands in is
    ``twin_error_``.

    Parameters
    ----------
    y_sim : array-like, Series or DataFrame of shape (n_samples,) or (n_samples, n_outputs)
        Simulated outputs, aligned with the record. Columns named like ``"position [m]"``
        give names and units.
    u : array-like or DataFrame of shape (n_samples, n_inputs), default=None
        Inputs that led to them. None: they are given later, to `identified`, or come with the record that
        `DiscrepancyRegressor` is fitted to.
    dt : float
        Sampling period, s.
    sessions : array-like of shape (n_samples,), default=None
        One label a sample; where it changes another recording begins.
    regressor : NARXRegressor, default=None
        How to identify the twin; None tries a linear differential equation of first or second order, then
        one or two stores that drain by a power of their level, then NARX models of growing richness.

    Attributes
    ----------
    twin_ : Simulator
        The identified model.
    twin_error_ : float
        Its free-run RMSE on held-out simulated output, over the output's standard deviation; of the worst
        output.

    Raises
    ------
    ValueError
        If ``y_sim`` and ``u`` are not aligned or too short, or no twin can be identified.

    Warns
    -----
    NarxWarning
        If the twin misses more than 5 % of the simulated output.

    Examples
    --------
    >>> import numpy as np
    >>> from narx_sklearn.discrepancy import TraceSimulator
    >>> u = np.random.default_rng(0).uniform(-1, 1, 400)
    >>> y_sim = np.zeros(400)
    >>> for k in range(1, 400):
    ...     y_sim[k] = 0.9 * y_sim[k - 1] + 0.1 * u[k - 1]
    >>> sim = TraceSimulator(y_sim, u, dt=0.01)
    >>> sim.twin_error_ < 1e-9
    True
    >>> float(abs(sim.simulate(u)[:, 0] - y_sim).max().round(12))
    0.0
    """

    def __init__(self, y_sim, u=None, *, dt: float, sessions=None, regressor=None):
        self.dt = check_period(dt)
        self.y_sim = y_sim
        self.sessions = sessions
        self.regressor = regressor
        self.states = self.inputs = self.outputs = self.parameters = ()
        if u is not None:
            self._identify(u, sessions)

    def identified(self, u, *, sessions=None) -> "TraceSimulator":
        """Return the simulator with its twin, identified from these inputs unless it has one.

        Parameters
        ----------
        u : array-like or DataFrame of shape (n_samples, n_inputs)
            Inputs that led to ``y_sim``.
        sessions : array-like of shape (n_samples,), default=None
            One label a sample.

        Returns
        -------
        TraceSimulator
        """
        if self.twin_ is not None:
            return self
        return TraceSimulator(self.y_sim, u, dt=self.dt, sessions=sessions, regressor=self.regressor)

    def _identify(self, u, sessions) -> None:
        twin = identify_twin(u, self.y_sim, dt=self.dt, sessions=sessions, regressor=self.regressor)
        self._with_twin(twin)
        self._u = as_signals(u, "u")
        self.inputs, self.outputs = twin.simulator.inputs, twin.simulator.outputs
        self.parameters = twin.simulator.parameters

    def _correction(self, u, driven, p, pieces):
        # the trace is of the twin as identified and of one input; the twin's error stays what it was there
        return self._missed(u, self._stepped().nominal, pieces)

    def _simulated(self, u, p, pieces):
        if self.twin_ is None:
            self._stepped()
        same = u.shape == self._u.shape and np.array_equal(u, self._u, equal_nan=True)
        return as_signals(self.y_sim, "y_sim") if same else None

    def __repr__(self) -> str:
        if self.twin_ is None:
            return f"TraceSimulator without inputs yet, dt={self.dt:g} s"
        return describe(self, f"TraceSimulator, twin error {100 * self.twin_error_:.3g} %, dt={self.dt:g} s")
