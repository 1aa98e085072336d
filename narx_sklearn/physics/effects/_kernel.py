"""How the effects' kernels are compiled."""

from numba import njit

kernel = njit(nogil=True, cache=True, error_model="numpy")
"""Lazily compiled, kept on disk, without the interpreter; a division by zero gives infinity, not an error."""
