"""The compressed record: the triangular factor of [Psi, Y], all that selection and estimation need.

R has the inner products of the tall regressor matrix without squaring its condition number. Factors of
parts of a record merge, column subsets and column combinations of R are factors again; so every model
size, criterion, fold and constraint is worked out on R, whatever the number of samples was.
"""

import json
import os
import zipfile
import zlib
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.linalg import blas, lapack, qr

from narx_sklearn.identification.one_step.regressors import Candidates

__all__ = ["Checkpoint", "Factor", "compress"]

FILE_FORMAT = 1  # of saved factors; a change of what is stored raises it

PANEL_COLUMNS = 32  # width of LAPACK's panels: wide enough for matrix products, narrow enough for the cache
SAMPLE_ROWS = 4  # a multiple of the columns: rows whose factor conditions the others
# Share of a conditioned column's length orthogonal to all others above which its inner products lose no more
# than three of their sixteen digits.
WELL_CONDITIONED = 0.03


@dataclass(frozen=True, eq=False)
class Factor:
    """Upper triangular R with R'R = [Psi, Y]'[Psi, Y].

    Attributes
    ----------
    R : ndarray of shape (n_rows, n_terms + n_outputs)
        The factor; the outputs are its last columns. Its diagonal is not negative.
    n_outputs : int
        Number of outputs.
    n_samples : int
        Number of samples it stands for.
    """

    R: np.ndarray
    n_outputs: int
    n_samples: int

    @property
    def n_terms(self) -> int:
        """Number of regressors."""
        return self.R.shape[1] - self.n_outputs

    @property
    def Psi(self) -> np.ndarray:  # noqa: N802 - the field's symbol
        """The regressors' columns of R."""
        return self.R[:, : self.n_terms]

    def target(self, output: int = 0) -> np.ndarray:
        """Return the column of R that belongs to an output."""
        return self.R[:, self.n_terms + output]

    @classmethod
    def of(cls, Psi: np.ndarray, Y: np.ndarray) -> "Factor":
        """Compress a regressor matrix, shape (n_samples, n_terms), and outputs."""
        Y = Y.reshape(Psi.shape[0], -1)
        return cls(_triangle(np.column_stack([Psi, Y])), Y.shape[1], Psi.shape[0])

    @classmethod
    def empty(cls, n_terms: int, n_outputs: int) -> "Factor":
        """Return the factor of no samples."""
        return cls(np.zeros((0, n_terms + n_outputs)), n_outputs, 0)

    def merge(self, other: "Factor") -> "Factor":
        """Return the factor of both records together."""
        if self.R.shape[1] != other.R.shape[1] or self.n_outputs != other.n_outputs:
            raise ValueError(
                f"Factors of {self.n_terms} and {other.n_terms} regressors cannot be merged; both must come "
                "from the same candidate terms."
            )
        n_samples = self.n_samples + other.n_samples
        return Factor(_triangle(np.vstack([self.R, other.R])), self.n_outputs, n_samples)

    def scaled(self, weight: float) -> "Factor":
        """Return the factor with every squared sum multiplied by ``weight``, as forgetting does.

        It then stands for as many samples as their weights add up to.
        """
        return Factor(self.R * np.sqrt(weight), self.n_outputs, round(self.n_samples * weight))

    def combine(self, T: np.ndarray) -> "Factor":
        """Return the factor of [Psi, Y] T for a square or tall matrix of column combinations."""
        return Factor(_triangle(self.R @ T), self.n_outputs, self.n_samples)

    def subset(self, columns: Iterable[int]) -> "Factor":
        """Return the factor of some regressors (and all outputs)."""
        chosen = [*columns, *range(self.n_terms, self.R.shape[1])]
        return Factor(_triangle(self.R[:, chosen]), self.n_outputs, self.n_samples)

    def save(self, path, settings: Mapping | None = None) -> None:
        """Write the factor to a file, with what it was made with.

        The file appears under its name when it is complete, so that an interruption leaves none or all of it.

        Parameters
        ----------
        path : str or path-like
            Where to write.
        settings : mapping, default=None
            Texts, numbers, lists of them: candidate terms, origin, whatever another factor must share.

        See Also
        --------
        Factor.load : Read it back, refused where the settings differ.
        """
        path = Path(path)
        text = json.dumps({"format": FILE_FORMAT, "settings": dict(settings or {})})
        unfinished = path.with_name(f"{path.name}.{os.getpid()}.part")
        try:
            with open(unfinished, "wb") as file:
                counts = np.array([self.n_outputs, self.n_samples])
                np.savez(file, R=self.R, counts=counts, about=np.array(text))
            unfinished.replace(path)
        finally:
            unfinished.unlink(missing_ok=True)

    @classmethod
    def load(cls, path, settings: Mapping | None = None) -> "Factor":
        """Read a factor that `save` wrote.

        Parameters
        ----------
        path : str or path-like
            The file.
        settings : mapping, default=None
            What the factor must have been made with; None takes any.

        Returns
        -------
        Factor

        Raises
        ------
        ValueError
            If the file is not a complete saved factor, or its settings differ.
        """
        try:
            with open(path, "rb") as file, np.load(file, allow_pickle=False) as stored:
                about = json.loads(str(stored["about"]))
                n_outputs, n_samples = (int(n) for n in stored["counts"])
                factor = cls(stored["R"], n_outputs, n_samples)
        except (ValueError, KeyError, EOFError, zipfile.BadZipFile, zlib.error) as error:
            raise ValueError(
                f"{path} is not a complete saved factor ({error}). Remove it to compute it anew."
            ) from error
        if about.get("format") != FILE_FORMAT:
            raise ValueError(
                f"{path} has format {about.get('format')!r}, this version reads {FILE_FORMAT}. Remove it to "
                "compute it anew."
            )
        if settings is not None:
            _refuse_others(path, about["settings"], json.loads(json.dumps(dict(settings))))
        return factor

    def sum_of_squares(self, output: int = 0) -> float:
        """Return y'y of an output."""
        column = self.target(output)
        return float(column @ column)


