"""What a correction does to held-out samples."""

import numpy as np
import pytest

from narx_sklearn.discrepancy.simulators.simulator import Windows
from narx_sklearn.discrepancy.verify import BLOCKS, HeldOut

N = 800


def held_out(left_before, left_after) -> HeldOut:
    """Return what two simulators leave, whitened residuals (n,)."""

    def by_block(values):
        return np.array([block.sum() for block in np.array_split(values, BLOCKS)])

    less = by_block(left_before**2 - left_after**2)
    changed = by_block((left_before - left_after) ** 2)
    windows = Windows.whole([slice(0, N)])
    return HeldOut(less, changed, np.mean(left_before**2), np.mean(left_after**2), windows, np.zeros((1, 1)))


class TestIsBelied:
    def test_what_is_right_rarely_is(self):
        rng = np.random.default_rng(0)
        change = 0.15 * rng.normal(size=N)  # four standard errors
        told = [held_out(e + change, e).is_belied(1.0) for e in rng.normal(size=(300, N))]
        assert sum(told) <= 3

    def test_what_goes_the_wrong_way_is(self):
        rng = np.random.default_rng(1)
        change = 0.15 * rng.normal(size=N)
        told = [held_out(e, e + change).is_belied(1.0) for e in rng.normal(size=(100, N))]
        assert sum(told) >= 90

    @pytest.mark.parametrize("share", [0.6, 1.0, 1.4])
    def test_a_form_that_is_somewhat_off_is_not(self, share):
        rng = np.random.default_rng(2)
        change, e = rng.normal(size=N), rng.normal(size=N)
        assert not held_out(e + change, e + (1.0 - share) * change).is_belied(1.0)

    def test_what_changes_nothing_is_not(self):
        e = np.random.default_rng(3).normal(size=N)
        assert not held_out(e, e).is_belied(1.0)
        assert held_out(e, e).is_silent(1.0)
        assert not held_out(e, e + 0.1).is_silent(1.0)  # by eight noise variances

    def test_a_run_that_is_lost_tells_nothing(self):
        """It is another matter that such a run does harm."""
        e = np.ones(N)
        assert not held_out(e, np.full(N, np.inf)).is_belied(1.0)
