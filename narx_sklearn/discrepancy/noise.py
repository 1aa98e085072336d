"""The colour of what is left over: an autoregressive model of each output's residual."""

from typing import NamedTuple

import numpy as np
from scipy.linalg import LinAlgError, solve_toeplitz

LONGEST = 6


class Noise(NamedTuple):
    """Noise of each output: an autoregression, and the standard deviation of its innovations."""

    coefficients: tuple[np.ndarray, ...]  # one array an output: e[k] = r[k] - sum_i a_i r[k-i]
    sigma: np.ndarray  # (n_outputs,)

    @classmethod
    def white(cls, sigma: np.ndarray) -> "Noise":
        """Return white noise."""
        return cls(tuple(np.zeros(0) for _ in sigma), np.asarray(sigma, dtype=float))

    @property
    def order(self) -> int:
        """Longest memory, samples."""
        return max(a.size for a in self.coefficients)


def estimate_noise(residual: np.ndarray, seen: np.ndarray, longest: int = LONGEST) -> Noise:
    """Fit an autoregression to residuals in windows; the order is chosen by BIC.

    Parameters
    ----------
    residual : ndarray of shape (n_windows, n_samples, n_outputs)
        Zero where not seen.
    seen : ndarray of bool, same shape
    """
    coefficients, sigmas = [], []
    for output in range(residual.shape[2]):
        r, known = residual[:, :, output], seen[:, :, output]
        n = int(known.sum())
        c = np.array(
            [np.sum(r[:, lag:] * r[:, : r.shape[1] - lag]) for lag in range(min(longest, r.shape[1] - 1) + 1)]
        )
        counts = np.array([np.sum(known[:, lag:] & known[:, : r.shape[1] - lag]) for lag in range(c.size)])
        c = c / np.maximum(counts, 1) * (1 - np.arange(c.size) / max(n, 2))
        best = (n * np.log(max(c[0], 1e-300)), np.zeros(0), c[0])
        for order in range(1, c.size):
            try:
                a = solve_toeplitz(c[:order], c[1 : order + 1])
            except LinAlgError:
                break
            variance = c[0] - a @ c[1 : order + 1]
            if not variance > 1e-12 * c[0]:
                break
            bic = n * np.log(variance) + order * np.log(max(n, 2))
            if bic < best[0]:
                best = (bic, a, variance)
        coefficients.append(best[1])
        sigmas.append(np.sqrt(max(best[2], 1e-300)))
    return Noise(tuple(coefficients), np.array(sigmas))
