"""Events of the inputs: steps, reversals, limits; and whether the mismatch follows them."""

import numpy as np
import pandas as pd
from scipy.stats import false_discovery_control

STEP_RATIO = 10.0  # a change this many times the usual one is a step
STEP_SHARE = 0.05  # and at least this share of the range
LIMIT_SHARE = 0.01  # of the range: this close to an extreme is at the limit
N_SHIFTS = 1999  # p-values are multiples of 1/2000
N_WINDOWS = 20  # of the record, each turned in time by a shift of its own
LEVEL = 0.01  # false discovery rate at which one is kept


def input_events(u: np.ndarray) -> dict[str, np.ndarray]:
    """Return the samples at which one input steps, reverses, or arrives at the limits of its range.

    Parameters
    ----------
    u : ndarray of shape (n_samples,)
        One input.

    Returns
    -------
    dict of {str: ndarray of int}
        Samples of each kind: ``"step"``, ``"reversal"``, ``"limit"``.
    """
    change = np.diff(u, prepend=u[:1])
    change[~np.isfinite(change)] = 0.0
    span = np.nanmax(u) - np.nanmin(u) if np.isfinite(u).any() else 0.0
    size = np.abs(change)
    steps = np.flatnonzero((size > STEP_RATIO * np.median(size)) & (size > STEP_SHARE * span))
    moving = np.flatnonzero(size > 1e-9 * span)
    signs = np.sign(change[moving])
    reversals = moving[1:][signs[1:] != signs[:-1]] - 1
    near_ends = (u >= np.nanmax(u) - LIMIT_SHARE * span, u <= np.nanmin(u) + LIMIT_SHARE * span)
    arrivals = [np.flatnonzero(near[1:] & ~near[:-1]) + 1 for near in near_ends if span > 0]
    limits = np.sort(np.concatenate([np.array([], dtype=int), *arrivals]))
    return {"step": steps, "reversal": reversals, "limit": limits}


def event_table(
    residual: np.ndarray, u: np.ndarray, *, reach: int = 20, names=None, random_state=None
) -> pd.DataFrame:
    """Test whether the residual is larger after events of the inputs.

    Parameters
    ----------
    residual : ndarray of shape (n_samples,) or (n_samples, n_outputs)
        Residual, or a latent force; NaN is skipped.
    u : ndarray of shape (n_samples, n_inputs)
        Inputs.
    reach : int, default=20
        Samples after an event that belong to it.
    names : sequence of str, optional
        Names of the inputs.
    random_state : int or None, default=None
        Seed of the shifts.

    Returns
    -------
    DataFrame
        ``input``, ``event``, ``count``, ``time_share``, ``share`` of the energy, ``ratio`` of mean energy
        after events to elsewhere, ``p_value`` (against windows of the same residual, each turned in time;
        adjusted for false discovery), ``kept``.

    Examples
    --------
    >>> import numpy as np
    >>> from narx_sklearn.discrepancy.locate import event_table
    >>> rng = np.random.default_rng(0)
    >>> u = np.repeat(rng.normal(size=60), 100)[:, None]
    >>> ringing = np.exp(-(np.arange(6000) % 100) / 5) * rng.normal(size=6000)
    >>> table = event_table(ringing, u, random_state=0)
    >>> bool(table.loc[table["event"] == "step", "kept"].item())
    True
    """
    energy = energy_of(residual)
    known = np.isfinite(energy)
    filled = np.where(known, energy, np.nanmean(energy))
    length = energy.size // N_WINDOWS
    shifts = np.random.default_rng(random_state).integers(0, max(length, 1), (N_SHIFTS, N_WINDOWS))
    rows = []
    for i in range(u.shape[1]):
        name = f"input {i}" if names is None else names[i]
        for event, samples in input_events(u[:, i]).items():
            mask = after(samples, energy.size, reach)
            time_share = mask.mean()
            if samples.size < 3 or length < 2 or not 0 < time_share < 1:
                continue
            share = filled[mask].sum() / filled.sum()
            p = _p_value(filled, mask, shifts, length)
            ratio = (share / time_share) / max((1 - share) / (1 - time_share), 1e-300)
            rows.append((name, event, samples.size, time_share, share, ratio, p))
    table = pd.DataFrame(rows, columns=["input", "event", "count", "time_share", "share", "ratio", "p_value"])
    if len(table):
        table["p_value"] = false_discovery_control(table["p_value"])
    table["kept"] = table["p_value"] <= LEVEL
    return table.sort_values("p_value", kind="stable", ignore_index=True)


def _p_value(energy: np.ndarray, mask: np.ndarray, shifts: np.ndarray, length: int) -> float:
    """Return how often windows, each turned by a shift of its own, have as much energy inside the mask."""
    turned, where = (v[: length * N_WINDOWS].reshape(N_WINDOWS, length) for v in (energy, mask))
    # the energy inside the mask for every circular shift of every window at once
    sums = np.fft.irfft(np.fft.rfft(turned) * np.conj(np.fft.rfft(where)), n=length)
    shifted = sums[np.arange(N_WINDOWS), shifts].sum(axis=1)
    return (1 + np.count_nonzero(shifted >= sums[:, 0].sum() * (1 - 1e-12))) / (1 + len(shifts))


def after(samples: np.ndarray, n: int, reach: int) -> np.ndarray:
    """Tell for each of n samples whether it lies within ``reach`` samples after one of the given ones."""
    edges = np.zeros(n + reach + 1)
    np.add.at(edges, samples, 1)
    np.add.at(edges, samples + reach, -1)
    return np.cumsum(edges)[:n] > 0


def energy_of(residual: np.ndarray) -> np.ndarray:
    """Return the energy of each sample, columns in units of their variance; NaN where nothing is known."""
    columns = np.asarray(residual, dtype=float).reshape(len(residual), -1)
    known = np.isfinite(columns)
    size = np.array([np.mean(c[k] ** 2) if k.any() else 0.0 for c, k in zip(columns.T, known.T, strict=True)])
    scaled = np.where(known, columns, 0.0) ** 2 / np.where(size > 0, size, 1.0)
    return np.where(known.any(axis=1), scaled.sum(axis=1), np.nan)
