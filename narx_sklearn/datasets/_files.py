"""Find, download, read and verify one file of a public data set."""

import hashlib
import os
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from urllib.parse import quote

import numpy as np
import pandas as pd

__all__ = ["DATA_VARIABLE", "DataFile", "PathLike", "check_choice", "content_sha256", "load_file", "rows"]

PathLike = str | os.PathLike | None
DATA_VARIABLE = "NARX_SKLEARN_DATA"


@dataclass(frozen=True)
class DataFile:
    """One record of a data set: where it comes from, what it must hold.

    Attributes
    ----------
    dataset, part : str
        A local copy is ``<dataset>/<dataset>_<part>.csv.gz`` in the data folder.
    n_samples : int
        Rows.
    sha256 : str
        Checksum of the content, see `content_sha256`.
    columns : mapping of str to int
        Columns in order, each with the significant digits to which its content is compared.
    origin : tuple of str
        Public GitHub repository and the commit that is downloaded.
    paths : tuple of str
        Files of the repository that the record is made from.
    read : callable
        ``read(files)`` returns the columns, in order, as an array of shape (n_samples, n_columns).
    """

    dataset: str
    part: str
    n_samples: int
    sha256: str
    columns: Mapping[str, int]
    origin: tuple[str, str]
    paths: tuple[str, ...]
    read: Callable[[list[Path]], np.ndarray]

    @property
    def urls(self) -> tuple[str, ...]:
        """Addresses of the original files."""
        repository, commit = self.origin
        base = f"https://raw.githubusercontent.com/{repository}/{commit}/"
        return tuple(base + quote(path) for path in self.paths)

    @property
    def title(self) -> str:
        """Data set and part, for messages."""
        return f"{self.dataset}/{self.part}"

    @property
    def local_name(self) -> str:
        """Path of a local copy inside the folder of NARX_SKLEARN_DATA."""
        return f"{self.dataset}/{self.dataset}_{self.part}.csv.gz"


def load_file(file: DataFile, data_home: PathLike = None) -> pd.DataFrame:
    """Read one record and verify its content.

    The folder named by the environment variable NARX_SKLEARN_DATA is read if it is set; otherwise the
    original files are downloaded once, with pooch, and kept.

    Parameters
    ----------
    file : DataFile
        The record.
    data_home : path-like or None, default=None
        Where downloads are kept. None is the cache folder of the operating system,
        ``pooch.os_cache("narx_sklearn")``.

    Returns
    -------
    frame : DataFrame of shape (n_samples, n_columns)

    Raises
    ------
    FileNotFoundError
        If NARX_SKLEARN_DATA is set and the record is not in that folder.
    ImportError
        If a download is needed and pooch is not installed.
    ConnectionError
        If the original files cannot be downloaded.
    ValueError
        If the content is not the one this package knows.
    """
    folder = os.environ.get(DATA_VARIABLE)
    if folder:
        sources = [Path(folder) / file.local_name]
        frame = _read_local_copy(file, sources[0])
    else:
        sources = _download(file, data_home)
        frame = _read_original(file, sources)
    _verify(frame, file, sources)
    return frame


def content_sha256(frame: pd.DataFrame, digits: Mapping[str, int]) -> str:
    """Return the checksum of the numbers in a frame, whatever file they came from.

    Every number is printed with the significant digits of its column, one a line, column after column, and
    the text is hashed. The digits are those of the copy that the checksum was computed from, so the original
    in full precision and the printed copy give one and the same text: rounding to fewer digits than printed
    would round some numbers twice, and differently.

    Parameters
    ----------
    frame : DataFrame of shape (n_samples, n_columns)
    digits : mapping of str to int
        Significant digits of each column; also the order of the columns.

    Returns
    -------
    sha256 : str
    """
    digest = hashlib.sha256()
    for column, n_digits in digits.items():
        values = frame[column].to_numpy(dtype=float) + 0.0  # + 0.0 turns -0.0 into 0.0
        text = (f"%.{n_digits}g\n" * len(values)) % tuple(values.tolist())
        digest.update(f"{column}\n{text}".encode())
    return digest.hexdigest()


def _verify(frame: pd.DataFrame, file: DataFile, sources: list[Path]) -> None:
    """Refuse a content that is not the known one."""
    found = content_sha256(frame, file.columns)
    if len(frame) != file.n_samples or found != file.sha256:
        raise ValueError(
            f"The content of {file.title} is not the known one: expected {file.n_samples} samples with "
            f"checksum {file.sha256}, got {len(frame)} samples with checksum {found}. The numbers were read "
            f"from {_listed(sources)}. Delete what was read and fetch it again, or replace it by the "
            f"original from {_listed(file.urls)}."
        )


def _read_local_copy(file: DataFile, path: Path) -> pd.DataFrame:
    """Read the columns of the record from a gzipped CSV."""
    columns = list(file.columns)
    if not path.is_file():
        raise FileNotFoundError(
            f"{path} does not exist; {DATA_VARIABLE} asks for it. Put {file.local_name} into that folder "
            f"(gzipped CSV with the columns {_listed(columns)}), or unset {DATA_VARIABLE} to download the "
            "original."
        )
    try:
        return pd.read_csv(path, usecols=columns)[columns].astype(float)
    except (ValueError, OSError) as error:
        raise ValueError(
            f"{path} cannot be read as {file.title}, a gzipped CSV with the columns {_listed(columns)} "
            f"({error}). Replace it, or unset {DATA_VARIABLE} to download the original."
        ) from error


