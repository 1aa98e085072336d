"""Sparse regression of what the rates lack, with PySINDy's optimizers."""

import warnings

import numpy as np

from benchmarks.concealed.baselines.answer import Answer, corrected_runs
from benchmarks.concealed.baselines.candidate_terms import evaluate, features

__all__ = ["run_ssr", "run_stlsq"]

THRESHOLDS = np.geomspace(0.01, 0.5, 8)


def run_stlsq(bench) -> Answer:
    """Sequentially thresholded least squares, its threshold by BIC."""
    import pysindy

    return _run(bench, [pysindy.STLSQ(threshold=t, alpha=1e-6) for t in THRESHOLDS])


def run_ssr(bench) -> Answer:
    """Stepwise sparse regression; the size by BIC along its path."""
    import pysindy

    return _run(bench, [pysindy.SSR(alpha=1e-6)])


def _run(bench, optimizers):
    found, best_state, best_gain = {}, None, 0.0
    for state in np.flatnonzero(np.any(bench.missing != 0.0, axis=0)):
        A, b = evaluate(bench, state), bench.missing[:, state]
        scale = np.maximum(np.linalg.norm(A, axis=0), 1e-300)
        size = np.linalg.norm(b)
        paths = [row for optimizer in optimizers for row in _path(optimizer, A / scale, b / size)]
        costs = [_bic(A / scale, b / size, row) for row in paths]
        row = paths[int(np.argmin(costs))]
        nothing = _bic(A / scale, b / size, np.zeros(A.shape[1]))
        if np.any(row != 0.0) and min(costs) < nothing:
            found[state] = row * size / scale
            if nothing - min(costs) > best_gain:
                best_state, best_gain = state, nothing - min(costs)
                strongest = int(np.argmax(np.abs(row)))
    if best_state is None:
        return Answer(False, None, corrected_runs(bench, lambda x, u: 0.0))

    def added(x, u):
        rates = np.zeros(bench.x0.size)
        for state, coefficients in found.items():
            rates[state] = (evaluate(bench, state, x, u) @ coefficients)[0]
        return rates

    named = features(bench, best_state)[strongest][0].name
    return Answer(True, named, corrected_runs(bench, added))


def _path(optimizer, A, b):
    """Return the coefficient vectors that an optimizer passed through."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        optimizer.fit(A, b[:, None])
    history = getattr(optimizer, "history_", [])
    return [np.ravel(row) for row in (*history, optimizer.coef_) if np.size(row) == A.shape[1]]


def _bic(A, b, row):
    left = b - A @ row
    return b.size * np.log(left @ left) + np.count_nonzero(row) * np.log(b.size)
