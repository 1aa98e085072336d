"""Twins in continuous time: stores that drain by a power of their level, found from a trace."""

import numpy as np
import pandas as pd
import pytest

from narx_sklearn import DiscrepancyRegressor, ODESimulator
from narx_sklearn.discrepancy import TraceSimulator
from narx_sklearn.discrepancy.surrogates.stores import StoresSimulator


def drain(level, power):
    return max(level, 0.0) ** power


def row(powers, *, steady=0.0, hold="zero", rhs=None):
    """One or two stores, simulated by steps ten times as fine as the twin's."""

    def stores(x, u, p):
        flow, rates = p[0] * u[0] + steady, []
        for i, power in enumerate(powers):
            out = p[1 + i] * drain(x[i], power)
            rates.append(flow - out)
            flow = out
        return tuple(rates)

    values = {"gain": 0.05, "outlet 1": 0.06, "outlet 2": 0.05}
    return ODESimulator(
        rhs or stores,
        dt=2.0,
        parameters=dict(list(values.items())[: 1 + len(powers)]),
        states=["upper [cm]", "lower [cm]"][-len(powers) :],
        outputs=["lower [cm]"],
        inputs=["pump [V]"],
        hold=hold,
        substeps=10,
    )


def pumped(n=1500, seed=0):
    return pd.DataFrame({"pump [V]": np.repeat(np.random.default_rng(seed).uniform(1.0, 5.0, n // 25), 25)})


@pytest.mark.filterwarnings("ignore:.*compile")
@pytest.mark.parametrize("hold", ["zero", "linear"])
@pytest.mark.parametrize("powers", [(0.5, 0.5), (1.0, 0.5), (0.5, 1.5)])
def test_two_stores_of_which_one_is_seen_stand_behind_a_trace(powers, hold):
    u = pumped()
    trace = TraceSimulator(row(powers, hold=hold).simulate(u)["lower [cm]"], u, dt=2.0)
    twin = trace.twin_
    assert isinstance(twin, StoresSimulator)
    assert trace.twin_error_ < 1e-4
    assert twin.powers == powers
    assert twin.linear_hold == (hold == "linear")
    assert [str(state) for state in twin.states] == ["lower before [cm]", "lower [cm]"]
    assert twin.nominal == pytest.approx([0.05, 0.06, 0.05], rel=1e-2)
    units = {0.5: "cm^0.5/s", 1.0: "1/s", 1.5: "1/s/cm^0.5"}
    assert {p.name: p.unit for p in twin.parameters} == {
        "pump": "cm/s/V",
        "drain of lower before": units[powers[0]],
        "drain of lower": units[powers[1]],
    }


@pytest.mark.filterwarnings("ignore:.*compile")
def test_a_body_that_radiates_is_one_store_with_a_steady_inflow():
    """From theta' = b u + c - k theta^4, in hundreds of kelvins."""

    def radiating(x, u, p):
        return (p[0] * u[0] + 0.04 - p[1] * drain(x[0], 4.0),)

    sim = ODESimulator(
        radiating,
        dt=2.0,
        parameters={"gain": 0.02, "radiation": 1e-3},
        states=["theta"],
        inputs=["heater"],
    )
    u = pumped()
    twin = TraceSimulator(sim.simulate(u)["theta"], u, dt=2.0).twin_
    assert twin.powers == (4.0,)
    assert {p.name: p.value for p in twin.parameters} == pytest.approx(
        {"pump": 0.02, "1": 0.04, "drain of theta": 1e-3}, rel=1e-3
    )
    assert "StoresSimulator of 1" in repr(twin)


@pytest.mark.filterwarnings("ignore:.*compile")
def test_an_odd_power_stays_as_it_was_found():
    u = pumped()
    twin = TraceSimulator(row((0.8,)).simulate(u)["lower [cm]"], u, dt=2.0).twin_
    assert twin.powers == pytest.approx((0.8,), rel=1e-3)
    assert {p.name: p.value for p in twin.parameters}["drain of lower"] == pytest.approx(0.06, rel=1e-2)


@pytest.mark.filterwarnings("ignore:.*compile")
def test_what_goes_below_zero_is_no_store():
    u = pumped()
    y = row((0.5,)).simulate(u)["lower [cm]"]
    assert not isinstance(TraceSimulator(y - y.mean(), u, dt=2.0).twin_, StoresSimulator)


@pytest.mark.long
@pytest.mark.filterwarnings("ignore:.*compile")
def test_an_overflow_of_the_store_that_nobody_sees_is_found_from_a_bare_trace():
    u = pumped(3000)

    def with_rim(x, u, p):
        flow, out = p[0] * u[0], p[1] * drain(x[0], 0.5)
        rate = flow - out
        spilt = rate if x[0] >= 8.0 and rate > 0 else 0.0
        return rate - spilt, out - p[2] * drain(x[1], 0.5)

    y = row((0.5, 0.5), rhs=with_rim).simulate(u)["lower [cm]"]
    y += 0.02 * np.random.default_rng(1).normal(size=y.size)
    trace = TraceSimulator(row((0.5, 0.5)).simulate(u)["lower [cm]"], u, dt=2.0)
    dx = DiscrepancyRegressor(trace, effects=["overflow", "input_saturation", "sensor_clip"]).fit(u, y)
    finding = dx.findings_[0]
    assert (finding.effect, finding.port) == ("overflow", "state:0")
    assert finding.parameters["h"] == pytest.approx(8.0, rel=0.03)
