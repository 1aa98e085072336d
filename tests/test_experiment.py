"""The experiment that separates rivals: where it begins, and how far it goes."""

import numpy as np
import pytest

from narx_sklearn.discrepancy import ODESimulator
from narx_sklearn.discrepancy.experiment import BEYOND_DOUBT, _settled, design_experiment, middle_of
from narx_sklearn.discrepancy.noise import Noise


def tank(power):
    def level(x, u, p):
        return (p[0] * u[0] - p[1] * max(x[0], 0.0) ** power,)

    return ODESimulator(
        level,
        dt=0.5,
        parameters={"gain": 0.2, "outlet": 0.4},
        states=["level [m]"],
        inputs=["pump [V]"],
    )


def cart():
    return ODESimulator(
        lambda x, u, p: (x[1], p[0] * u[0] - p[1] * x[1]),
        dt=0.02,
        parameters={"gain": 2.0, "damping": 1.0},
        states=["position", "velocity"],
        inputs=["drive"],
    )


@pytest.mark.filterwarnings("ignore:.*compile")
@pytest.mark.parametrize("power", [0.5, 1.0])
def test_an_experiment_begins_where_the_simulation_rests(power):
    rest = (0.2 * 4.0 / 0.4) ** (1 / power)
    assert _settled(tank(power), np.array([4.0]), 1000) == pytest.approx([rest], rel=1e-3)


def test_what_runs_away_or_does_not_settle_in_time_begins_at_zero():
    assert _settled(cart(), np.array([1.0]), 1000).tolist() == [0.0, 0.0]
    assert _settled(tank(0.5), np.array([4.0]), 8).tolist() == [0.0]


@pytest.mark.filterwarnings("ignore:.*compile")
def test_designs_are_as_fast_as_the_machine_is_about_the_middle_of_the_input():
    """An outlet by the root of the level is infinitely fast where it is empty, and is nowhere else."""
    noise = Noise.white(np.array([0.01]))
    plan = design_experiment(
        {"root": tank(0.5), "linear": tank(1.0)}, noise=noise, amplitude=1.0, n_samples=1000, offset=4.0
    )
    tops = [float(words.split()[3]) for words in plan.table["design"] if words.startswith("multisine up")]
    corner = 0.4 / (2 * 2.0) / (2 * np.pi)  # k / (2 sqrt(4 m)), about 4 V
    assert max(tops) == pytest.approx(10 * corner, rel=0.01)
    assert np.all(np.abs(plan.u - 4.0) <= 1.0 + 1e-9)
    assert plan.separation > 10


@pytest.mark.filterwarnings("ignore:.*compile")
def test_beyond_doubt_the_input_that_tells_most_of_everything_is_proposed():
    noise = Noise.white(np.array([1e-3]))
    rivals = {"root": tank(0.5), "linear": tank(1.0)}
    plan = design_experiment(rivals, noise=noise, amplitude=3.0, n_samples=1000, offset=4.0)
    certain = plan.table[plan.table["separation"] > BEYOND_DOUBT]
    assert len(certain) > 1
    chosen = plan.table.set_index("design").loc[plan.kind]
    assert chosen["information"] == certain["information"].max()
    assert plan.separation == chosen["separation"]


def test_the_middle_of_an_input_is_zero_where_it_was_meant_to_be():
    u = np.array([[-1.0, 2.0], [1.1, 8.0], [np.nan, np.nan]])
    assert middle_of(u).tolist() == [0.0, 5.0]
