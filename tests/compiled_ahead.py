"""The kernels that take longest to compile, each used once: ``python compiled_ahead.py simulator``."""

import sys

import numpy as np
from small_machines import levels, make_axis

from narx_sklearn import NARXRegressor
from narx_sklearn.compensation import RootCompensator
from narx_sklearn.model import NARXModel, free_run


def simulator():
    make_axis().simulate(levels(np.random.default_rng(0), 30))


def compensator():
    model = NARXModel.from_equations("0.5*y[k-1] + u[k-1]")
    X = np.random.default_rng(0).normal(size=(100, 1))
    NARXRegressor(n_terms=2).fit(X, free_run(model, X, [0.0]).y[:, 0])
    RootCompensator(model).fit()


if __name__ == "__main__":
    {"simulator": simulator, "compensator": compensator}[sys.argv[1]]()