def _refuse_others(path, stored: dict, wanted: dict) -> None:
    """Raise a ValueError that names the settings in which a saved factor differs from what is wanted."""
    differing = _differences(stored, wanted)
    if differing:
        shown = "; ".join(f"{name} was {_shortened(a)}, is {_shortened(b)}" for name, a, b in differing)
        raise ValueError(
            f"{path} was saved with other settings: {shown}. Go on with the settings it was saved with, or "
            "choose another place."
        )


def _differences(stored: dict, wanted: dict) -> list[tuple]:
    """Return name and both values of the settings that differ, looking into those that are mappings."""
    found = []
    for name in sorted(stored.keys() | wanted.keys()):
        a, b = stored.get(name), wanted.get(name)
        if isinstance(a, dict) and isinstance(b, dict):
            found += [(f"{name} {inner}", *values) for inner, *values in _differences(a, b)]
        elif a != b:
            found.append((name, a, b))
    return found


def _shortened(value, length: int = 80) -> str:
    text = repr(value)
    return text if len(text) <= length else f"{text[: length - 3]}..."


@dataclass(frozen=True)
class Checkpoint:
    """A folder in which a long pass over a record leaves the factors of its groups of blocks.

    A pass that was interrupted takes from it what is there, and computes the rest.

    Attributes
    ----------
    folder : path-like
        Made when it is first needed.
    stage : str
        Which pass of a fit.
    settings : dict
        What all of them are made with.
    """

    folder: str | os.PathLike
    stage: str
    settings: dict

    def load(self, group: int) -> Factor | None:
        """Return the factor of a group of blocks, None if it is not there yet."""
        path = self._path(group)
        return Factor.load(path, self.settings) if path.exists() else None

    def save(self, group: int, factor: Factor) -> None:
        """Keep the factor of a group of blocks."""
        path = self._path(group)
        path.parent.mkdir(parents=True, exist_ok=True)
        factor.save(path, self.settings)

    def _path(self, group: int) -> Path:
        return Path(self.folder) / f"{self.stage}-{group:06d}.npz"


def compress(parts: Iterable[Candidates]) -> Factor:
    """Compress candidates to their factor, one pass over the data.

    Parameters
    ----------
    parts : iterable of Candidates
        The same terms on one or more recordings or pieces of a recording.

    Returns
    -------
    Factor

    """
    total: Factor | None = None
    for part in parts:
        factor = _compress_part(part)
        total = factor if total is None else total.merge(factor)
    if total is None:
        raise ValueError("There are no data to compress.")
    return total


