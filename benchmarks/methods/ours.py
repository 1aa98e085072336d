"""narx_sklearn.

Real recordings: `ours` gives the model what a user of the machine knows (`ours_gray_box.py` says what; where
that file has no recipe, the search on any recording stands in), `ours: black box` is the search on any
recording (`ours_black_box.py`), `ours: NARXRegressorCV` one plain fit (`ours_cv.py`). All decide on the
training record alone.
"""

from collections.abc import Iterable, Sequence

import numpy as np
from harness.candidates import LibrarySpec
from harness.polynomial import Term, term_text
from harness.recordings import SearchSpec

from methods import ours_black_box, ours_cv, ours_gray_box
from methods.ours_state import OurModel
from narx_sklearn import NARXRegressor
from narx_sklearn.model import NARXModel, free_run


class PlainModel:
    """A fitted NARXModel of one equation."""

    def __init__(self, model: NARXModel):
        self.model = model
        self.terms = tuple(_texts(model.library))

    def predict(self, X: np.ndarray, y_init: np.ndarray) -> np.ndarray:
        """Simulate from the end of the initial outputs."""
        head = max(0, len(y_init) - self.model.max_lag)
        run = free_run(self.model, X[head:, None], y_init=y_init[head:]).y[:, 0]
        return np.r_[y_init[:head], run]


def _texts(library: Iterable) -> list[str]:
    """Write the terms in the benchmarks' order of factors, so that the structures can be compared."""
    return [term_text(tuple(sorted((v.signal, v.lag) for v in term.expanded))) for term in library]


def _search(X: np.ndarray, y: np.ndarray, spec: SearchSpec) -> OurModel:
    recipe = ours_gray_box.recipe_for(spec) or ours_black_box.search
    return recipe(X, y, spec)


def _recover(X: np.ndarray, y: np.ndarray, spec: LibrarySpec) -> PlainModel:
    model = NARXRegressor(
        output_lags=list(spec.output_lags),
        input_lags=list(spec.input_lags),
        degree=spec.degree,
        max_terms=spec.max_terms,
    )
    return PlainModel(model.fit(X.reshape(-1, 1), y).model_)


def _select(u: np.ndarray, y: np.ndarray, n_lags: int, degree: int, n_terms: int) -> list[str]:
    model = NARXRegressor(  # the peers' task: the first terms of the forward ERR order, in raw signals
        n_lags, n_lags, degree=degree, n_terms=n_terms, max_terms=n_terms, search="forward", refine=False,
        origin="zero",
    )  # fmt: skip
    return _texts(model.fit(u.reshape(-1, 1), y).model_.library)


def _make_simulator(terms: Sequence[Term], theta: np.ndarray):
    equations = {term_text(term): value for term, value in zip(terms, theta, strict=True)}
    return PlainModel(NARXModel.from_equations(equations)).predict


SEARCHES = {
    "ours": _search,
    "ours: black box": ours_black_box.search,
    "ours: NARXRegressorCV": ours_cv.search,
}
RECOVERERS = {"ours": _recover}
SELECTORS = {"ours": _select}
SIMULATORS = {"ours": _make_simulator}
