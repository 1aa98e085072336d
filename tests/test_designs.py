"""Inputs for an experiment: they keep within their limits from the first sample on, and limits make sense."""

import numpy as np
import pytest

from narx_sklearn.discrepancy import ODESimulator
from narx_sklearn.discrepancy.designs import (
    Limits,
    fewest_samples,
    make_designs,
    read_limits,
    settled,
    spliced,
)

DT = 0.1


def lag(constant=1.0):
    return ODESimulator(
        lambda x, u, p: ((p[0] * u[0] - x[0]) / p[1],),
        dt=DT,
        parameters={"gain": 1.0, "time constant": constant},
        states=["temperature [K]"],
        inputs=["heater [W]", "ambient [K]"],
    )


def designs(constant=1.0, **about):
    simulator = lag(constant)
    limits = read_limits(simulator, **{"amplitude": 2.0, "n_samples": 400, "offset": 5.0} | about)
    base = np.array([5.0, 20.0])
    return make_designs(simulator, settled(simulator, base, limits.n_samples), base, limits, random_state=0)


@pytest.mark.parametrize("rate", [None, 0.3, 50.0])
def test_an_input_leaves_its_offset_no_faster_than_it_may(rate):
    for kind, u in designs(rate=rate):
        assert np.all(np.abs(u[:, 0] - 5.0) <= 2.0 + 1e-12), kind
        steps = np.abs(np.diff(u[:, 0], prepend=5.0))
        assert rate is None or np.all(steps <= rate * DT + 1e-12), kind
        assert np.all(u[:, 1] == 20.0)


@pytest.mark.parametrize("rate", [None, 0.3])
def test_two_inputs_in_one_keep_the_limits_where_they_meet(rate):
    limits = Limits(2.0, 400, 5.0, rate, 0)
    wanted = [design for design in designs(rate=rate) if design[0].startswith(("square", "slow"))]
    both = spliced(wanted[:3], limits, DT)
    assert len(both) == 3
    for kind, u in both:
        first = next(input_ for name, input_ in wanted if name == kind.split("; ")[0])
        np.testing.assert_allclose(u[:200], first[:200])
        steps = np.abs(np.diff(u[:, 0], prepend=5.0))
        assert rate is None or np.all(steps <= rate * DT + 1e-12), kind
        assert np.all(u[:, 1] == 20.0)


def test_some_inputs_turn_about_as_far_as_they_may_with_amplitudes_evenly():
    found = [u[:, 0] - 5.0 for kind, u in designs() if kind.endswith("four amplitudes")]
    assert len(found) >= 4
    for signal in found:
        sizes, counts = np.unique(np.abs(signal).round(12), return_counts=True)
        assert sizes.tolist() == [0.5, 1.0, 1.5, 2.0]
        assert set(counts) == {100}


def test_a_limit_of_the_rate_that_is_never_met_changes_nothing():
    for (_, free), (_, limited) in zip(designs(), designs(rate=1e3), strict=True):
        np.testing.assert_allclose(limited, free, atol=1e-12)


def test_a_machine_far_slower_than_the_experiment_is_moved_slowly_all_the_same():
    kinds = [kind for kind, _ in designs(constant=1e4, n_samples=100)]
    assert any(kind.startswith("multisine") for kind in kinds)


@pytest.mark.parametrize(("damping", "is_met"), [(0.5, True), (20.0, False)])
def test_a_resonance_sets_the_pace_of_some_inputs(damping, is_met):
    spring = ODESimulator(
        lambda x, u, p: (x[1], u[0] - p[0] * x[0] - p[1] * x[1]),
        dt=0.01,
        parameters={"stiffness": (2 * np.pi * 3.0) ** 2, "damping": damping},
        states=["x", "v"],
        inputs=["force"],
    )
    limits = read_limits(spring, 1.0, 1000)
    found = make_designs(spring, np.zeros(2), np.zeros(1), limits, random_state=0)
    at = [u[:, 0] for kind, u in found if "resonance" in kind]
    assert len(at) == 2 * is_met
    for signal in at:
        power = np.abs(np.fft.rfft(signal)) ** 2
        frequency = np.fft.rfftfreq(signal.size, 0.01)
        assert power[(frequency > 1.8) & (frequency < 4.7)].sum() > 0.9 * power.sum()
        assert np.abs(signal).max() <= 1.0


def test_the_shortest_experiment_has_samples_for_what_is_refitted_and_designs():
    """Four each for one state, two parameters, and one more."""
    assert fewest_samples(lag()) == 16
    assert designs(n_samples=16)


@pytest.mark.parametrize(
    ("about", "error", "words"),
    [
        ({"amplitude": 0.0}, ValueError, "amplitude is 0.0; wanted is a positive and finite"),
        ({"amplitude": np.nan}, ValueError, "amplitude is nan"),
        ({"amplitude": np.inf}, ValueError, "amplitude is inf"),
        ({"amplitude": "2"}, TypeError, "amplitude is '2'; wanted is a number"),
        ({"rate": 0.0}, ValueError, "rate is 0.0; .* or None for no limit"),
        ({"rate": -1.0}, ValueError, "rate is -1.0"),
        ({"rate": np.inf}, ValueError, "rate is inf"),
        ({"offset": np.nan}, ValueError, "offset is nan; wanted is the finite value"),
        ({"offset": None}, TypeError, "offset is None; wanted is a number"),
        ({"n_samples": 100.0}, TypeError, "n_samples is 100.0; wanted is an integer"),
        ({"n_samples": True}, TypeError, "n_samples is True"),
        ({"n_samples": 15}, ValueError, "n_samples is 15, too short .* Pass at least 16"),
        ({"column": 2}, ValueError, r"column is 2; .* \{0: heater \[W\], 1: ambient \[K\]\}"),
        ({"column": -1}, ValueError, "column is -1"),
        ({"column": 0.0}, TypeError, "column is 0.0"),
    ],
)
def test_what_is_no_limit_is_refused(about, error, words):
    with pytest.raises(error, match=words):
        read_limits(lag(), **{"amplitude": 1.0, "n_samples": 100} | about)


def test_numbers_of_numpy_are_numbers():
    limits = read_limits(lag(), np.float32(1.0), np.int64(100), offset=np.int32(3), column=np.int8(1))
    assert limits == Limits(1.0, 100, 3.0, None, 1)