def _compress_part(part: Candidates) -> Factor:
    """Compress one piece: by inner products conditioned by a sample of its rows, else by reflections.

    With R0 the factor of rows taken evenly from the piece, Q = P R0^-1 has nearly orthogonal columns
    whatever the condition of P, and R = chol(Q'Q) R0 is as accurate as reflecting all of P, in half the time.
    The outcome tells whether the sample was like the whole.
    """
    size = max(2 * part.n_columns, 512)
    step = part.n_rows // max(SAMPLE_ROWS * part.n_columns, size)
    R = _accumulate(part, size, _reflect(part.every(step), size)) if step > 1 else None
    if R is None:
        R = _reflect(part, size)
    return Factor(_positive(R), len(part.layout.outputs), part.n_rows)


def _reflect(part: Candidates, size: int) -> np.ndarray:
    """Return the factor by Householder reflections on [R; block], block after block."""
    R = np.zeros((part.n_columns, part.n_columns), order="F")
    nb = min(PANEL_COLUMNS, part.n_columns)
    for block in part.blocks(size):
        # R stays triangular, the rows of the block vanish
        rows = np.asfortranarray(block.T)
        R, _, _, info = lapack.dtpqrt(0, nb, R, rows, overwrite_a=1, overwrite_b=1)
        if info != 0:  # pragma: no cover - LAPACK reports illegal arguments only
            raise RuntimeError(f"LAPACK tpqrt failed with info={info}.")
    return np.triu(R)


def _accumulate(part: Candidates, size: int, R0: np.ndarray) -> np.ndarray | None:
    """Return the factor from inner products conditioned by ``R0``, None if that is not good enough."""
    if not np.diag(R0).all():
        return None
    R0 = np.asfortranarray(R0)
    gram = np.zeros(R0.shape, order="F")
    for block in part.blocks(size):
        Q = blas.dtrsm(1.0, R0, np.asfortranarray(block.T), side=1, overwrite_b=1)
        gram = blas.dsyrk(1.0, Q, beta=1.0, c=gram, trans=1, overwrite_c=1)
    S, info = lapack.dpotrf(gram, clean=1)
    if info != 0 or not tolerances(S).min() > WELL_CONDITIONED:
        return None
    return blas.dtrmm(1.0, S, R0)


def tolerances(R: np.ndarray) -> np.ndarray:
    """Return the share of each column's length that is orthogonal to all other columns.

    One over its square is the variance inflation factor.

    Parameters
    ----------
    R : ndarray of shape (n_columns, n_columns)
        Triangular factor.

    Returns
    -------
    ndarray of shape (n_columns,)
        Between 0 (a combination of the others) and 1 (orthogonal to them); 0 everywhere for a singular
        factor.

    Examples
    --------
    >>> import numpy as np
    >>> from narx_sklearn.identification.one_step.factor import tolerances
    >>> tolerances(np.array([[3.0, 0.0, 4.0], [0.0, 2.0, 0.0], [0.0, 0.0, 3.0]])).round(2).tolist()
    [0.6, 1.0, 0.6]
    """
    norms = np.linalg.norm(R, axis=0)
    if not np.isfinite(norms).all() or not np.diag(R).all():
        return np.zeros(R.shape[1])
    # row j of the inverse is the dual of column j: its part orthogonal to the others, over its square
    inverse, _ = lapack.dtrtri(R / norms)
    return 1.0 / np.linalg.norm(inverse, axis=1)


def _triangle(rows: np.ndarray) -> np.ndarray:
    """Return the triangular factor of a few rows."""
    if rows.shape[0] == 0:
        return rows
    (R,) = qr(rows, mode="r", check_finite=False)
    return _positive(R[: min(R.shape)])


def _positive(R: np.ndarray) -> np.ndarray:
    """Make the diagonal not negative, so that equal records have equal factors."""
    signs = np.where(np.diag(R) < 0, -1.0, 1.0)
    return np.ascontiguousarray(R * signs[:, None])
