"""Section 5.2.1: Table 5.1's models reproduce Table 5.2, and ours are better on the same sine."""

import numpy as np
import pytest
from thesis_models import M_I, M_INVERSE, M_R

from narx_sklearn import NARXRegressor
from narx_sklearn.metrics import mape
from narx_sklearn.model import Difference, DifferenceSign, free_run
from narx_sklearn.physics import PIEZO_BENCH
from narx_sklearn.signals import prfs

SINE = 40 * np.sin(2 * np.pi * np.arange(5000) / 1000)  # five periods of 1 Hz, sampled at 1 ms
OUTPUT = PIEZO_BENCH.run(SINE)


@pytest.mark.parametrize(
    ("model", "u", "y", "printed"),
    [
        (M_R, SINE, OUTPUT, 0.2309),
        (M_I, SINE, OUTPUT, 0.2523),
        (M_INVERSE, OUTPUT, SINE, 0.3753),
    ],
    ids=["M_R", "M_I", "inverse"],
)
def test_published_parameters_reproduce_table_5_2_within_their_printed_digits(model, u, y, printed):
    # Moving each parameter within half a unit of its last printed digit moves the error of M_R between 0.221
    # and 0.251, of M_I between 0.224 and 0.256 and of the inverse between 0.371 and 0.411, so two digits of
    # Table 5.2 are all that Table 5.1 can give back.
    error = mape(y, free_run(model, u[:, None], y[:, None]).y[:, 0])
    assert error == pytest.approx(printed, abs=0.017)


@pytest.mark.parametrize(("inverse", "goal"), [(False, 0.15), (True, 0.25)], ids=["direct", "inverse"])
def test_nine_terms_searched_as_rate_independent_beat_table_5_2(inverse, goal):
    u = prfs(50_000, 1.0, 0.001, amplitudes=80.0, random_state=0)
    y = PIEZO_BENCH.run(u)
    (u, y), (v, z) = ((y, u), (OUTPUT, SINE)) if inverse else ((u, y), (SINE, OUTPUT))
    narx = NARXRegressor(
        1, [0], phi=(Difference("u"), DifferenceSign("u")), phi_lags=[0], degree=5, n_terms=9, refine=True,
        structure="rate_independent", constraints="continuum", fit_intercept=False,
    ).fit(u[:, None], y)  # fmt: skip
    assert len(narx.terms_) == 9
    assert narx.continuum_.holds
    assert mape(z, narx.predict(v[:, None], y_init=z)) < goal
