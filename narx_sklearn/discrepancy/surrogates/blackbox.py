"""A simulator that answers to inputs and parameters, and shows nothing else."""

from collections.abc import Callable, Mapping, Sequence
from copy import copy
from typing import Any, NamedTuple

import numpy as np

from narx_sklearn._validation import as_signals, finite_rows, finite_slices, session_slices
from narx_sklearn.discrepancy.fitting.problem import Model
from narx_sklearn.discrepancy.fitting.refit import fit
from narx_sklearn.discrepancy.simulators.ode import (
    check_distinct,
    check_period,
    describe,
    read_parameter,
    read_signals,
)
from narx_sklearn.discrepancy.simulators.simulator import Windows
from narx_sklearn.discrepancy.surrogates.twin import (
    GOOD_ENOUGH,
    TwinSimulator,
    as_record,
    identify_twin,
    starting_states,
)

NEAR = 3e-3  # relative distance from a centre within which no other is needed
STEP = 0.02  # relative, of difference quotients over program runs: above what a solver's tolerance leaves
KEPT = 8  # slopes remembered: of the last centres
EXACT = 1e-8  # relative change of the cost at which a twin's fit to the program ends


class Centre(NamedTuple):
    """Parameters of a program about which its twin follows it, and how."""

    p: np.ndarray  # (n_parameters,)
    low: np.ndarray  # (n_parameters,) ends of the difference quotients
    high: np.ndarray
    coefficients: np.ndarray  # (n_coefficients,) of the twin
    slope: np.ndarray  # (n_coefficients, n_parameters)


