"""Residual correlation tests: is the nominal simulator's error white, and unrelated to the input?"""

import numpy as np
from scipy.stats import chi2

from benchmarks.concealed.baselines.answer import Answer

__all__ = ["run"]

N_LAGS = 20
LEVEL = 0.01


def run(bench) -> Answer:
    """Portmanteau tests of the residual with itself and with the input, its square and its cube."""
    d = bench.u[:, 0] - bench.u[:, 0].mean()
    p_values = []
    for e in bench.fit.residual.T:
        e = e - e.mean()
        p_values.append(_portmanteau(e, e, range(1, N_LAGS + 1)))
        p_values += [_portmanteau(e, s - s.mean(), range(N_LAGS)) for s in (d, d**2, d**3)]
    missing = min(p_values) * len(p_values) < LEVEL
    return Answer(bool(missing), None, {s: bench.free_run(u) for s, u in bench.heldout.items()})


def _portmanteau(e, s, lags):
    n = e.size
    r = np.array([e[k:] @ s[: n - k] for k in lags]) / (np.linalg.norm(e) * np.linalg.norm(s) + 1e-300)
    return float(chi2.sf(n * np.sum(r**2), len(r)))
