"""The leading choices of a search, fitted to the folds as the final model will be to all the data.

Least squares on a compressed record ranks hundreds of choices at once. The final fit then searches and
refines on the free run: another model, which may be far better or run away where the first did not. So each
structure (lags, delay, degree) sends its best size, and the one that the fit itself would find, into a second
round.
"""

import warnings
from collections.abc import Callable

import numpy as np
from joblib import Parallel, delayed

from narx_sklearn.exceptions import NarxWarning
from narx_sklearn.identification.cross_validation.folds import Fold, parted
from narx_sklearn.identification.cross_validation.judged import Judged
from narx_sklearn.identification.cross_validation.racing import race
from narx_sklearn.identification.free_run.free_run_fit import reads_all_samples
from narx_sklearn.identification.free_run.scoring import FreeRunJudge
from narx_sklearn.identification.records.record import ArrayRecord, Record
from narx_sklearn.identification.settings import refine_mode

__all__ = ["choose_finalists", "judge_finalists", "n_leading", "refinement_decides"]

# of all training parts of all finalists together: about a minute of fits; two structures go on in any case
FITTED_SAMPLES = 400_000


def refinement_decides(settings, record: Record) -> bool:
    """Tell whether the final fit may take another model than least squares, and has all samples for it."""
    mode = refine_mode(settings.refine)
    if mode == "never" or (mode == "auto" and record.n_outputs > 1):
        return False
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", NarxWarning)  # the final fit tells it
        return reads_all_samples(settings, record)


def n_leading(n_training: int) -> int:
    """Return how many structures go on, of folds that train on so many samples together."""
    return max(FITTED_SAMPLES // max(n_training, 1), 2)


def choose_finalists(
    screened: Judged, sizes: list[dict], own_size: str | None, n_training: int
) -> list[dict]:
    """Return the choices that go into the second round, those of leading structures first.

    Parameters
    ----------
    screened : Judged
        All choices by least squares, the sizes of each structure one after another.
    sizes : list of dict
        The sizes: ``n_terms`` or ``criterion``.
    own_size : str or None
        Criterion of the search on the free run that finds the size by itself, where no size was asked for.
    n_training : int
        Samples in the training parts of all folds together: what one finalist costs.

    Examples
    --------
    >>> import numpy as np
    >>> from narx_sklearn.identification.cross_validation.finalists import choose_finalists
    >>> from narx_sklearn.identification.cross_validation.judged import Judged
    >>> sizes = [{"n_terms": 1}, {"n_terms": 2}]
    >>> grid = [{"degree": d} | size for d in (1, 2, 3) for size in sizes]
    >>> scores = np.array([[0.5], [0.7], [0.6], [0.9], [0.1], [0.0]])
    >>> screened = Judged(grid, scores, np.ones((6, 1)), weights=np.ones(1))
    >>> choose_finalists(screened, sizes, None, n_training=200_000)
    [{'degree': 2, 'n_terms': 2}, {'degree': 1, 'n_terms': 2}]
    """
    means = np.nan_to_num(screened.pooled, nan=-np.inf).reshape(-1, len(sizes))
    counted = np.array(["n_terms" in size for size in sizes])
    structures = [screened.choices[g * len(sizes)] for g in range(len(means))]
    structures = [{name: s[name] for name in s if name not in ("n_terms", "criterion")} for s in structures]
    finalists = []
    for g in np.argsort(-means.max(axis=1), kind="stable")[: n_leading(n_training)]:
        for kind in (counted, ~counted):
            if kind.any():
                best = np.flatnonzero(kind)[np.argmax(means[g, kind])]
                finalists.append(screened.choices[g * len(sizes) + best])
        if own_size is not None:
            finalists.append(structures[g] | {"criterion": own_size})
    return finalists


def judge_finalists(
    finalists: list[dict],
    regressor_of: Callable,
    record: Record,
    folds: list[Fold],
    *,
    weights: np.ndarray,
    kept: int,
    room: float,
    n_jobs: int | None,
) -> Judged:
    """Fit finalists to the training parts of the folds they reach, and score their free runs of the tests.

    ``kept`` and ``room`` are those of `race`.
    """

    def judge(f: int, wanted: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        fold = folds[f]
        X, y, labels = record.take(fold.training)
        training = ArrayRecord(
            X, y, parted(labels, fold.training), input_labels=record.input_labels,
            output_labels=record.output_labels, y_ndim=record.y_ndim, sampling_period=record.sampling_period,
        )  # fmt: skip
        X, y, labels = record.take(fold.test)
        on_test = FreeRunJudge(X, y, sessions=parted(labels, fold.test))
        asked = np.flatnonzero(wanted[:, 0])
        fitted = Parallel(n_jobs=n_jobs, prefer="threads")(
            delayed(_fit_and_judge)(regressor_of(**finalists[g]), training, on_test) for g in asked
        )
        scores, counts = np.full(wanted.shape, np.nan), np.full(wanted.shape, np.nan)
        scores[asked, 0], counts[asked, 0] = zip(*fitted, strict=True)
        return scores, counts

    scores, counts = race(judge, weights, (len(finalists), 1), kept=kept, room=room)
    return Judged(finalists, scores[:, 0], counts[:, 0], weights)


def _fit_and_judge(regressor, training: Record, on_test: FreeRunJudge) -> tuple[float, int]:
    """Return score and number of terms of a fit."""
    model = regressor.fit(training).model_
    return on_test.score(model), model.n_terms
