"""Recordings in many files, read block by block; a file that cannot be read is named, never used in part."""

import warnings
from collections.abc import Iterator, Mapping, Sequence
from functools import cached_property
from glob import glob
from os import PathLike, fspath
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pandas as pd
from joblib import Parallel, delayed

from narx_sklearn._validation import as_signals, check_choice
from narx_sklearn.exceptions import NarxWarning
from narx_sklearn.identification.records.record import (
    CHUNK_ROWS,
    Block,
    Moments,
    Record,
    grouped,
    in_groups,
    merge_tree,
    running_total,
)

__all__ = ["Recordings", "open_record"]

ERRORS = ("raise", "skip")
FILES_TOGETHER = 64  # files read before their factors are merged, and kept in a checkpoint
LAST_BYTES = 1 << 16  # end of a text file in which its last line is looked for
SEPARATORS = {";": "semicolons", "\t": "tabs"}  # of tables as other programs write them


class FileSurvey(NamedTuple):
    """What one pass over a file found."""

    n_samples: int
    moments: Moments
    stamp: tuple[int, int]  # size in bytes, time of the last change in nanoseconds


class Table(NamedTuple):
    """A file and which of its columns are read."""

    path: str
    inputs: tuple
    outputs: tuple
    session: str | int | None
    columns: tuple | None  # names of the columns of a plain array

    def blocks(self, size: int) -> Iterator[Block]:
        """Yield the file's samples in order, ``size`` at a time, without overlap."""
        names = [*self.inputs, *self.outputs, *([] if self.session is None else [self.session])]
        begin = 0
        for part in _PARTS[kind_of(self.path)](self, names, size):
            X, y = as_signals(part[list(self.inputs)], "X"), as_signals(part[list(self.outputs)], "y")
            labels = None if self.session is None else part[self.session].to_numpy()
            yield Block(X, y, labels, 0, begin)
            begin += X.shape[0]

    def blocks_with_past(self, first: int, reach: int, whole: bool) -> Iterator[Block]:
        """Yield the blocks of the file, its first sample being ``first``, with what lags reach before."""
        if whole:
            parts = list(self.blocks(CHUNK_ROWS))
            if parts:
                yield joined(parts, first)
            return
        past: Block | None = None
        for block in self.blocks(CHUNK_ROWS):
            block = block._replace(first=first + block.first)
            if past is not None:
                block = joined([past, block], block.first, n_past=past.X.shape[0])
            yield block
            kept = slice(max(block.X.shape[0] - reach, 0), None)
            labels = None if block.sessions is None else block.sessions[kept]
            past = Block(block.X[kept], block.y[kept], labels, 0, 0)

    def survey(self) -> FileSurvey:
        """Read all of the file once; raise a ValueError if any of it cannot be used."""
        stamp = stamp_of(self.path)
        n_samples, moments = 0, Moments.none(len(self.outputs) + len(self.inputs))
        if kind_of(self.path) == "csv":
            check_last_line(self.path)
        for block in self.blocks(CHUNK_ROWS):
            n_samples += block.n_own
            moments = moments.merge(Moments.of(block.X, block.y, block.sessions))
        if n_samples == 0:
            raise ValueError("it holds no samples")
        empty = [
            name
            for name, count in zip((*self.outputs, *self.inputs), moments.known, strict=True)
            if count == 0
        ]
        if empty:
            raise ValueError(f"the columns {empty} hold no number at all")
        return FileSurvey(n_samples, moments, stamp)


def joined(blocks: Sequence[Block], first: int, n_past: int = 0) -> Block:
    """Return consecutive blocks as one."""
    labels = None if blocks[0].sessions is None else np.concatenate([b.sessions for b in blocks])
    return Block(np.vstack([b.X for b in blocks]), np.vstack([b.y for b in blocks]), labels, n_past, first)


def kind_of(path: str) -> str:
    """Return how a file is read: "csv", "parquet" or "npy", by the ending of its name."""
    suffixes = Path(path).suffixes
    for kind in _PARTS:
        if f".{kind}" in suffixes[-2:]:
            return kind
    raise ValueError(
        f"{path} has no ending of .csv (or .csv.gz), .parquet or .npy, so how to read it is not known."
    )


def stamp_of(path: str) -> tuple[int, int]:
    """Return size and time of change of a file."""
    status = Path(path).stat()
    return status.st_size, status.st_mtime_ns


