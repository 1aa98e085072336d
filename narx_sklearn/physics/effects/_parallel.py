"""Elements of unequal reach side by side: gaps that share a play, bristles that share a friction."""

from narx_sklearn.physics.effects._kernel import kernel

N_PARALLEL = 4


@kernel
def reach(middle, unequal, j):
    """Return the reach of one of the elements, evenly spread about the middle; all alike at 0."""
    return middle * (1.0 + unequal * ((2.0 * j + 1.0) / N_PARALLEL - 1.0))
