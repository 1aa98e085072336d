"""Twins: a model identified from another simulator's input and output, so that it can be stepped."""

import warnings
from copy import copy
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np

from narx_sklearn._validation import as_signals, finite_rows, finite_slices, session_slices
from narx_sklearn.discrepancy.fitting.problem import Problem
from narx_sklearn.discrepancy.fitting.start import fit_initial_states
from narx_sklearn.discrepancy.noise import Noise
from narx_sklearn.discrepancy.simulators.simulator import Run, Simulator, Windows, transformed
from narx_sklearn.discrepancy.surrogates.motion import identify_motion
from narx_sklearn.discrepancy.surrogates.narx_simulator import NARXSimulator
from narx_sklearn.discrepancy.surrogates.stores import identify_stores
from narx_sklearn.discrepancy.surrogates.trace_fit import read_trace
from narx_sklearn.exceptions import NarxWarning
from narx_sklearn.identification import NARXRegressor
from narx_sklearn.metrics import nrmse
from narx_sklearn.model import free_run

TRAINING_SHARE = 0.7  # of each session, its first part; the rest is held out
GOOD_ENOUGH = 1e-3  # held-out error over the output's standard deviation at which the search ends
BLIND = 0.9  # above it the input tells next to nothing of the output
POOR = 0.05  # above it a warning says that the twin is not the simulator
FEWEST_SAMPLES = 40  # of a trace
REMEMBERED = 16  # corrections kept: one for each parameter that is moved, and the nominal one

EQUATIONS = (identify_motion, identify_stores)
# (lags, degree, delay), from simple to rich. A map of n states needs n lags; delay 0 comes last, for a
# simulator whose output follows its input at once.
CANDIDATES = (
    *((n, 1, 1) for n in (1, 2, 3, 4)),
    *((n, d, 1) for d in (2, 3) for n in (1, 2, 3)),
    *((n, d, 0) for d in (1, 2, 3) for n in (1, 2, 3)),
)


class Twin(NamedTuple):
    """A twin and how good it is."""

    simulator: Simulator
    error: float  # held-out free-run RMSE over the output's standard deviation, of the worst output


def identify_twin(u, y_sim, *, dt: float, sessions=None, regressor=None) -> Twin:
    """Identify a model that simulates like another simulator: a differential equation, else a NARX model.

    Parameters
    ----------
    u : array-like or DataFrame of shape (n_samples, n_inputs)
        Inputs of the simulator.
    y_sim : array-like or DataFrame of shape (n_samples, n_outputs)
        Its outputs; no measurement.
    dt : float
        Sampling period, s.
    sessions : array-like of shape (n_samples,), optional
        One label a sample.
    regressor : NARXRegressor, optional
        How to identify it; by default a linear differential equation of first or second order is tried, then
        stores that drain one into the next, then NARX models of growing richness, until one is good enough.

    Returns
    -------
    Twin
        The best model by its free run on the last part of each session, which the fit did not see; on the
        part before it must run too, where a polynomial that goes through all samples may turn over.

    Raises
    ------
    ValueError
        If the record is too short, or no candidate could be fitted.

    Warns
    -----
    NarxWarning
        If the held-out error exceeds 5 % of the output's standard deviation.
    """
    n_samples = as_signals(u, "u").shape[0]
    measured = as_signals(y_sim, "y_sim")
    if measured.shape[0] != n_samples:
        raise ValueError(f"y_sim has {measured.shape[0]} samples, u has {n_samples}; they must be aligned.")
    if n_samples < FEWEST_SAMPLES:
        raise ValueError(
            f"The trace has {n_samples} samples; at least {FEWEST_SAMPLES} are needed to identify a twin."
        )
    labels = _halves(session_slices(sessions, n_samples), n_samples)
    training = labels % 2 == 0
    equation = None if regressor is not None else _equation(u, y_sim, labels, dt)
    if equation is not None and equation.error < GOOD_ENOUGH:
        return equation
    regressors = [regressor] if regressor is not None else map(_regressor, *zip(*CANDIDATES, strict=True))
    best = refused = None
    for candidate in regressors:
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore", NarxWarning)
                candidate = candidate.fit(_rows(u, training), _rows(y_sim, training), labels[training])
                error = max(
                    _free_run_error(candidate.model_, u, measured, labels, chosen)
                    for chosen in (~training, training)
                )
        except ValueError as refusal:
            refused = refusal  # the part is shorter than these lags, or its regressors are all constant
            continue
        if not candidate.model_.n_terms:
            continue  # neither the input nor the past says anything of the output
        if np.isfinite(error) and (best is None or error < best[1]):
            best = candidate.model_, error
        if error < GOOD_ENOUGH:
            break
    if equation is not None and equation.error < (BLIND if best is None else best[1]):
        twin = equation
    elif best is not None:
        twin = Twin(NARXSimulator(best[0], dt), float(best[1]))
    else:
        raise ValueError(
            "No NARX model could be identified from the simulated output: is it noise, is the input "
            "constant, are the two swapped, or does y_sim belong to another record? Pass the output of a "
            "simulation and the inputs that led to it."
            f"{f' The last attempt said: {refused}' if refused else ''}"
        ) from refused
    if twin.error > POOR:
        swapped = (
            " The input tells next to nothing of it: are u and y_sim swapped, or of different records?"
            if twin.error > BLIND
            else ""
        )
        warnings.warn(
            f"The twin of the simulator misses held-out simulated output by {100 * twin.error:.1f} % of its "
            "standard deviation, so what is found at state equations is no surer than that. Pass a "
            "regressor with more lags, a higher degree or phi regressors, or the simulator's equations."
            f"{swapped}",
            NarxWarning,
            stacklevel=3,
        )
    return twin


