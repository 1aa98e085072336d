"""The catalogue's likelihoods in white noise, compared by BIC: no calibration, no held-out check."""

import numpy as np

from benchmarks.concealed.baselines.answer import Answer
from benchmarks.concealed.baselines.candidate_terms import evaluate, features
from benchmarks.concealed.structural import remainder

__all__ = ["run"]

SMALL = 0.02  # of the state's own rate: how much of a feature is injected to see what it does


def run(bench) -> Answer:
    """Name the feature whose effect on the simulated output lowers BIC most, if any does."""
    b = remainder(bench.fit.residual[:, :, None], bench.fit).ravel()
    n = b.size
    best, named = 0.0, None
    for state in range(bench.x0.size):
        table = evaluate(bench, state)
        own = np.std(np.diff(bench.states[:, state])) / bench.machine.dt
        for (code, _, _), column in zip(features(bench, state), table.T, strict=True):
            c = _response(
                bench, state, column * (SMALL * own / max(np.std(column), np.abs(column).max() * 0.1))
            )
            if c @ c < 1e-12 * n:
                continue
            share = (c @ b) ** 2 / (c @ c) / (b @ b)
            gain = -n * np.log1p(-share) - np.log(n)
            if gain > best:
                best, named = gain, code.name
    return Answer(named is not None, named, {s: bench.free_run(u) for s, u in bench.heldout.items()})


def _response(bench, state, series):
    """Return what a series added to one rate does to the outputs, less what parameters can do."""
    added = np.zeros_like(bench.states)
    added[:, state] = series
    fit, measured = bench.fit, list(bench.machine.measured)
    change = bench.windowed(bench.u, fit.starts, fit.length, added) - bench.windowed(
        bench.u, fit.starts, fit.length
    )
    return remainder((change[:, measured] / bench.sigma)[:, :, None], fit).ravel()
