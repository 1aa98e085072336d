"""SysIdentPy: FROLS with information criteria, extended least squares, and its floating search.

What it can and cannot do (0.9): input lags start at 1, so the current input is offered to it by handing over
the input one sample early; one recording, no gaps; the criterion stops at its first rise; the whole selection
is run again for every size the criterion looks at.
"""

import copy
import warnings
from collections.abc import Iterator, Sequence

import numpy as np
from harness.candidates import LibrarySpec
from harness.polynomial import Term, term_text
from harness.search import Config, StandardisedModel, search_by_free_run
from sysidentpy.basis_function import Polynomial
from sysidentpy.model_structure_selection import FROLS, OSF
from sysidentpy.parameter_estimation import LeastSquares
from sysidentpy.utils.information_matrix import build_lagged_matrix

warnings.filterwarnings("ignore", module="sysidentpy")


class SysIdentPyModel:
    """A fitted SysIdentPy model; `advance` is how many samples early its input comes."""

    def __init__(self, model, advance: int = 0):
        self.model = model
        self.advance = advance
        self.terms = tuple(_text(code, advance) for code in model.final_model)

    def predict(self, X: np.ndarray, y_init: np.ndarray) -> np.ndarray:
        """Simulate; only the first `max_lag` of the initial outputs are used by the library."""
        lag = self.model.max_lag
        head = len(y_init) - lag  # start the run at the end of the initial outputs
        u = _advanced(X, self.advance)[head:].reshape(-1, 1)
        # Its fast path is taken when more than max_lag outputs are handed over; the others are not read.
        y = np.r_[y_init[head:], 0.0].reshape(-1, 1)
        run = self.model.predict(X=u, y=y).ravel()
        return np.r_[y_init[:head], run]


def _advanced(u: np.ndarray, advance: int) -> np.ndarray:
    return np.r_[u[advance:], np.repeat(u[-1], advance)]


def _text(code: np.ndarray, advance: int) -> str:
    factors = [("y", c - 1000) if c < 2000 else ("u", c - 2000 - advance) for c in map(int, code) if c]
    return term_text(tuple(sorted(factors)))


def _build(cls, config: Config | LibrarySpec, **arguments):
    advance = int(0 in config.input_lags)
    model = cls(
        ylag=list(config.output_lags),
        xlag=[lag + advance for lag in config.input_lags],
        basis_function=Polynomial(degree=config.degree),
        estimator=LeastSquares(),
        **arguments,
    )
    return model, advance


def _columns(u: np.ndarray, y: np.ndarray, advance: int) -> dict[str, np.ndarray]:
    stop = len(u) - advance
    return {"X": _advanced(u, advance)[:stop].reshape(-1, 1), "y": y[:stop].reshape(-1, 1)}


def _fit_sizes(
    u: np.ndarray, y: np.ndarray, config: Config, sizes: Sequence[int]
) -> Iterator[SysIdentPyModel]:
    """Run FROLS once at the largest size; its prefixes are what runs with fewer terms would give."""
    full, advance = _build(FROLS, config, order_selection=False, n_terms=max(sizes))
    data = _columns(u, y, advance)
    full.fit(**data)
    lagged = build_lagged_matrix(data["X"], data["y"], full.xlag, full.ylag, full.model_type)
    for size in sizes:
        model = copy.copy(full)
        model.n_terms, model.pivv = size, full.pivv[:size]
        model.final_model = full.final_model[:size]
        psi = model.basis_function.transform(
            lagged, model.max_lag, model.ylag, model.xlag, model.model_type, predefined_regressors=model.pivv
        )
        target = data["y"][model.max_lag :]
        model.theta = model.estimator.optimize(psi, target)
        if config.options["estimator"] == "extended least squares":
            model.theta = model.estimator.unbiased_estimator(
                psi, target, model.theta, 2, model.max_lag, model.estimator, model.basis_function, 20
            )
        yield SysIdentPyModel(model, advance)


def _search(X: np.ndarray, y: np.ndarray, spec) -> StandardisedModel:
    options = [{"estimator": "least squares"}, {"estimator": "extended least squares"}]
    return search_by_free_run(_fit_sizes, options, X, y, spec)


def _recover(cls, criterion: str | None, *, extended: bool = False):
    """Let the library's criterion choose the size; without a criterion the true size is told."""

    def fit(X: np.ndarray, y: np.ndarray, spec: LibrarySpec) -> SysIdentPyModel:
        if criterion is None:
            arguments = {"order_selection": False, "n_terms": len(spec.true_terms)}
        else:
            arguments = {"order_selection": True, "info_criteria": criterion, "n_info_values": spec.max_terms}
        model, advance = _build(cls, spec, **arguments)
        if extended:
            model.estimator, model.elag = LeastSquares(unbiased=True), 2
        model.fit(**_columns(X, y, advance))
        return SysIdentPyModel(model, advance)

    return fit


def _select(u: np.ndarray, y: np.ndarray, n_lags: int, degree: int, n_terms: int) -> list[str]:
    lags = tuple(range(1, n_lags + 1))
    model, _ = _build(FROLS, Config(lags, lags, degree), order_selection=False, n_terms=n_terms)
    model.fit(X=u.reshape(-1, 1), y=y.reshape(-1, 1))
    return [_text(code, 0) for code in model.final_model]


def _make_simulator(terms: Sequence[Term], theta: np.ndarray):
    lags = {signal: max(lag for term in terms for s, lag in term if s == signal) for signal in "uy"}
    degree = max(len(term) for term in terms)
    model = FROLS(
        ylag=lags["y"], xlag=lags["u"], basis_function=Polynomial(degree=degree), estimator=LeastSquares()
    )
    codes = [sorted(((1000 if s == "y" else 2000) + lag for s, lag in term), reverse=True) for term in terms]
    model.final_model = np.array([code + [0] * (degree - len(code)) for code in codes])
    model.n_inputs, model.max_lag = 1, max(lags.values())
    model.theta = np.asarray(theta).reshape(-1, 1)
    return SysIdentPyModel(model).predict


SEARCHES = {"sysidentpy": _search}
RECOVERERS = {
    "sysidentpy: FROLS aic": _recover(FROLS, "aic"),
    "sysidentpy: FROLS bic": _recover(FROLS, "bic"),
    "sysidentpy: FROLS bic, ELS": _recover(FROLS, "bic", extended=True),
    "sysidentpy: OSF, told size": _recover(OSF, None),
}
SELECTORS = {"sysidentpy": _select}
SIMULATORS = {"sysidentpy": _make_simulator}
