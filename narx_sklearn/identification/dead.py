"""Values that recorders write where nothing was measured: a fit takes them as measured, and says so."""

import warnings

import numpy as np

from narx_sklearn.exceptions import NarxWarning
from narx_sklearn.identification.one_step.procedure import Problem
from narx_sklearn.identification.records.record import ArrayRecord, Record
from narx_sklearn.model.dead_values import dead_columns, dead_values, known_values


def warn_of_dead(problem: Problem, record: Record, stacklevel: int = 2) -> None:
    """Warn of each signal of arrays and tables that holds values which recorders are known to write for none.

    Of files and dask collections, which would be read once more, nothing is said.
    """
    if not isinstance(record, ArrayRecord):
        return
    signals = dict(zip(problem.outputs + problem.inputs, [*record.y.T, *record.X.T], strict=True))
    low, _, high = record.moments.range
    # what is far off all else is the least or the largest value, which is known without another pass
    suspect = [
        name
        for name, *ends in zip(signals, low, high, strict=True)
        if known_values(np.array(ends)).size and np.isfinite(ends).all()
    ]
    for name in suspect:
        signal = signals[name]
        for column in dead_columns([name], signal[:, None], dead_values(signal)[:, None]):
            them = "it" if column.samples.size == 1 else "them"
            warnings.warn(
                f"{column.words}: what a recorder writes where nothing was measured. A fit takes {them} as "
                f"measured; where nothing was, replace {them} by NaN, which marks a gap.",
                NarxWarning,
                stacklevel=stacklevel + 1,
            )