def _equation(u, y_sim, labels: np.ndarray, dt: float) -> Twin | None:
    """Return the differential equation that runs most like a trace, the first that is good enough."""
    trace = read_trace(u, y_sim, labels, dt)
    if trace is None:
        return None
    best = None
    for identify in EQUATIONS:
        found = identify(trace, GOOD_ENOUGH)
        if found is not None and (best is None or found[1] < best.error):
            best = Twin(*found)
        if best is not None and best.error < GOOD_ENOUGH:
            break
    return best


def _regressor(lags: int, degree: int, delay: int) -> NARXRegressor:
    return NARXRegressor(lags, lags, degree=degree, delay=delay)


def _halves(pieces, n_samples: int) -> np.ndarray:
    """Return a label for each sample: even in the training part of its session, odd in the held-out part."""
    labels = np.empty(n_samples, dtype=np.int64)
    for i, piece in enumerate(pieces):
        split = piece.start + round(TRAINING_SHARE * (piece.stop - piece.start))
        labels[piece.start : split] = 2 * i
        labels[split : piece.stop] = 2 * i + 1
    return labels


def _rows(data, chosen: np.ndarray):
    """Return rows as a 2-D array, of a DataFrame or Series as such, for its labels name the signals."""
    return data[chosen] if hasattr(data, "iloc") else as_signals(data, "data")[chosen]


def _free_run_error(model, u, y_sim, labels, chosen) -> float:
    """Return the free-run error over the standard deviation of the worst output; inf where it diverged."""
    inputs = as_signals(u, "u")[chosen]
    y = y_sim[chosen]
    run = free_run(model, inputs, y, sessions=labels[chosen]).y
    compared = np.isfinite(run).all(axis=1) & np.isfinite(y).all(axis=1)
    if compared.sum() < 0.5 * chosen.sum() or np.isfinite(y[~compared]).all(axis=1).any():
        return np.inf
    return float(np.max(nrmse(y[compared], run[compared], multioutput="raw_values")))


