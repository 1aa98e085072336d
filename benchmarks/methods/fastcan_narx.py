"""fastcan: forward selection by h-correlation or eta-cosine, beam search, refinement, free-run fit.

What it can and cannot do (0.6): the current input is among its candidates by default; it centres the
regressors, so every model has an intercept; it has no criterion for the number of terms (BIC is added here);
`make_narx` has one longest lag for inputs and outputs alike, so its own building blocks are put together
here; `y_init` is read from its beginning.
"""

import contextlib
from collections.abc import Iterator, Sequence
from math import comb

import numpy as np
from fastcan import FastCan, refine
from fastcan.narx import NARX, make_narx, make_poly_features, make_poly_ids, make_time_shift_features, tp2fd
from harness.candidates import LibrarySpec
from harness.polynomial import Term, bic, term_text
from harness.search import Config, StandardisedModel, search_by_free_run

SIMULATION_FIT_SAMPLES = 6000  # its free-run fit takes tens of microseconds a sample, parameter and step


class FastcanModel:
    """A fitted fastcan NARX; the intercept counts as a term."""

    def __init__(self, model: NARX):
        self.model = model
        rows = zip(model.feat_ids_, model.delay_ids_, strict=True)
        self.terms = ("1", *(_text(features, delays) for features, delays in rows))

    def predict(self, X: np.ndarray, y_init: np.ndarray) -> np.ndarray:
        """Simulate from the end of the initial outputs."""
        head = max(0, len(y_init) - int(self.model.max_delay_))
        run = self.model.predict(X[head:].reshape(-1, 1), y_init=y_init[head:].reshape(-1, 1)).ravel()
        return np.r_[y_init[:head], run]


def _text(features: np.ndarray, delays: np.ndarray) -> str:
    pairs = zip(features, delays, strict=True)
    return term_text(tuple(sorted(("u" if f == 0 else "y", int(d)) for f, d in pairs if f >= 0)))


class _Candidates:
    """The lagged library of one record, as fastcan's own functions build it."""

    def __init__(self, u: np.ndarray, y: np.ndarray, config: Config | LibrarySpec):
        shifts = [[0, lag] for lag in config.input_lags] + [[1, lag] for lag in config.output_lags]
        self.u, self.y = u, y
        self.shift_ids = np.array(shifts)
        self.poly_ids = make_poly_ids(len(shifts), config.degree)
        start = self.shift_ids[:, 1].max()
        lagged = make_time_shift_features(np.c_[u, y], self.shift_ids)[start:]
        self.Psi = make_poly_features(lagged, self.poly_ids)
        self.target = y[start:]

    def select(self, size: int, drop: int | None = None, **arguments) -> np.ndarray:
        """Return the chosen columns in order; fewer when no independent candidate is left."""
        size = min(size, self.Psi.shape[1])
        selector = FastCan(size, verbose=0, **arguments)
        try:
            selector.fit(self.Psi, self.target)
        except (RuntimeError, ValueError):  # its way to say that the rest is linearly dependent
            return self.select(size - 1, drop, **arguments) if size > 1 else np.array([0])
        if drop is None or size < 3:
            return selector.indices_
        return refine(selector, drop=drop, verbose=0)[0]

    def fit(self, columns: np.ndarray, *, simulation: bool = False) -> FastcanModel:
        used, poly_ids = np.unique(self.poly_ids[columns], return_inverse=True)
        kept = used[used >= 0]
        poly_ids = poly_ids.reshape(len(columns), -1) - int(used[0] < 0)
        feat_ids, delay_ids = tp2fd(self.shift_ids[kept], poly_ids)
        model = NARX(feat_ids=feat_ids, delay_ids=delay_ids)
        model.fit(self.u.reshape(-1, 1), self.y)
        if simulation:
            stop = SIMULATION_FIT_SAMPLES
            start = np.r_[model.coef_, model.intercept_]
            with contextlib.suppress(ValueError):  # a run that leaves the finite range: keep least squares
                model.fit(self.u[:stop].reshape(-1, 1), self.y[:stop], coef_init=start, max_nfev=15)
        return FastcanModel(model)

    def residual(self, columns: np.ndarray) -> np.ndarray:
        A = np.c_[np.ones(len(self.target)), self.Psi[:, columns]]
        return self.target - A @ np.linalg.lstsq(A, self.target, rcond=None)[0]


