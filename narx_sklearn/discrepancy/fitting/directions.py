"""What parameters do together: directions in which runs change with them, and those in which they do not."""

from typing import NamedTuple

import numpy as np

ALIKE = 1e-7  # squared: directions in which difference quotients cannot tell parameters apart


class Directions(NamedTuple):
    """Orthonormal directions of parameters, each of which is scaled to do as much by itself as any other."""

    size: np.ndarray  # (n,) what each does by itself
    values: np.ndarray  # (n_directions,) squared, what is done along each direction
    vectors: np.ndarray  # (n, n_directions) zero for parameters that do nothing

    @property
    def are_silent(self) -> np.ndarray:
        """Which directions do nothing, but for the rounding of difference quotients, (n_directions,)."""
        return self.values < ALIKE * self.values.max(initial=0.0)

    @property
    def silent(self) -> np.ndarray:
        """The directions along which nothing is done, (n, n_silent)."""
        return self.vectors[:, self.are_silent]

    @property
    def inverse(self) -> np.ndarray:
        """The pseudo-inverse of the scaled Gram matrix, (n, n), silent directions left out."""
        told = self.vectors[:, ~self.are_silent]
        return (told / self.values[~self.are_silent]) @ told.T


def directions_of(gram: np.ndarray) -> Directions:
    """Return the directions of parameters from the inner products of what they do, (n, n).

    Examples
    --------
    A mass, and two parameters that do the same, the second twice as much:

    >>> import numpy as np
    >>> from narx_sklearn.discrepancy.fitting.directions import directions_of
    >>> found = directions_of(np.array([[9.0, 0.0, 0.0], [0.0, 1.0, 2.0], [0.0, 2.0, 4.0]]))
    >>> found.size.tolist(), np.abs(found.silent).round(3).tolist()
    ([3.0, 1.0, 2.0], [[0.0], [0.707], [0.707]])
    """
    size = np.sqrt(np.diag(gram))
    moved = np.flatnonzero(size)
    values, own = np.linalg.eigh(gram[np.ix_(moved, moved)] / np.outer(size[moved], size[moved]))
    vectors = np.zeros((size.size, moved.size))
    vectors[moved] = own
    return Directions(size, values, vectors)
