"""A simulator that answers to inputs and parameters, and shows nothing else."""

from collections.abc import Callable, Mapping, Sequence
from copy import copy
from typing import Any

import numpy as np

from narx_sklearn._validation import as_signals, finite_rows, finite_slices, session_slices
from narx_sklearn.discrepancy.ode import check_distinct, check_period, describe, read_parameter, read_signals
from narx_sklearn.discrepancy.twin import TwinSimulator, identify_twin


class CallableSimulator(TwinSimulator):
    """Wrap any program that turns inputs and parameters into outputs.

    Effects at inputs and outputs act on what goes into the program and comes out of it. States are not seen,
    so for effects at state equations, and for runs from other initial states than the program's own, a
    twin is identified from its answer to the record's inputs (`identified`); what the twin gets wrong of that
    answer is added back.

    Parameters
    ----------
    simulate : callable
        ``simulate(u, parameters) -> y``: inputs, an array of shape (n_samples, n_inputs), and a dict from
        parameter names to values; outputs of shape (n_samples,) or (n_samples, n_outputs).
    dt : float
        Sampling period, s.
    parameters : mapping of {str: float} or {str: (float, float, float)}
        Nominal values by name, with the unit in brackets; three numbers are value, lower and upper bound.
    inputs, outputs : sequence of str
        Names with units in brackets.
    regressor : NARXRegressor, default=None
        How to identify the twin; None tries a linear differential equation of first or second order, then
        NARX models of growing richness.

    Attributes
    ----------
    twin_ : Simulator or None
        The twin, once `identified`.
    twin_error_ : float
        Its held-out free-run RMSE over the standard deviation of the simulated output; NaN before.

    Raises
    ------
    TypeError
        If an argument is of the wrong kind.
    ValueError
        If a value does not fit.

    Examples
    --------
    >>> import numpy as np
    >>> from scipy.signal import lfilter
    >>> from narx_sklearn.discrepancy import CallableSimulator
    >>> def program(u, parameters):
    ...     a = parameters["pole"]
    ...     return lfilter([0, parameters["gain"] * (1 - a)], [1, -a], u[:, 0])
    >>> sim = CallableSimulator(program, 0.1, {"gain [m/V]": 2.0, "pole": 0.8}, ["drive [V]"], ["level [m]"])
    >>> float(sim.simulate(np.ones(100))[-1, 0].round(6))
    2.0
    >>> sim.identified(np.random.default_rng(0).uniform(-1, 1, 300)).twin_error_ < 1e-6
    True
    """

    def __init__(
        self,
        simulate: Callable,
        dt: float,
        parameters: Mapping[str, Any],
        inputs: Sequence[str],
        outputs: Sequence[str],
        *,
        regressor=None,
    ):
        if not callable(simulate):
            raise TypeError(f"simulate must be callable as simulate(u, parameters), got {simulate!r}.")
        if not isinstance(parameters, Mapping):
            raise TypeError(f"parameters must map names to values, got {type(parameters).__name__}.")
        self.program = simulate
        self.dt = check_period(dt)
        self.parameters = tuple(read_parameter(name, given) for name, given in parameters.items())
        check_distinct([p.name for p in self.parameters], "parameters")
        self.inputs = read_signals(inputs, "inputs")
        self.outputs = read_signals(outputs, "outputs")
        self.states = ()
        self.regressor = regressor

    def identified(self, u, *, sessions=None) -> "CallableSimulator":
        """Return the simulator with a twin, identified from its answer to these inputs.

        Parameters
        ----------
        u : array-like or DataFrame of shape (n_samples, n_inputs)
            Inputs of the record.
        sessions : array-like of shape (n_samples,), default=None
            One label a sample.

        Returns
        -------
        CallableSimulator
        """
        u = self._read_inputs(u)
        pieces = finite_slices(session_slices(sessions, u.shape[0]), finite_rows(u))
        answer = self._simulated(u, u, self.nominal, pieces)
        new = copy(self)
        new._with_twin(identify_twin(u, answer, dt=self.dt, sessions=sessions, regressor=self.regressor))
        return new

    def _simulated(self, u, driven, p, pieces):
        parameters = {known.name: float(value) for known, value in zip(self.parameters, p, strict=True)}
        y = np.full((driven.shape[0], len(self.outputs)), np.nan)
        for piece in pieces:
            y[piece] = self._answer(driven[piece].copy(), parameters)
        return y

    def _answer(self, u: np.ndarray, parameters: dict[str, float]) -> np.ndarray:
        """Call the program for one recording and check what it returns."""
        try:
            answer = self.program(u, parameters)
        except Exception as error:
            raise RuntimeError(
                f"simulate(u, parameters) raised {type(error).__name__}: {error}, called with u of shape "
                f"{u.shape} and {parameters}."
            ) from error
        y = as_signals(answer, "the result of simulate")
        wanted = (u.shape[0], len(self.outputs))
        if y.shape != wanted:
            raise ValueError(
                f"simulate(u, parameters) returned shape {np.shape(answer)}; wanted is {wanted}: one row a "
                f"sample, one column for each of {[str(s) for s in self.outputs]}."
            )
        return y

    def __repr__(self) -> str:
        called = getattr(self.program, "__name__", type(self.program).__name__)
        return describe(self, f"{type(self).__name__} of {called}, dt={self.dt:g} s")
