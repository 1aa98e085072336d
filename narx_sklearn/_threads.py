"""Threads of the linear algebra library."""

from functools import cache

from threadpoolctl import ThreadpoolController


@cache
def _controller() -> ThreadpoolController:
    return ThreadpoolController()  # looks the loaded libraries up, which takes milliseconds: once


def single_threaded_blas():
    """Return a context in which BLAS and LAPACK use one thread.

    The matrices of an identification are small; threads of their own cost more than they bring, and much
    more where joblib already runs one process a core.
    """
    return _controller().limit(limits=1)