class TwinSimulator(Simulator):
    """Base of simulators that cannot be stepped: a twin carries states, their ports and windows.

    What the twin gets wrong of the simulator's own output is added to every run, so that without effects,
    and from where the simulator starts, a run is the simulator's own.
    """

    twin_: Any = None
    twin_error_: float = np.nan
    _corrected = True

    def _simulated(self, u: np.ndarray, p: np.ndarray, pieces) -> Any:
        """Return the simulator's own output for inputs, None where unknown."""
        raise NotImplementedError

    def _with_twin(self, twin: Twin) -> None:
        self.twin_, self.twin_error_ = twin
        self.states = self.twin_.states
        self.discrete, self.substeps = self.twin_.discrete, self.twin_.substeps
        self.linear_hold = self.twin_.linear_hold
        self._corrections: dict[tuple, np.ndarray] = {}

    @property
    def free_states(self):
        """Which initial states are unknown: the twin's."""
        return self.twin_.free_states if self.twin_ else np.zeros(0, dtype=bool)

    def known_states(self, u, y, samples, began=None):
        """Return the twin's states at the given samples, from what was measured before them."""
        return self._stepped().known_states(u, y, samples, began)

    def _stepped(self):
        if self.twin_ is None:
            raise ValueError(
                f"{type(self).__name__} has no twin yet, without which it cannot be run from any state; "
                "call identified(u) with the inputs of the record first."
            )
        return self.twin_

    def _present_twin(self, p: np.ndarray) -> Simulator:
        return self._stepped().with_parameters(self._coefficients(p))

    def _equations(self):
        return self._stepped()._equations()

    def by_equations(self):
        """Return the simulator without what its twin gets wrong."""
        new = copy(self)
        new._corrected = False
        return new

    def _initial_states(self, u, windows):
        if self.twin_ is None:
            return np.zeros((windows.count, 0))
        pieces = [slice(a, b) for a, b in zip(windows.first, windows.last, strict=True)]
        own = self._simulated(u, self.nominal, pieces)
        if own is None:
            return self.twin_._initial_states(u, windows)
        return starting_states(self._present_twin(self.nominal), u, own, windows)

    def run(self, u, windows, x0, p=None, effects=None, strength=None) -> Run:
        """Run the windows, as every simulator does; the twin's error on the whole record is added back."""
        p = self.nominal if p is None else np.ascontiguousarray(p, dtype=float)
        effects = self.effects if effects is None else tuple(effects)
        strength = np.ones(len(effects)) if strength is None else np.asarray(strength, dtype=float)
        pairs = list(zip(effects, strength, strict=True))
        within = [pair for pair in pairs if pair[0].port.kind != "output"]
        pieces = finite_slices(_sessions(windows, u.shape[0]), finite_rows(u))
        driven = transformed(u, "input", effects, strength, None, self.dt, Windows.whole(pieces))
        if self.twin_ is None:
            if any(effect.port.kind == "state" for effect in effects):
                self._stepped()
            y = self._simulated(driven, p, pieces)
            run = Run(y, np.empty((u.shape[0], 0)), np.empty((u.shape[0], 0)), -1)
        else:
            run = super().run(u, windows, x0, p, *_separated(within))
            if self._corrected:
                run = run._replace(y=run.y + self._correction(u, driven, p, pieces))
        return run._replace(
            y=transformed(run.y, "output", effects, strength, driven, self.dt, windows, run.x)
        )

    def missed(self, u, windows: Windows) -> np.ndarray:
        """Return what the twin gets wrong of the simulator's own output, (n_samples, n_outputs)."""
        pieces = finite_slices(_sessions(windows, u.shape[0]), finite_rows(u))
        return self._missed(u, self.nominal, pieces) + np.zeros((u.shape[0], len(self.outputs)))

    def _correction(self, u, driven, p, pieces):
        """Return what is added to a run of the twin, (n_samples, n_outputs), or 0."""
        return self._missed(driven, p, pieces)

    def _missed(self, driven, p, pieces):
        """Return the simulator's own output minus the twin's, both from where the simulator starts."""
        key = (driven.shape, hash(driven.tobytes()), p.tobytes(), tuple((a.start, a.stop) for a in pieces))
        if key not in self._corrections:
            own = self._simulated(driven, p, pieces)
            if own is None:
                return 0.0
            windows = Windows.whole(pieces)
            twin = self._present_twin(p)
            x0 = starting_states(twin, driven, own, windows)
            run = twin.run(driven, windows, x0).y
            while len(self._corrections) >= REMEMBERED:
                self._corrections.pop(next(iter(self._corrections)), None)
            self._corrections[key] = np.nan_to_num(own - run)
        return self._corrections[key]

    def __getstate__(self):
        return self.__dict__ | ({"_corrections": {}} if self.twin_ else {})


def starting_states(twin: Simulator, u: np.ndarray, own: np.ndarray, windows: Windows) -> np.ndarray:
    """Return a twin's states where its simulator starts; those its signals do not show are fitted."""
    known = twin.known_states(u, np.nan_to_num(own), windows.first, windows.first)
    if np.isfinite(known).all():
        return known
    return fit_initial_states(as_record(twin, u, own, windows), np.nan_to_num(known)).model.x0


def as_record(twin: Simulator, u: np.ndarray, own: np.ndarray, windows: Windows) -> Problem:
    """Return the problem of fitting a twin to a simulator's own output."""
    return Problem(twin, u, own, windows, Noise.as_large_as(own))


def _separated(pairs):
    return tuple(effect for effect, _ in pairs), np.array([scale for _, scale in pairs], dtype=float)


def _sessions(windows: Windows, n_samples: int) -> list[slice]:
    """Return the sessions of a record: from where one began to where the next one does."""
    edges = [*np.unique(windows.began).tolist(), n_samples]
    return [slice(a, b) for a, b in pairwise(edges)]