def check_last_line(path: str) -> None:
    """Raise a ValueError if the last line of a text file has fewer fields than the one before it.

    A reader would take the missing fields for a gap.
    """
    if not path.endswith(".csv"):
        return
    with open(path, "rb") as file:
        file.seek(0, 2)
        file.seek(max(file.tell() - LAST_BYTES, 0))
        lines = [line for line in file.read().splitlines() if line.strip()]
    if len(lines) > 1 and lines[-1].count(b",") < lines[-2].count(b","):
        raise ValueError("it is cut off in its last line")


def _parts_of_csv(table: Table, names: list, size: int) -> Iterator[pd.DataFrame]:
    labels = [str(label) for label in pd.read_csv(table.path, nrows=0, index_col=False).columns]
    missing = [name for name in names if name not in labels]
    if missing:
        mark = next((mark for mark in SEPARATORS if any(mark in label for label in labels)), None)
        if mark is not None and not set(missing) - set(mark.join(labels).split(mark)):
            raise ValueError(
                f"its columns are separated by {SEPARATORS[mark]}, and commas are read here. Write it anew, "
                f"as with pd.read_csv(path, sep={mark!r}).to_csv(path, index=False), and decimal=',' in the "
                "former where decimals are commas"
            )
        raise ValueError(f"it lacks the columns {missing}; it has {labels}")
    with pd.read_csv(table.path, usecols=names, chunksize=size) as reader:
        yield from reader


def _parts_of_parquet(table: Table, names: list, size: int) -> Iterator[pd.DataFrame]:
    try:
        from pyarrow.parquet import ParquetFile
    except ImportError as error:
        raise ImportError(
            'Reading parquet files needs pyarrow: pip install "narx-sklearn[dask]", or pip install pyarrow.'
        ) from error
    with ParquetFile(table.path) as file:
        missing = [name for name in names if name not in file.schema_arrow.names]
        if missing:
            raise ValueError(f"it lacks the columns {missing}; it has {file.schema_arrow.names}")
        for batch in file.iter_batches(batch_size=size, columns=names):
            yield batch.to_pandas()


def _parts_of_npy(table: Table, names: list, size: int) -> Iterator[pd.DataFrame]:
    data = np.load(table.path, mmap_mode="r", allow_pickle=False)
    if data.ndim != 2:
        raise ValueError(f"it holds an array of {data.ndim} axes; two are wanted, samples by columns")
    labels = list(range(data.shape[1])) if table.columns is None else list(table.columns)
    if len(labels) != data.shape[1]:
        raise ValueError(f"it has {data.shape[1]} columns, and columns= names {len(labels)}")
    missing = [name for name in names if name not in labels]
    if missing:
        raise ValueError(f"it lacks the columns {missing}; it has {labels}")
    where = [labels.index(name) for name in names]
    for begin in range(0, data.shape[0], size):
        yield pd.DataFrame(np.array(data[begin : begin + size, where], dtype=float), columns=names)


_PARTS = {"csv": _parts_of_csv, "parquet": _parts_of_parquet, "npy": _parts_of_npy}