class CallableSimulator(TwinSimulator):
    """Wrap any program that turns inputs and parameters into outputs.

    Effects at inputs and outputs act on what goes into the program and comes out of it. States are not seen,
    so for effects at state equations, and for runs from other initial states than the program's own, a
    twin is identified from its answer to the record's inputs (`identified`); what the twin gets wrong of that
    answer is added back. How the twin follows the program's parameters is found by difference quotients, two
    calls a parameter, and found anew where a fit moves them by more: so a diagnosis costs hundreds of calls,
    not one for each of its runs. A run with the simulator's own parameters is always the program's own.

    Parameters
    ----------
    simulate : callable
        ``simulate(u, parameters) -> y``: inputs, an array of shape (n_samples, n_inputs), and a dict from
        parameter names to values; outputs of shape (n_samples,) or (n_samples, n_outputs).
    dt : float
        Sampling period, s.
    parameters : mapping of {str: float} or {str: (float, float, float)}
        Nominal values by name, with the unit in brackets; three numbers are value, lower and upper bound.
    inputs, outputs : sequence of str or mapping of {str: str}
        Names with units in brackets, or units by name.
    regressor : NARXRegressor, default=None
        How to identify the twin; None tries a linear differential equation of first or second order, then
        one or two stores that drain by a power of their level, then NARX models of growing richness.

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
        inputs: Sequence[str] | Mapping[str, str],
        outputs: Sequence[str] | Mapping[str, str],
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
        self._record: tuple[np.ndarray, list[slice]] = (np.zeros((0, len(self.inputs))), [])
        self._centres: tuple[Centre, ...] = ()
        self._slopes: dict[tuple, np.ndarray] = {}

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
        answer = self._simulated(u, self.nominal, pieces)
        new = copy(self)
        new._with_twin(identify_twin(u, answer, dt=self.dt, sessions=sessions, regressor=self.regressor))
        new._record = u, pieces
        new._centres = ()
        return new._with_centre(self.nominal, new.twin_.nominal)

    def centred(self, p):
        """Return the simulator with a twin that follows the program about these parameters, too."""
        nearest = self._nearest(p)
        if np.all(np.abs(p - nearest.p) <= NEAR * self._size(p)):
            return self
        return self._with_centre(p, self._coefficients(p))

    def _with_centre(self, p: np.ndarray, guess: np.ndarray) -> "CallableSimulator":
        """Return a copy in which the twin follows the program about ``p``, where it is about as guessed."""
        bounds, step = self.bounds, STEP * self._size(p)
        low, high = np.maximum(p - step, bounds[:, 0]), np.minimum(p + step, bounds[:, 1])
        here = self._followed(p, guess)
        slope = np.zeros((here.size, p.size))
        for i in np.flatnonzero(high > low):
            ahead, behind = (np.where(np.arange(p.size) == i, end, p) for end in (high, low))
            slope[:, i] = (self._followed(ahead, here) - self._followed(behind, here)) / (high - low)[i]
        new = copy(self)
        new._centres = (*self._centres, Centre(p.copy(), low, high, here, slope))
        new._corrections, new._slopes = {}, {}  # they go with the twin's coefficients
        return new

    def _followed(self, p: np.ndarray, guess: np.ndarray) -> np.ndarray:
        """Return the coefficients with which the twin runs like the program does with parameters ``p``."""
        u, pieces = self._record
        own, windows = self._simulated(u, p, pieces), Windows.whole(pieces)
        twin = self._stepped().with_parameters(guess)
        start = Model(guess, (), starting_states(twin, u, own, windows))
        found = fit(as_record(twin, u, own, windows), start, tolerance=EXACT)
        return found.model.p if np.isfinite(found.cost) else guess

    def _nearest(self, p: np.ndarray) -> Centre:
        away = [np.linalg.norm((p - centre.p) / self._size(centre.p)) for centre in self._centres]
        return self._centres[int(np.argmin(away))]

    @staticmethod
    def _size(p: np.ndarray) -> np.ndarray:
        return np.where(p != 0, np.abs(p), 1.0)

    def _coefficients(self, p):
        centre = self._nearest(p)
        return centre.coefficients + centre.slope @ (p - centre.p)

    def _correction(self, u, driven, p, pieces):
        if np.array_equal(p, self.nominal):
            return self._missed(driven, p, pieces)
        # A fit makes thousands of runs: about other parameters the program is asked at their centre alone,
        # and about other inputs only where the twin does not know.
        centre = self._nearest(p)
        there = self._missed(driven if self.twin_error_ > GOOD_ENOUGH else u, centre.p, pieces)
        return there + self._slope_of_missed(u, centre, pieces) @ (p - centre.p)

    def _slope_of_missed(self, u, centre: Centre, pieces) -> np.ndarray:
        """Return how the parameters change what is missed, (n_samples, n_outputs, n_parameters)."""
        key = (u.shape, hash(u.tobytes()), centre.p.tobytes(), tuple((a.start, a.stop) for a in pieces))
        if key not in self._slopes:
            slope = np.zeros((u.shape[0], len(self.outputs), centre.p.size))
            for i in np.flatnonzero(centre.high > centre.low):
                moved = np.arange(centre.p.size) == i
                ends = (np.where(moved, end, centre.p) for end in (centre.high, centre.low))
                ahead, behind = (self._missed(u, end, pieces) for end in ends)
                slope[:, :, i] = (ahead - behind) / (centre.high - centre.low)[i]
            while len(self._slopes) >= KEPT:
                self._slopes.pop(next(iter(self._slopes)), None)
            self._slopes[key] = slope
        return self._slopes[key]

    def _simulated(self, u, p, pieces):
        parameters = {known.name: float(value) for known, value in zip(self.parameters, p, strict=True)}
        y = np.full((u.shape[0], len(self.outputs)), np.nan)
        for piece in pieces:
            y[piece] = self._answer(u[piece].copy(), parameters)
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
        if np.ndim(answer) == 0:
            raise ValueError(
                f"simulate(u, parameters) returned {answer!r}; wanted are outputs of shape "
                f"({u.shape[0]},) or ({u.shape[0]}, {len(self.outputs)}). Let it end in return y."
            )
        y = as_signals(answer, "the result of simulate")
        wanted = (u.shape[0], len(self.outputs))
        if y.shape != wanted:
            raise ValueError(
                f"simulate(u, parameters) returned shape {np.shape(answer)}; wanted is {wanted}: one row a "
                f"sample, one column for each of {[str(s) for s in self.outputs]}."
            )
        return y

    def __getstate__(self):
        return super().__getstate__() | {"_slopes": {}}

    def __repr__(self) -> str:
        called = getattr(self.program, "__name__", type(self.program).__name__)
        return describe(self, f"{type(self).__name__} of {called}, dt={self.dt:g} s")
