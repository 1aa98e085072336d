"""What a machine is doing at each sample: signals, rates, directions, nearness to a reversal or a limit."""

from collections.abc import Sequence

import numpy as np
import pandas as pd

from narx_sklearn.discrepancy.simulators.simulator import Signal
from narx_sklearn.model.units import tidy_unit

PLAIN = "plain"  # attribute of a table: its columns that are signals or their sizes
SAME = 0.999  # correlation above which a rate is a state that is there already


def features(
    u: np.ndarray, x: np.ndarray, dt: float, *, inputs: Sequence[Signal], states: Sequence[Signal], first=(0,)
) -> pd.DataFrame:
    """Describe each sample by quantities a person can read.

    Parameters
    ----------
    u : ndarray of shape (n_samples, n_inputs)
        Inputs.
    x : ndarray of shape (n_samples, n_states)
        States, best with the smoothed deviation added; NaN outside the windows.
    dt : float
        Sampling period, s.
    inputs, states : sequence of Signal
        Names and units.
    first : sequence of int, default=(0,)
        First samples of the sessions.

    Returns
    -------
    DataFrame of shape (n_samples, n_features)
        For each signal: itself and, unless it is constant, its size where it has either sign, else its
        distance from the nearer end of its range, its rate, its direction (-1, 0, 1) and the seconds since
        its last reversal.

    Examples
    --------
    >>> import numpy as np
    >>> from narx_sklearn.discrepancy.locate import features
    >>> from narx_sklearn.discrepancy.simulators.simulator import Signal
    >>> t = np.arange(100) * 0.1
    >>> table = features(np.sin(t)[:, None], np.cos(t)[:, None], 0.1, inputs=[Signal("drive", "V")],
    ...                  states=[Signal("position", "m")])
    >>> float(table.loc[30, "time since reversal of drive [s]"].round(1))
    1.3
    """
    columns: dict[str, np.ndarray] = {}
    signals = [*zip(inputs, u.T, strict=True), *zip(states, x.T, strict=True)]
    for signal, values in signals:
        columns[str(signal)] = values
    kept = [values for _, values in signals]
    for signal, values in signals:
        low, high = np.nanmin(values), np.nanmax(values)
        if not high > low:
            continue
        name, unit = signal
        if low < 0 < high:
            columns[f"|{signal}|"] = np.abs(values)
        else:
            columns[_label("distance from the ends of", name, unit)] = np.minimum(values - low, high - values)
        rate = np.concatenate([_rate(piece) for piece in np.split(values, [k for k in first if k > 0])]) / dt
        if not any(_alike(rate, other) for other in kept):
            columns[_label("rate of", name, tidy_unit(f"{unit or 1}/s"))] = rate
        change = np.diff(values, prepend=np.nan)
        change[list(first)] = 0.0
        direction = np.where(np.isnan(change), 0.0, np.sign(change))
        columns[f"direction of {name}"] = direction
        columns[_label("time since reversal of", name, "s")] = _since_reversal(direction, first) * dt
    table = pd.DataFrame(columns)
    names = [str(signal) for signal, _ in signals]
    table.attrs[PLAIN] = [name for name in table.columns if name.strip("|") in names]
    return table


def plain(table: pd.DataFrame) -> pd.DataFrame:
    """Return the features that are signals or their sizes; all where nothing is known of them."""
    return table[[column for column in table.attrs.get(PLAIN, table.columns) if column in table]]


def _label(what: str, name: str, unit: str) -> str:
    return f"{what} {name} [{unit}]" if unit else f"{what} {name}"


def _rate(values: np.ndarray) -> np.ndarray:
    return np.gradient(values) if values.size > 1 else np.zeros(values.size)


def _alike(a: np.ndarray, b: np.ndarray) -> bool:
    both = np.isfinite(a) & np.isfinite(b)
    a, b = a[both], b[both]
    return a.size > 2 and a.std() > 0 and b.std() > 0 and abs(np.corrcoef(a, b)[0, 1]) > SAME


def _since_reversal(direction: np.ndarray, first) -> np.ndarray:
    """Return the samples since the direction last turned round, or since the session began."""
    moving = np.flatnonzero(direction)
    turned = np.zeros(direction.size, dtype=bool)
    turned[moving[1:][direction[moving[1:]] != direction[moving[:-1]]]] = True
    turned[list(first)] = True
    index = np.arange(direction.size)
    return index - np.maximum.accumulate(np.where(turned, index, 0))
