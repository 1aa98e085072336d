"""Information criteria: each penalty by hand, and the global minimum."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from narx_sklearn.identification import CRITERIA, SelectionPath, information_criterion


def test_penalties_by_hand():
    """N = 100, n = 3, M = 10, sigma^2 = 0.1: N ln(sigma^2) = -230.2585, and C(10, 3) = 120."""
    by_hand = {
        "aic": 6.0,
        "aicc": 600.0 / 96.0,
        "bic": 3.0 * np.log(100.0),
        "ebic": 3.0 * np.log(100.0) + 2.0 * np.log(120.0),
        "fpe": 100.0 * np.log(103.0 / 97.0),
        "lilc": 6.0 * np.log(np.log(100.0)),
        "khundrin": 6.0 * np.log(np.log(100.0)),
    }
    assert by_hand.keys() == CRITERIA.keys()
    for name, penalty in by_hand.items():
        value = information_criterion(name, 10.0, 100, 3, n_candidates=10)
        assert value == pytest.approx(100.0 * np.log(0.1) + penalty, abs=1e-10), name


def test_fpe_and_aicc_are_aic_for_long_records():
    values = [information_criterion(name, 1.0, 10**7, 5) for name in ("aic", "aicc", "fpe")]
    np.testing.assert_allclose(values, values[0], atol=1e-4)


@pytest.mark.parametrize("name", ["aicc", "fpe"])
def test_more_parameters_than_samples_are_never_worth_it(name):
    assert information_criterion(name, 1.0, 5, [4, 5, 6])[1:].tolist() == [np.inf, np.inf]


@given(st.sampled_from(sorted(CRITERIA)), st.floats(1e-9, 1e9), st.integers(0, 8))
def test_units_of_the_residual_shift_all_sizes_alike(name, unit, n):
    rss = np.array([2.0, 1.0])
    values = information_criterion(name, rss, 50, [n, n + 1], n_candidates=20)
    scaled = information_criterion(name, unit * rss, 50, [n, n + 1], n_candidates=20)
    assert np.diff(scaled) == pytest.approx(np.diff(values), abs=1e-9)


def test_the_minimum_is_global_where_aic_rises_first():
    """Two terms that only serve together: the criterion rises at size 2 and falls below its start at 3."""
    rss = np.array([100.0, 50.0, 49.9, 10.0, 9.95])
    supports = ((), (0,), (0, 1), (0, 1, 2), (0, 1, 2, 3))
    path = SelectionPath(supports, rss, total=rss[0], n_samples=60, n_candidates=4)
    values = path.criterion("aic")
    assert values[2] > values[1] > values[3]
    assert path.best_size("aic") == 3


def test_unknown_criterion_lists_the_choices():
    with pytest.raises(ValueError, match=r"criterion='aci' is not known; choose one of 'aic', 'aicc'"):
        information_criterion("aci", 1.0, 10, 1)


def test_ebic_needs_the_number_of_candidates():
    with pytest.raises(ValueError, match="needs n_candidates"):
        information_criterion("ebic", 1.0, 10, 1)