def _download(file: DataFile, data_home: PathLike) -> list[Path]:
    """Return the original files, from the data home or from their public repository."""
    try:
        import pooch
    except ImportError as error:
        raise ImportError(
            f'Downloading {file.title} needs pooch: pip install "narx-sklearn[data]". '
            f"Or set {DATA_VARIABLE} to a folder that holds {file.local_name}."
        ) from error
    home = Path(pooch.os_cache("narx_sklearn") if data_home is None else data_home).expanduser()
    sources = []
    for url, path in zip(file.urls, file.paths, strict=True):
        try:
            # No checksum of the original bytes is known; `_verify` checks the numbers instead.
            local = pooch.retrieve(url, known_hash=None, fname=Path(path).name, path=home / file.dataset)
        except (OSError, ValueError) as error:
            raise ConnectionError(
                f"Could not download {url} for {file.title} ({error}). On a machine without network, set "
                f"{DATA_VARIABLE} to a folder that holds {file.local_name} "
                f"(gzipped CSV with the columns {', '.join(file.columns)})."
            ) from error
        sources.append(Path(local))
    return sources


def _read_original(file: DataFile, sources: list[Path]) -> pd.DataFrame:
    """Turn the original files into the columns of the record."""
    advice = f"Delete {_listed(sources)} and fetch it again."
    try:
        values = file.read(sources)
    except (KeyError, ValueError, OSError) as error:
        raise ValueError(
            f"What was downloaded for {file.title} cannot be read ({error}). {advice}"
        ) from error
    if values.shape[1] != len(file.columns):
        raise ValueError(
            f"What was downloaded for {file.title} has {values.shape[1]} columns, but {len(file.columns)} "
            f"are wanted ({', '.join(file.columns)}). {advice}"
        )
    return pd.DataFrame(values, columns=list(file.columns))


def rows(frame: pd.DataFrame, start: int, stop: int) -> pd.DataFrame:
    """Cut rows ``start`` to ``stop``, numbered from zero."""
    return frame.iloc[start:stop].reset_index(drop=True)


def check_choice(name: str, value: str, choices: Iterable[str]) -> None:
    """Refuse a value that is not among the choices."""
    if value not in (choices := list(choices)):
        raise ValueError(f"{name} is {value!r}, but must be one of {', '.join(map(repr, choices))}.")


def _listed(items: Iterable[object]) -> str:
    return ", ".join(str(item) for item in items)


# Readers of original formats. Each factory returns a `read` for DataFile.


def read_mat(*variables: str) -> Callable[[list[Path]], np.ndarray]:
    """Read named variables of MATLAB files, samples along the longer axis."""

    def read(files: list[Path]) -> np.ndarray:
        content = _mat_content(files)
        return np.hstack([_samples_first(content[name]) for name in variables])

    return read


def read_hdf5(*datasets: str) -> Callable[[list[Path]], np.ndarray]:
    """Read named data sets of one HDF5 file, samples along the longer axis."""

    def read(files: list[Path]) -> np.ndarray:
        try:
            import h5py
        except ImportError as error:
            raise ImportError(f"Reading {files[0].name} needs h5py: pip install h5py.") from error
        with h5py.File(files[0], "r") as content:
            return np.hstack([_samples_first(np.asarray(content[name])) for name in datasets])

    return read


def read_csv(*columns: str) -> Callable[[list[Path]], np.ndarray]:
    """Read named columns of one CSV file."""

    def read(files: list[Path]) -> np.ndarray:
        frame = pd.read_csv(files[0], usecols=list(columns))
        return frame[list(columns)].to_numpy(dtype=float)

    return read


def read_single_columns(files: list[Path]) -> np.ndarray:
    """Read CSV files of one column each, with or without a line of heading."""
    columns = []
    for file in files:
        text = pd.read_csv(file, header=None, dtype=str).iloc[:, 0]
        values = pd.to_numeric(text, errors="coerce")
        columns.append(values[1:] if np.isnan(values.iloc[0]) else values)
    return np.column_stack(columns)


def read_loops(files: list[Path]) -> np.ndarray:
    """Read closed B(H) loops, one a column of the MATLAB matrices HmeasT and BmeasT; number them from 1."""
    content = _mat_content(files)
    field, flux = np.atleast_2d(content["HmeasT"]), np.atleast_2d(content["BmeasT"])
    loop = np.broadcast_to(np.arange(1, field.shape[1] + 1), field.shape)
    return np.column_stack([a.ravel(order="F") for a in (loop, field, flux)]).astype(float)


def _mat_content(files: list[Path]) -> dict[str, np.ndarray]:
    from scipy.io import loadmat  # here, because it is slow to import

    content: dict[str, np.ndarray] = {}
    for file in files:
        content.update(loadmat(file))
    return content


def _samples_first(values: np.ndarray) -> np.ndarray:
    values = np.atleast_2d(np.squeeze(np.asarray(values, dtype=float)))
    return values.T if values.shape[0] < values.shape[1] else values
