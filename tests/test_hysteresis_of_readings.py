"""A reading that depends on the way of a signal of which it is made, as a voltage on that of a charge."""

import numpy as np
import pytest

from narx_sklearn.discrepancy import DiscrepancyRegressor, ODESimulator
from narx_sklearn.discrepancy.as_narx import effect_regressors
from narx_sklearn.discrepancy.findings import argument_told, parameter_units
from narx_sklearn.discrepancy.fitting.acting import signal_change
from narx_sklearn.discrepancy.search.places import placements
from narx_sklearn.discrepancy.simulators.structure import find_structure
from narx_sklearn.discrepancy.simulators.windows import cut
from narx_sklearn.physics.effects import CATALOGUE

DT, FULL = 5.0, 4.7  # s, Ah
TRUE = {"capacity [Ah]": FULL, "R0 [ohm]": 0.024, "R1 [ohm]": 0.016, "lag [s]": 50.0, "slope [V]": 0.5}
LOOP, GAMMA, START = (
    0.03,
    40.0,
    -0.3,
)  # Plett 2004, J. Power Sources 134(2), sec. 3.5: h' = -g |i| (h + sgn i) / capacity


def cell(x, u, p):
    return -u[0] / (3600.0 * p[0]), (p[2] * u[0] - x[1]) / p[3]


def voltage(x, u, p):
    return (3.4 + p[4] * x[0] - p[1] * u[0] - x[1],)


def make(factor=1.0, output=voltage):
    return ODESimulator(
        cell,
        dt=DT,
        parameters={name: factor * value for name, value in TRUE.items()},
        states=["charge", "late voltage [V]"],
        inputs=["current [A]"],
        outputs=["voltage [V]"],
        output=output,
        x0=[0.8, 0.0],
    )


def current(n, seed=1):
    u = np.repeat(np.random.default_rng(seed).uniform(-6.0, 6.0, n // 30), 30)
    return u - u.mean()


def loop_of(u, parts=20):
    """Return Plett's hysteresis at each sample, by small steps of Euler's kind."""
    h, told = START, []
    for value in u:
        told.append(LOOP * h)
        for _ in range(parts):
            h -= GAMMA * abs(value) * DT / parts / (3600.0 * FULL) * (h + np.sign(value))
    return np.array(told)


def in_reading(code, simulator):
    u = current(300)
    run = simulator.run(u[:, None], cut([(slice(0, 300), 0)], 300, 1), simulator.x0[None])
    found = placements(CATALOGUE[code], simulator, find_structure(simulator, run.x, u[:, None]))
    return [placed for placed in found if placed.port.kind == "output"]


@pytest.mark.parametrize("code", ["bouc_wen_hysteresis", "prandtl_ishlinskii"])
def test_it_is_looked_for_where_a_reading_is_made_of_several_signals(code):
    places = in_reading(code, make())
    assert [p.second_name for p in places] == ["current", "charge", "late voltage"]
    assert all(p.is_fed and p.bounds[0].tolist() == [-np.inf, np.inf] for p in places)
    assert argument_told(places[0]) == "u = current [A]"
    assert parameter_units(places[0], make())[:2] == ["V/A", "A"]
    assert in_reading(code, make(output=lambda x, u, p: (p[4] * x[0],))) == []


def test_a_loop_of_plett_is_one_of_bouc_and_wen_on_the_way_of_the_charge():
    """With r = 0 and n = 1, k = -M g and zy = 1/g of Wen are M and g of Plett."""
    placed = in_reading("bouc_wen_hysteresis", make())[1].at([-LOOP * GAMMA, 1 / GAMMA, 0.0, 1.0, START])
    u = current(1200)
    with_loop = make().with_effects([placed])
    np.testing.assert_allclose(
        with_loop.simulate(u) - make().simulate(u), loop_of(u)[:, None], atol=0.02 * LOOP
    )
    assert effect_regressors(with_loop) == ()  # no signal of the record is the charge
    windows = cut([(slice(0, u.size), 0)], u.size, 1)
    run = with_loop.run(u[:, None], windows, make().x0[None])
    rows = np.arange(u.size)
    charge, added = signal_change(placed, make().simulate(u), u[:, None], run.x, windows, rows, DT)
    np.testing.assert_array_equal(charge, run.x[:, 0])
    np.testing.assert_allclose(added, loop_of(u), atol=0.02 * LOOP)


@pytest.mark.long
def test_it_is_named_and_the_parameters_come_out_right():
    u = current(3000)
    y = make().simulate(u)[:, 0] + loop_of(u) + 0.002 * np.random.default_rng(2).standard_normal(u.size)
    dx = DiscrepancyRegressor(make(1.06), random_state=0).fit(u, y)
    assert (dx.verdict_, [f.effect for f in dx.findings_]) == ("explained", ["bouc_wen_hysteresis"])
    told = dx.findings_[0]
    assert (told.port, told.parameters["zy"]) == ("output:0", pytest.approx(1 / GAMMA, rel=0.1))
    assert -told.parameters["k"] * told.parameters["zy"] == pytest.approx(LOOP, rel=0.1)
    found = dx.parameters_["augmented"]
    assert found[1:4].tolist() == pytest.approx(list(TRUE.values())[1:4], rel=0.05)