class Recordings(Record):
    """Recordings in files, of which a fit reads blocks: CSV, parquet, or plain arrays (``.npy``).

    Every file is a session of its own; lags never reach from one into another. All files are read once, in
    full, before anything is used of any; what a fit then reads are the files that were found whole.

    Parameters
    ----------
    files : str, path-like, or list of them
        The files; a text with ``*`` stands for all that match, in the order of their names.
    inputs, outputs : str, int, or list of them
        Columns; labels like ``"drive [V]"`` give names and units. Integers count the columns of arrays.
    session : str or int, default=None
        Column whose changes begin another session inside a file.
    columns : list of str, default=None
        Names of the columns of ``.npy`` files.
    errors : {"raise", "skip"}, default="raise"
        What to do with a file that is corrupt: an error that names it, or a warning that names it, and going
        on without it.
    n_jobs : int, default=None
        Files read at the same time, by joblib; results do not depend on it.

    Attributes
    ----------
    skipped : dict of {str: str}
        Files left out and why, once they were read.
    n_samples : int
        Samples in the files used.

    Examples
    --------
    >>> import numpy as np, tempfile
    >>> from pathlib import Path
    >>> from narx_sklearn import NARXRegressor
    >>> from narx_sklearn.identification.records.recordings import Recordings
    >>> folder, rng = Path(tempfile.mkdtemp()), np.random.default_rng(0)
    >>> for machine in range(3):
    ...     u, y = rng.uniform(-1, 1, 400), np.zeros(400)
    ...     for k in range(1, 400):
    ...         y[k] = 0.5 * y[k - 1] + u[k - 1] ** 2
    ...     np.save(folder / f"machine{machine}.npy", np.column_stack([u, y]))
    >>> recordings = Recordings(f"{folder}/*.npy", inputs="u", outputs="y", columns=["u", "y"])
    >>> NARXRegressor(origin="zero", refine=False).fit(recordings).coef_.round(6).tolist()
    [0.5, 1.0]
    """

    def __init__(self, files, *, inputs, outputs, session=None, columns=None, errors="raise", n_jobs=None):
        check_choice(errors, "errors", ERRORS)
        self.inputs, self.outputs = _listed(inputs), _listed(outputs)
        self.files = _found(files)
        self.session, self.errors, self.n_jobs = session, errors, n_jobs
        self.columns = None if columns is None else tuple(columns)
        self.n_inputs, self.n_outputs = len(self.inputs), len(self.outputs)
        self.y_ndim = 1 if isinstance(outputs, str | int) else 2
        for path in self.files:
            kind_of(path)

    @property
    def input_labels(self):  # type: ignore[override]
        """Labels of the inputs, None where columns are counted."""
        return _labels(self.inputs)

    @property
    def output_labels(self):  # type: ignore[override]
        """Labels of the outputs, None where columns are counted."""
        return _labels(self.outputs)

    def _table(self, path: str) -> Table:
        return Table(path, self.inputs, self.outputs, self.session, self.columns)

    @cached_property
    def _surveys(self) -> dict[str, FileSurvey | str]:
        """What was found in each file, or why it cannot be used."""
        read = Parallel(n_jobs=self.n_jobs)(delayed(_survey)(self._table(path)) for path in self.files)
        found = dict(zip(self.files, read, strict=True))
        bad = {path: reason for path, reason in found.items() if isinstance(reason, str)}
        if bad and self.errors == "raise":
            listed = "; ".join(f"{path}: {reason}" for path, reason in bad.items())
            raise ValueError(
                f"{len(bad)} of {len(found)} files cannot be used: {listed}. Mend or leave them out, or pass "
                "errors='skip'."
            )
        if len(bad) == len(found):
            listed = "; ".join(f"{path}: {reason}" for path, reason in bad.items())
            raise ValueError(f"None of the {len(found)} files can be used: {listed}.")
        for path, reason in bad.items():
            warnings.warn(f"{path} is left out: {reason}.", NarxWarning, stacklevel=4)
        return found

    @property
    def _used(self) -> list[tuple[Table, FileSurvey, int]]:
        """Files used, what was found in them, and the index of their first sample."""
        whole = [(p, s) for p, s in self._surveys.items() if not isinstance(s, str)]
        firsts = np.cumsum([0, *(s.n_samples for _, s in whole)])
        return [(self._table(p), s, int(first)) for (p, s), first in zip(whole, firsts[:-1], strict=True)]

    @property
    def skipped(self) -> dict[str, str]:
        """Files left out, and why."""
        return {path: reason for path, reason in self._surveys.items() if isinstance(reason, str)}

    @property
    def n_samples(self) -> int:  # type: ignore[override]
        """Samples in the files used."""
        return sum(survey.n_samples for _, survey, _ in self._used)

    @cached_property
    def moments(self) -> Moments:  # type: ignore[override]
        """Of the outputs and then the inputs."""
        return merge_tree(Moments.merge, [survey.moments for _, survey, _ in self._used])

    def map(self, function, *, reach=0, whole=False):
        """Return ``function(block)`` for every block; see `Record.map`."""
        work = delayed(_map_file)
        found = Parallel(n_jobs=self.n_jobs)(work(function, *file, reach, whole) for file in self._used)
        return [value for values in found for value in values]

    def total(self, function, merge, *, reach=0, whole=False, checkpoint=None):
        """Return the merge over all blocks; see `Record.total`."""
        work = delayed(_total_of_file)

        def total_of(files):
            found = Parallel(n_jobs=self.n_jobs)(work(function, merge, *file, reach, whole) for file in files)
            return merge_tree(merge, found)

        return in_groups(grouped(self._used, FILES_TOGETHER), total_of, merge, checkpoint)

    def take(self, runs):
        """Return the samples in ``runs``; see `Record.take`."""
        pieces = []
        for run in runs:
            for table, survey, first in self._used:
                if run.start < first + survey.n_samples and run.stop > first:
                    pieces += _samples_of_file(table, survey, first, run)
        X, y, labels = (np.concatenate(side) for side in zip(*pieces, strict=True))
        return X, y, labels

    def by_file(self) -> dict[str, tuple[pd.DataFrame, pd.DataFrame | pd.Series]]:
        """Return inputs and outputs of each file, for what looks at recordings one by one."""
        found = {}
        for table, survey, first in self._used:
            blocks = list(_blocks_of_file(table, survey, first, 0, False))
            X = pd.DataFrame(np.vstack([b.X for b in blocks]), columns=list(self.inputs))
            y = pd.DataFrame(np.vstack([b.y for b in blocks]), columns=list(self.outputs))
            found[table.path] = X, y if self.y_ndim == 2 else y.iloc[:, 0]
        return found

    def description(self):
        """Return names, sizes and times of change of the files; see `Record.description`."""
        return {
            "files": [[table.path, *survey.stamp] for table, survey, _ in self._used],
            "inputs": list(self.inputs),
            "outputs": list(self.outputs),
            "session": self.session,
            "columns": None if self.columns is None else list(self.columns),
        }


