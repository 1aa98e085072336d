"""Information criteria: how much a smaller residual must pay for one more parameter."""

import numpy as np
from scipy.special import gammaln

from narx_sklearn._validation import check_choice

__all__ = ["CRITERIA", "information_criterion"]


def _aic(n, k, m):
    return 2.0 * k


def _aicc(n, k, m):
    spare = n - k - 1.0
    return np.where(spare > 0, 2.0 * k * n / np.where(spare > 0, spare, 1.0), np.inf)


def _bic(n, k, m):
    return k * np.log(n)


def _fpe(n, k, m):
    return np.where(n > k, n * np.log((n + k) / np.where(n > k, n - k, 1.0)), np.inf)


def _lilc(n, k, m):
    return 2.0 * k * np.log(np.log(n))


def _ebic(n, k, m):
    log_choices = gammaln(m + 1) - gammaln(k + 1) - gammaln(np.maximum(m - k, 0) + 1)
    return k * np.log(n) + 2.0 * log_choices


CRITERIA = {
    "aic": _aic,
    "aicc": _aicc,
    "bic": _bic,
    "ebic": _ebic,
    "fpe": _fpe,
    "lilc": _lilc,
    "khundrin": _lilc,  # the law of the iterated logarithm under the name that part of the field uses
}


def information_criterion(name: str, rss, n_samples: int, n_parameters, n_candidates: int | None = None):
    """Evaluate an information criterion, ``N ln(sigma^2) + penalty(N, n)``.

    ============  ==================================
    name          penalty
    ============  ==================================
    ``aic``       ``2 n`` (2.44)
    ``aicc``      ``2 n N/(N - n - 1)``
    ``bic``       ``n ln N``
    ``ebic``      ``n ln N + 2 ln C(M, n)``
    ``fpe``       ``N ln((N + n)/(N - n))``
    ``lilc``      ``2 n ln ln N``; also ``khundrin``
    ============  ==================================

    The best of many candidates looks better than it is. ``ebic`` pays for that: a set of n terms was chosen
    from the ``C(M, n)`` sets that M candidates allow. The others charge as if the n terms had been known.

    Parameters
    ----------
    name : str
        Which one.
    rss : float or array-like
        Sum of squared residuals, positive; its unit only shifts the criterion.
    n_samples : int
        Number of samples N, at least 3.
    n_parameters : int or array-like
        Number of parameters n, as many as ``rss``.
    n_candidates : int, default=None
        Number of candidate terms M that they were chosen from; needed by ``ebic``.

    Returns
    -------
    float or ndarray
        The criterion; smaller is better, differences count.

    Raises
    ------
    ValueError
        If the name is not known, or ``ebic`` is asked for without ``n_candidates``.

    References
    ----------
    H. Akaike (1974), eq. (2.44) of the thesis; G. Schwarz (1978); C. Hurvich and C.-L. Tsai (1989);
    E. Hannan and B. Quinn (1979) for the iterated logarithm; J. Chen and Z. Chen (2008) for ``ebic``,
    with their gamma of 1.

    Examples
    --------
    >>> from narx_sklearn.identification import information_criterion
    >>> round(float(information_criterion("bic", rss=10.0, n_samples=100, n_parameters=3)), 3)
    -216.443
    """
    check_choice(name, "criterion", CRITERIA)
    if name == "ebic" and n_candidates is None:
        raise ValueError("The criterion 'ebic' needs n_candidates, the number of terms chosen from.")
    rss = np.maximum(np.asarray(rss, dtype=float), np.finfo(float).tiny)  # infinite stays infinite
    k = np.asarray(n_parameters, dtype=float)
    return n_samples * np.log(rss / n_samples) + CRITERIA[name](float(n_samples), k, n_candidates)