def _fit_sizes(u: np.ndarray, y: np.ndarray, config: Config, sizes: Sequence[int]) -> Iterator[FastcanModel]:
    """Select once at the largest size: its prefixes are the smaller runs. Refinement runs once a size."""
    candidates = _Candidates(u, y, config)
    options = dict(config.options)
    simulation, drop = options.pop("simulation", False), options.get("drop")
    if drop is None:
        order = candidates.select(max(sizes) - 1, **options)
        choices = [order[: size - 1] for size in sizes if 1 < size <= len(order) + 1]
    else:
        choices = [candidates.select(size - 1, **options) for size in sizes if size > 1]
    for columns in choices:
        yield candidates.fit(columns, simulation=simulation)


def _search(X: np.ndarray, y: np.ndarray, spec) -> StandardisedModel:
    options = [{}, {"tol": 1e-6}, {"tol": 1e-6, "eta": True, "drop": 1}, {"tol": 1e-6, "simulation": True}]
    return search_by_free_run(_fit_sizes, options, X, y, spec)


def _recover(*, told_size: bool = False, simulation: bool = False, nested: bool = True, **arguments):
    """Choose the size by BIC over one selection run, or be told it.

    Where the runs of different sizes are not nested (beam, refinement), each size is a run of its own, and
    the search is helped: only sizes up to three away from the true one are tried.
    """

    def fit(X: np.ndarray, y: np.ndarray, spec: LibrarySpec) -> FastcanModel:
        candidates = _Candidates(X, y, spec)
        size = sum(term != () for term in spec.true_terms)
        if told_size:
            return candidates.fit(candidates.select(size, **arguments), simulation=simulation)
        if nested:
            order = candidates.select(spec.max_terms, **arguments)
            choices = [order[:size] for size in range(1, len(order) + 1)]
        else:
            choices = [candidates.select(size + more, **arguments) for more in range(-3, 4)]
        best = min(choices, key=lambda c: bic(candidates.residual(c), len(c) + 1, y))
        return candidates.fit(best, simulation=simulation)

    return fit


def _select(**arguments):
    def select(u: np.ndarray, y: np.ndarray, n_lags: int, degree: int, n_terms: int) -> list[str]:
        model = make_narx(
            u.reshape(-1, 1),
            y,
            n_terms_to_select=n_terms,
            max_delay=n_lags,
            poly_degree=degree,
            include_zero_delay=[False],
            **arguments,
        )
        return [_text(f, d) for f, d in zip(model.feat_ids, model.delay_ids, strict=True)]

    return select


def _make_simulator(terms: Sequence[Term], theta: np.ndarray):
    degree = max(len(term) for term in terms)
    padded = [[(-1, -1)] * (degree - len(t)) + [(int(s == "y"), lag) for s, lag in t] for t in terms]
    ids = np.array(padded)
    model = NARX(feat_ids=ids[:, :, 0], delay_ids=ids[:, :, 1], fit_intercept=False)
    n_samples = comb(degree + 6, 3)
    rng = np.random.default_rng(0)
    model.fit(rng.normal(size=(n_samples, 1)), rng.normal(size=n_samples))
    model.coef_ = np.asarray(theta, dtype=float)
    return FastcanModel(model).predict


SEARCHES = {"fastcan": _search}
RECOVERERS = {
    "fastcan: h, bic": _recover(),
    "fastcan: eta, bic": _recover(eta=True),
    "fastcan: eta, told size": _recover(eta=True, told_size=True),
    "fastcan: eta, told size, free-run fit": _recover(eta=True, told_size=True, simulation=True),
    "fastcan: beam 5, bic": _recover(eta=True, beam_width=5, nested=False),
    "fastcan: refine 1, bic": _recover(eta=True, drop=1, nested=False),
    "fastcan: refine all, told size": _recover(eta=True, drop="all", told_size=True),
}
SELECTORS = {
    "fastcan: h": _select(verbose=0),
    "fastcan: eta": _select(verbose=0, eta=True),
    "fastcan: lazy": _select(lazy=True),
}
SIMULATORS = {"fastcan": _make_simulator}