def open_record(X, y, sessions) -> Record | None:
    """Return what holds the samples elsewhere than in arrays, None for arrays.

    Parameters
    ----------
    X, y, sessions
        What a fit was given.

    Returns
    -------
    Record or None

    Raises
    ------
    ValueError, TypeError
        If the three do not fit together.
    """
    if isinstance(X, Record):
        if y is not None or sessions is not None:
            raise ValueError(
                f"{type(X).__name__} hold outputs and sessions too; y and sessions must be left out."
            )
        return X
    if any(hasattr(data, "__dask_graph__") for data in (X, y)):
        from narx_sklearn.identification.records.distributed import DaskRecord

        return DaskRecord(X, y, sessions)
    return None


def _survey(table: Table) -> FileSurvey | str:
    """Survey a file; what makes it unusable is returned, so that all such files can be named together."""
    try:
        return table.survey()
    except ImportError:
        raise
    except (ValueError, OSError, KeyError, TypeError, EOFError) as error:
        # parsers raise ValueErrors, codecs and compressors the others
        return f"{type(error).__name__}: {' '.join(str(error).split())}"


def _blocks_of_file(table: Table, survey: FileSurvey, first: int, reach: int, whole: bool) -> Iterator[Block]:
    """Yield the blocks of a file that is still the one that was surveyed."""
    if stamp_of(table.path) != survey.stamp:
        raise RuntimeError(f"{table.path} has changed since it was first read; start the fit again.")
    yield from table.blocks_with_past(first, reach, whole)


def _map_file(function, table, survey, first, reach, whole) -> list:
    return [function(block) for block in _blocks_of_file(table, survey, first, reach, whole)]


def _total_of_file(function, merge, table, survey, first, reach, whole):
    return running_total(function, merge, _blocks_of_file(table, survey, first, reach, whole))


def _samples_of_file(table: Table, survey: FileSurvey, first: int, run: slice) -> list[tuple]:
    """Return inputs, outputs and session labels of the samples of a run that lie in a file."""
    pieces = []
    for block in _blocks_of_file(table, survey, first, 0, False):
        a, b = max(run.start - block.first, 0), min(run.stop - block.first, block.n_own)
        if a < b:
            # numbered so that the same label in two files is still two sessions
            labels = np.zeros(b - a) if block.sessions is None else block.sessions[a:b]
            pieces.append((block.X[a:b], block.y[a:b], _tagged(labels, first)))
        if block.first + block.n_own >= run.stop:
            break
    return pieces


def _tagged(labels: np.ndarray, first: int) -> np.ndarray:
    tagged = np.empty(len(labels), dtype=object)
    tagged[:] = [(first, label) for label in labels]
    return tagged


def _listed(names) -> tuple:
    return (names,) if isinstance(names, str | int) else tuple(names)


def _labels(names: tuple) -> list | None:
    return list(names) if all(isinstance(name, str) for name in names) else None


def _found(files) -> tuple[str, ...]:
    """Return the paths, patterns resolved."""
    if isinstance(files, Mapping):
        raise TypeError("files must be a path, a pattern or a list of paths, got a mapping.")
    given = [files] if isinstance(files, str | PathLike) else list(files)
    paths: list[str] = []
    for entry in [fspath(path) for path in given]:
        matching = sorted(glob(entry)) if "*" in entry else [entry]
        if not matching:
            raise ValueError(f"No file matches {entry!r}.")
        paths += matching
    if not paths:
        raise ValueError("files is empty; give at least one file.")
    return tuple(paths)
