"""Mistakes in records: each is found and said, and none is seen where there is none."""

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from scipy.signal import lfilter

from narx_sklearn.discrepancy import (
    DiscrepancyRegressor,
    NARXSimulator,
    ODESimulator,
    TraceSimulator,
    check_record,
)
from narx_sklearn.discrepancy.fitting.problem import Model, Problem
from narx_sklearn.discrepancy.noise import Noise
from narx_sklearn.discrepancy.placed import PlacedEffect, Port
from narx_sklearn.discrepancy.records.finding import DataFinding
from narx_sklearn.discrepancy.records.in_words import alike_ratios, named_zero
from narx_sklearn.discrepancy.records.mistakes import _unsigned, make_case
from narx_sklearn.discrepancy.records.standing import not_told_by, still_standing, to_be_mended
from narx_sklearn.discrepancy.simulators.simulator import Windows
from narx_sklearn.discrepancy.simulators.windows import cut
from narx_sklearn.model import NARXModel
from narx_sklearn.physics.effects import CATALOGUE

N = 1200
NAMES = {"states": ["q [m]", "v [m/s]"], "inputs": ["f [N]"]}
PARAMETERS = {"b": 1.0, "c": 1.5, "k": 12.0}


def stage(x, u, p):
    return x[1], p[0] * u[0] - p[1] * x[1] - p[2] * x[0]


def rough_stage(x, u, p):
    friction = p[3] * np.tanh(x[1] / 0.01)
    return x[1], p[0] * u[0] - p[1] * x[1] - p[2] * x[0] - p[4] * x[0] ** 3 - friction


def nominal(dt=0.05):
    return ODESimulator(stage, dt=dt, parameters=PARAMETERS, **NAMES)


def record(seed=0, n=N, noise=0.03, scale=(1.2, 0.8, 1.25)):
    """Return a clean record of a stage whose parameters are not the nominal ones."""
    rng = np.random.default_rng(seed)
    u = lfilter([0.3], [1, -0.7], rng.normal(size=n))[:, None] * 3
    values = dict(zip(PARAMETERS, np.array([1.0, 1.5, 12.0]) * scale, strict=True))
    y = nominal().with_parameters(values).simulate(u)
    return u, y + noise * y.std() * rng.normal(size=y.shape)


def codes(*record, simulator=None):
    return [finding.code for finding in check_record(simulator or nominal(), *record)]


# -- nothing to find -----------------------------------------------------------------------------------------


@pytest.mark.parametrize("seed", range(40))
def test_nothing_is_found_in_clean_records_with_wrong_parameters(seed):
    rng = np.random.default_rng([seed, 1])
    scale = rng.uniform(0.7, 1.3, 3)
    assert codes(*record(seed, n=600, noise=rng.choice([0.01, 0.05, 0.05, 0.2]), scale=scale)) == []


@pytest.mark.parametrize(("friction", "cubic"), [(0.3, 0.0), (0.8, 0.0), (0.0, 200.0), (0.4, 100.0)])
def test_missing_physics_is_no_mistake_in_the_data(friction, cubic):
    u, _ = record()
    parameters = {"b": 1.2, "c": 1.2, "k": 15.0, "friction": friction, "cubic": cubic}
    y = ODESimulator(rough_stage, dt=0.05, parameters=parameters, substeps=20, **NAMES).simulate(u)
    assert codes(u, y) == []


def test_quantised_outputs_and_rest_are_no_mistake():
    u, y = record(noise=0.0)
    u[:100], u[-100:] = 0.0, 0.0
    y = nominal().simulate(u)
    step = y.std() / 20
    assert codes(u, np.round(y / step) * step) == []


# -- one mistake each ----------------------------------------------------------------------------------------


@pytest.mark.parametrize("factor", [0.1, 0.5, 2.0, 10.0])
def test_wrong_sampling_period_is_found(factor):
    u, y = record(n=6000 if factor > 1 else N)
    (found,) = check_record(nominal(dt=0.05 / factor), u, y)
    assert found.code == "time_scale"
    assert found.evidence["factor"] == factor
    assert "as if dt were 0.05 s" in found.sentence


def test_swapped_columns_are_found():
    u, y = record()
    (found,) = check_record(nominal(), y, u)
    assert found.code == "swapped"
    assert found.sentence.startswith("Input f [N] and output q [m] seem to be swapped.")


def test_swapped_outputs_and_inputs_are_found():
    def tanks(x, u, p):
        through = p[2] * x[0]
        return p[0] * u[0] - through, through + p[1] * u[1] - p[3] * x[1]

    sim = ODESimulator(
        tanks,
        dt=0.5,
        parameters={"a": 1.0, "b": 0.3, "c": 0.2, "d": 0.8},
        states=["upper [m]", "lower [m]"],
        inputs=["pump [V]", "valve"],
        outputs=["upper [m]", "pressure [kPa]"],
        output=lambda x, u, p: (x[0], 9.81 * x[1]),
    )
    u = lfilter([0.5], [1, -0.5], np.random.default_rng(0).normal(size=(N, 2)), axis=0)
    y = sim.with_parameters([1.1, 0.32, 0.22, 0.75]).simulate(u)
    y = y + 0.02 * y.std(axis=0) * np.random.default_rng(1).normal(size=y.shape)
    assert check_record(sim, u, y) == ()
    for given, words in (
        ((u, y[:, ::-1]), "Output upper [m] and output pressure [kPa] seem to be swapped."),
        ((u[:, ::-1], y), "Input pump [V] and input valve seem to be swapped."),
    ):
        (found,) = check_record(sim, *given)
        assert found.code == "swapped"
        assert found.sentence.startswith(words)


def test_reversed_sign_is_found():
    u, y = record()
    (found,) = check_record(nominal(), u, -y)
    assert (found.code, found.evidence["output"]) == ("sign", 0)


@pytest.mark.parametrize("samples", [-4, 3, 20])
def test_shifted_column_is_found_to_the_sample(samples):
    u, y = record()
    (found,) = check_record(nominal(), u, np.roll(y, samples, axis=0))
    assert found.code == "delayed"
    assert abs(found.evidence["samples"] - samples) <= 1
    assert ("too late" if samples > 0 else "too early") in found.sentence


def test_the_input_that_is_shifted_or_reversed_is_named():
    def mixer(x, u, p):
        return (p[0] * u[0] + p[1] * u[1] - p[2] * x[0],)

    about = {"dt": 0.1, "states": ["h"], "inputs": ["hot", "cold"]}
    sim = ODESimulator(mixer, parameters={"a": 1.0, "b": 0.8, "c": 1.0}, **about)
    u = lfilter([0.5], [1, -0.5], np.random.default_rng(0).normal(size=(N, 2)), axis=0)
    y = sim.with_parameters([1.2, 0.7, 1.1]).simulate(u)
    (found,) = check_record(sim, np.column_stack([u[:, 0], -u[:, 1]]), y)
    assert (found.code, found.evidence["input"]) == ("sign", 1)
    (found,) = check_record(sim, np.column_stack([np.roll(u[:, 0], 6), u[:, 1]]), y)
    assert (found.code, found.evidence["input"]) == ("delayed", 0)
    assert found.evidence["samples"] == -6
    assert "Input hot comes 6 samples (0.6 s) too late" in found.sentence


@pytest.mark.parametrize(
    ("factor", "unit", "words"),
    [(1e3, "m", "m and mm"), (1e-3, "m", "m and mm"), (180 / np.pi, "rad", "radians and degrees")],
)
def test_other_units_are_found_and_named(factor, unit, words):
    u, y = record(scale=(1.1, 0.9, 1.05))
    names = {**NAMES, "states": [f"q [{unit}]", f"v [{unit}/s]"]}
    (found,) = check_record(ODESimulator(stage, dt=0.05, parameters=PARAMETERS, **names), u, factor * y)
    assert found.code == "units"
    assert 0.6 < found.evidence["slope"] / factor < 1.6
    assert words in found.sentence


def test_other_zero_is_found():
    u, y = record()
    (found,) = check_record(nominal(), u, y + 273.15)
    assert found.code == "units"
    assert abs(found.evidence["offset"] - 273.15) < y.std()


def shaft_record(unit, turn, *, pull=0.0, seed=1, n=2000):
    """Return a simulator of a shaft that turns over, and a record of its angle before it was folded."""
    size = turn / (2 * np.pi)

    def shaft(x, u, p):
        return x[1], p[0] * u[0] - p[1] * x[1] - p[2] * np.sin(x[0] / size)

    names = {"states": [f"angle [{unit}]" if unit else "angle", "speed"], "inputs": ["torque"]}
    parameters = {"k": 30.0 * size, "b": 4.0, "g": pull * size}
    sim = ODESimulator(shaft, dt=0.01, parameters=parameters, **names)
    rng = np.random.default_rng(seed)
    u = np.repeat(rng.uniform(-2, 2, n // 25), 25)[:, None]
    values = {"k": 33.0 * size, "b": 3.5, "g": 1.1 * pull * size}
    return sim, u, sim.with_parameters(values).simulate(u) + 0.01 * size * rng.normal(size=(n, 1))


class TestFoldedReadings:
    @pytest.mark.parametrize(("unit", "turn"), [("rad", 2 * np.pi), ("deg", 360.0), ("", 4096.0)])
    @pytest.mark.parametrize("pull", [0.0, 18.0])
    def test_an_angle_that_begins_anew_after_a_turn_is_told_with_it(self, unit, turn, pull):
        sim, u, angle = shaft_record(unit, turn, pull=pull)
        folded = (angle + turn / 2) % turn - turn / 2
        (found,) = check_record(sim, u, folded)
        assert (found.code, found.evidence["output"]) == ("wrapped", 0)
        assert found.evidence["turn"] == pytest.approx(turn, rel=0 if unit else 0.002)
        assert check_record(sim, u, np.unwrap(folded, period=found.evidence["turn"], axis=0)) == ()

    def test_each_session_and_each_side_of_a_gap_goes_on_by_itself(self):
        sim, u, angle = shaft_record("deg", 360.0)
        folded = angle % 360.0
        folded[700:720] = np.nan
        (found,) = check_record(sim, u, folded, sessions=np.repeat([0, 1], 1000))
        assert found.evidence["turn"] == 360.0

    def test_a_jump_that_is_no_turn_is_a_jump(self):
        sim, u, angle = shaft_record("deg", 360.0, pull=18.0)
        angle[1200:] += 100.0
        assert "wrapped" not in codes(u, angle, simulator=sim)

    def test_a_speed_without_a_sign_is_told_and_then_simulated(self):
        """A pulse counter does not see the direction, as on the coupled electric drives."""

        def drive(x, u, p):
            return p[0] * u[0] - p[1] * x[0], p[2] * (x[0] - x[1])

        about = {"dt": 0.02, "states": ["motor", "pulley"], "inputs": ["volts"]}
        about["parameters"] = {"k": 4.0, "b": 3.0, "c": 8.0}
        signed, size = (
            ODESimulator(drive, outputs=["speed"], output=reads, **about)
            for reads in (lambda x, u, p: x[1], lambda x, u, p: abs(x[1]))
        )
        rng = np.random.default_rng(0)
        u = np.repeat(rng.uniform(-1.5, 1.5, 75), 20)[:, None]
        speed = signed.with_parameters([4.6, 2.7, 9.0]).simulate(u)
        y = np.abs(speed) + 0.01 * rng.normal(size=speed.shape)
        (found,) = check_record(signed, u, y)
        assert (found.code, found.evidence["output"]) == ("unsigned", 0)
        assert "has no sign" in found.sentence
        assert "abs in the simulator's output function" in found.sentence
        assert check_record(size, u, y) == ()
        assert [f.code for f in to_be_mended([found], [])] == ["unsigned"]

    def test_of_a_simulated_trace_too(self):
        rng = np.random.default_rng(0)
        u = np.repeat(rng.uniform(-1, 1, 80), 10)
        given, true = (lfilter([gain], [1, -pole], u) for gain, pole in ((0.4, 0.8), (0.37, 0.83)))
        y = np.abs(true) + 0.01 * rng.normal(size=u.size)
        assert codes(u[:, None], y, simulator=TraceSimulator(given, u, dt=0.1)) == ["unsigned"]

    def test_what_is_simulated_with_one_sign_has_none_to_lose(self):
        """However badly a twin follows it, which may go below zero where the simulation does not."""
        rng = np.random.default_rng(0)
        u = np.abs(np.repeat(rng.uniform(-1.0, 1.0, 60), 20))[:, None]
        given = lfilter([0.1], [1, -0.9], u[:, 0])
        y = (given + 0.05 * rng.normal(size=given.size))[:, None]
        trace = TraceSimulator(given, u, dt=0.1)
        assert list(_unsigned(make_case(trace, u, y, [slice(0, u.size)]))) == []
        turned = make_case(TraceSimulator(given - given.mean(), u, dt=0.1), u, y, [slice(0, u.size)])
        assert [mistake.code for mistake in _unsigned(turned)] == ["unsigned"]

    def test_what_is_never_below_zero_has_a_sign_nevertheless(self):
        def tank(x, u, p):
            return (p[0] * u[0] - p[1] * x[0],)

        about = {"dt": 0.1, "states": ["level"], "inputs": ["pump"]}
        sim = ODESimulator(tank, parameters={"a": 1.0, "b": 0.5}, **about)
        rng = np.random.default_rng(0)
        u = np.repeat(rng.uniform(-1.0, 1.0, 60), 20)[:, None]
        level = sim.with_parameters([1.2, 0.6]).simulate(u)
        assert "unsigned" not in codes(u, np.maximum(level, 0.0), simulator=sim)  # empty, not turned round
        assert (
            codes(np.abs(u), sim.simulate(np.abs(u)) + 0.01 * rng.normal(size=level.shape), simulator=sim)
            == []
        )


def test_two_mistakes_are_both_found():
    u, y = record()
    assert codes(u, -1000 * y) == ["sign", "units"]


def test_short_records_are_told_with_the_length_that_is_wanted():
    u, y = record()
    (found,) = check_record(nominal(), u[:30], y[:30])
    assert found.code == "short_record"
    assert found.evidence["wanted"] >= 60
    assert "30 samples (1.5 s)" in found.sentence


def test_recordings_that_were_joined_are_told_unless_they_are_labelled():
    n = N // 2
    (u, first), (more, second) = record(0, n), record(1, n)
    u, y = np.concatenate([u, more]), np.concatenate([first - 2.0, second + 2.0])
    found = {f.code: f for f in check_record(nominal(), u, y)}["jump"]
    assert found.evidence["samples"] == [n]
    assert f"jumps by {(y[n] - y[n - 1]).item():.3g}, at sample {n} (30 s)" in found.sentence
    assert "label them in sessions" in found.sentence
    assert "jump" not in {f.code for f in check_record(nominal(), u, y, sessions=np.repeat([0, 1], n))}


def test_what_comes_back_was_held_or_jumps_in_the_simulation_is_no_jump():
    u, y = record()
    y[500] += 20 * y.std()  # a spike
    assert "jump" not in codes(u, y)
    u, y = record()
    y[700:780] = y[700]
    y[780:] += 20 * y.std()  # held, and caught up
    assert "jump" not in codes(u, y)
    fed = ODESimulator(
        stage,
        dt=0.05,
        parameters=PARAMETERS,
        output=lambda x, u, p: (x[0] + u[0],),
        outputs=["q [m]"],
        **NAMES,
    )
    u = 0.01 * record()[0]
    u[600:] += 5.0
    assert "jump" not in codes(u, fed.simulate(u), simulator=fed)


def test_constant_input_is_told():
    u, y = record()
    assert codes(np.full_like(u, 2.0), y) == ["constant_input"]


def test_duplicated_samples_are_counted():
    u, y = record()
    rows = np.sort(np.concatenate([np.arange(N), np.arange(100, 700, 30)]))
    found = {f.code: f for f in check_record(nominal(), u[rows], y[rows])}
    assert found["duplicated_samples"].evidence["repeated"] == 20


def test_values_of_few_digits_that_meet_while_the_input_rests_are_no_doubled_samples():
    """Neighbours that are apart by some ten digits meet by chance half as often as they miss by one."""
    u = np.repeat(np.random.default_rng(3).normal(size=N // 100 + 1), 100)[:N, None]
    y = nominal().simulate(u)
    step = np.ptp(y) / 2**15
    y += step * np.random.default_rng(4).normal(0.0, 2.0, size=y.shape)
    y = step * np.round(y / step)
    repeated = int(np.sum((np.diff(y, axis=0) == 0).all(axis=1) & (np.diff(u, axis=0) == 0).all(axis=1)))
    assert repeated > 0.01 * N
    assert "duplicated_samples" not in codes(u, y)
    rows = np.sort(np.concatenate([np.arange(N), np.arange(101, N, 12)]))
    found = {f.code: f for f in check_record(nominal(), u[rows], y[rows])}
    assert found["duplicated_samples"].evidence["repeated"] >= np.arange(101, N, 12).size


def test_an_output_that_repeats_while_the_input_changes_is_told():
    u, y = record()
    y[700:780] = y[700]
    (found,) = check_record(nominal(), u, y)
    assert found.code == "held_output"
    assert found.evidence["stretches"] == [(700, 780)]
    u[700:] = u[700]
    assert codes(u, y) == []  # nothing goes on there that it would miss


def test_clipped_samples_are_counted():
    u, y = record()
    limit = 1.5 * y.std()
    (found,) = check_record(nominal(), u, np.minimum(y, limit))
    assert (found.code, found.evidence["count"]) == ("clipped_output", int((y > limit).sum()))
    assert "largest" in found.sentence


# -- other simulators, other shapes --------------------------------------------------------------------------


def test_narx_models_are_checked_too():
    sim = NARXSimulator(NARXModel.from_equations("1.5*y[k-1] - 0.7*y[k-2] + 0.2*u[k-1]"), dt=0.1)
    u = np.random.default_rng(0).normal(size=(N, 1))
    y = sim.simulate(u)
    y += 0.02 * y.std() * np.random.default_rng(1).normal(size=y.shape)
    assert codes(u, y, simulator=sim) == []
    assert codes(u, -y, simulator=sim) == ["sign"]
    assert codes(u, 1000 * y, simulator=sim) == ["units"]


def test_sessions_and_gaps_are_kept_apart():
    u, y = record()
    u[500:510] = np.nan
    y[500:510] = np.nan
    sessions = np.repeat([0, 1], N // 2)
    assert codes(u, y, sessions) == []
    assert codes(u, -y, sessions) == ["sign"]


def test_data_that_do_not_fit_are_refused():
    u, y = record()
    with pytest.raises(ValueError, match=r"y has 2 columns, the simulator has 1.*outputs=\[\.\.\.\]"):
        check_record(nominal(), u, np.column_stack([y, y]))


def test_columns_of_a_table_are_found_by_name():
    u, y = record()
    table = pd.DataFrame({"time": np.arange(N) * 0.05, "q": y[:, 0]})
    assert check_record(nominal(), u, table) == check_record(nominal(), u, y)


def test_a_mistake_is_not_told_where_the_refit_explains_more_without_it():
    """Where errors of parameters grow, the quick refit of the check may go anywhere."""
    u, y = record(noise=0.0)
    windows = cut([(slice(0, N), 0)], 200, 8)
    simulator = nominal()
    run = simulator.simulate(u)
    offset = 0.5 * y.std()  # of which a quarter of the variance is left
    problem = Problem(simulator, u, run + offset, windows, Noise.white(np.array([1e-3 * offset])))
    x = simulator.run(u, Windows.whole([slice(0, N)]), np.zeros((1, 2))).x
    near = Model(simulator.nominal, (), x[windows.first])
    share = float((offset / problem.y.std()) ** 2)
    units, clipped = (
        DataFinding("units", "", {"before": 60.0, "after": 1.01 * share}),
        DataFinding("clipped_output", ""),
    )
    found = [units, clipped]
    assert still_standing(found, problem, near, near) == [clipped]
    less = [replace(units, evidence={"after": 0.99 * share}), clipped]
    assert still_standing(less, problem, near, near) == less
    # an effect must leave far less
    cubic = PlacedEffect(CATALOGUE["cubic_stiffness"], Port("state", 1), (1.0, 0.0), theta=(60.0,))
    simulator = simulator.with_effects([cubic])
    run = simulator.simulate(u)
    zero = 0.2 * run.std()
    problem = Problem(nominal(), u, run + zero, windows, Noise.white(np.array([1e-3 * zero])))
    x = simulator.run(u, Windows.whole([slice(0, N)]), np.zeros((1, 2))).x[windows.first]
    without, named = Model(nominal().nominal, (), x), Model(nominal().nominal, (cubic,), x)
    share = float((zero / problem.y.std()) ** 2)
    for times, left in ((1.98, [units]), (2.02, [])):
        told = [replace(units, evidence={"after": times * share})]
        assert [finding.code for finding in still_standing(told, problem, without, named)] == [
            finding.code for finding in left
        ]
    # of what lies beyond the noise, which nothing explains
    noisy = problem.with_noise(Noise.white(np.array([0.9 * zero])))
    hardly = [replace(units, evidence={"after": 1.25 * share}), clipped]
    assert still_standing(hardly, problem, without, named) == hardly
    assert still_standing(hardly, noisy, without, named) == [clipped]  # 0.19 of 0.44
    hardly = [replace(units, evidence={"after": 1.15 * share}), clipped]
    assert still_standing(hardly, noisy, without, named) == hardly  # 0.19 of 0.34
    # and neither does so with parameters that nobody would expect
    problem = Problem(nominal(), u, 1000.0 * nominal().simulate(u), windows, Noise.white(np.ones(1)))
    large = Model(nominal().nominal * [1000.0, 1.0, 1.0], (), 1000.0 * near.x0)
    told = [replace(units, evidence={"after": 0.01})]
    assert still_standing(told, problem, large, large) == told
    # one such parameter is likelier than two mistakes
    twice = [*told, DataFinding("time_scale", "", {"after": 0.01})]
    assert still_standing(twice, problem, large, large) == []


def test_what_parameters_that_are_hardly_told_leave_is_asked_where_one_expects_them():
    """A fit may go to a damping of nothing, where another in its place leaves hardly more."""
    u, y = record(noise=0.0)
    windows = cut([(slice(0, N), 0)], 200, 8)
    x = nominal().run(u, Windows.whole([slice(0, N)]), np.zeros((1, 2))).x[windows.first]
    problem = Problem(nominal(), u, y, windows, Noise.white(np.array([0.1 * y.std()])))
    undamped = Model(nominal().nominal * [1.2, 0.0, 1.25], (), x)
    told = [DataFinding("time_scale", "", {"before": 0.2, "after": 0.02})]
    assert still_standing(told, problem, undamped, undamped) == []


def test_of_parameters_that_only_do_something_together_the_nearest_count():
    """With the mass and all forces doubled the machine runs the same."""

    def heavy(x, u, p):
        return x[1], (p[1] * u[0] - p[2] * x[1] - p[3] * x[0]) / p[0]

    u, _ = record()
    windows = cut([(slice(0, N), 0)], 200, 8)
    simulator = ODESimulator(heavy, dt=0.05, parameters={"mass": 1.0, **PARAMETERS}, **NAMES)
    run = simulator.simulate(u)
    problem = Problem(simulator, u, run, windows, Noise.white(np.ones(1)))
    x = simulator.run(u, Windows.whole([slice(0, N)]), np.zeros((1, 2))).x
    doubled = Model(2.0 * simulator.nominal, (), x[windows.first])
    time_scale = [DataFinding("time_scale", "", {"before": 0.2, "after": 0.02})]
    assert still_standing(time_scale, problem, doubled, doubled) == []


def test_only_what_the_values_show_must_be_mended_before_physics_is_named():
    swapped = DataFinding("swapped", "", {"after": 0.1})
    late = DataFinding("delayed", "", {"after": 0.1})
    label = DataFinding("units", "", {"label": "f [Newton]", "unit": "N"})
    offset = DataFinding("units", "", {"slope": 1.0, "after": 0.1})
    feet = DataFinding("units", "", {"slope": 0.3, "alike": ["between metres and feet (3.281)"]})
    amplified = DataFinding("units", "", {"slope": 50.0, "alike": []})
    braked = DataFinding("units", "", {"slope": 0.4, "alike": []})  # as a drag that is missing may do
    bias = PlacedEffect(CATALOGUE["sensor_bias"], Port("output", 0), theta=(0.1,))
    found = [swapped, late, label, offset, feet, amplified, braked]
    assert to_be_mended(found, []) == [swapped, offset, feet, amplified]
    assert to_be_mended(found, [bias]) == [swapped, feet, amplified]


def test_a_column_that_comes_late_by_a_delay_that_is_named_is_told_once():
    def late(**about):
        return DataFinding("delayed", "", about)

    two = ODESimulator(stage, dt=0.05, parameters=PARAMETERS, states=NAMES["states"], inputs=["f", "g"])
    delay = PlacedEffect(CATALOGUE["delay"], Port("input", 0), theta=(0.41, 0.0))
    swapped = DataFinding("swapped", "", {"input": 0, "output": 0})
    assert not_told_by([late(output=0, samples=8), swapped], [delay], nominal()) == [swapped]
    assert not_told_by([late(input=0, samples=8)], [delay], two) == []
    for other in (late(output=0, samples=-8), late(output=0, samples=10)):
        assert not_told_by([other], [delay], nominal()) == [other]
    for other in (late(output=0, samples=8), late(input=1, samples=8)):
        assert not_told_by([other], [delay], two) == [other]
    assert len(not_told_by([late(output=0, samples=8)], [], nominal())) == 1


@pytest.mark.long
@pytest.mark.parametrize(
    ("unit", "told"), [("V", " V added to pump."), ("%", " percentage points added to pump.")]
)
def test_a_dead_time_that_is_explained_is_told_once(unit, told):
    sim = ODESimulator(
        lambda x, u, p: (p[0] * u[0] - p[1] * x[0],),
        dt=0.1,
        parameters={"inflow": 2.2, "outlet [1/s]": 1.8},
        states=["level [m]"],
        inputs=[f"pump [{unit}]"],
    )
    rng = np.random.default_rng(1)
    u = np.repeat(rng.normal(0, 3, 80), 15)[:, None]
    y = sim.with_parameters([2.0, 2.0]).simulate(np.roll(u, 8, axis=0)) + 0.05 * rng.normal(size=u.shape)
    assert [finding.code for finding in check_record(sim, u, y)] == ["delayed"]
    dx = DiscrepancyRegressor(sim, effects=["delay", "lag"], random_state=0).fit(u, y)
    (finding,) = dx.findings_
    assert (dx.verdict_, finding.effect, list(dx.data_findings_)) == ("explained", "delay", [])
    assert finding.size.endswith(told)


def hardening(x, u, p):
    return x[1], p[0] * u[0] - p[1] * x[1] - p[2] * x[0] - 2.0 * x[0] ** 3


MISTAKES = {
    "time_scale, a tenth": (0.1, lambda u, y: (u, y), "time_scale"),
    "time_scale, half": (0.5, lambda u, y: (u, y), "time_scale"),
    "time_scale, double": (2.0, lambda u, y: (u, y), "time_scale"),
    "time_scale, tenfold": (10.0, lambda u, y: (u, y), "time_scale"),
    "millimetres": (1.0, lambda u, y: (u, 1000 * y), "units"),
    "inches": (1.0, lambda u, y: (u, 39.37 * y), "units"),
    "another zero too": (1.0, lambda u, y: (u, 1.8 * y + 32.0), "units"),
    "sign": (1.0, lambda u, y: (u, -y), "sign"),
    "swapped": (1.0, lambda u, y: (y, u), "swapped"),
}


@pytest.mark.long
@pytest.mark.parametrize("truth", [None, hardening])
@pytest.mark.parametrize("kind", MISTAKES)
def test_a_mistake_is_told_beside_missing_physics_and_not_sold_as_physics(kind, truth):
    factor, spoil, code = MISTAKES[kind]
    about = {"states": ["position [m]", "velocity [m/s]"], "inputs": ["drive [V]"]}
    values = {"gain [m/s^2/V]": 1.0, "damping [1/s]": 0.8, "stiffness [1/s^2]": 12.0}
    true = dict(zip(values, (1.1, 0.7, 11.0), strict=True))
    rng = np.random.default_rng(0)
    u = np.repeat(rng.normal(0, 3, 200), 10)
    y = ODESimulator(truth or stage, dt=0.05, parameters=true, **about).simulate(u)[:, 0]
    y = y + 0.005 * rng.normal(size=y.size)
    simulator = ODESimulator(stage, dt=0.05 * factor, parameters=values, **about)
    effects = ["cubic_stiffness", "coulomb_friction", "quadratic_drag"]
    dx = DiscrepancyRegressor(simulator, effects=effects).fit(*spoil(u, y))
    assert code in [finding.code for finding in dx.data_findings_]
    assert dx.verdict_ not in ("explained", "ambiguous")
    if dx.verdict_ == "unknown":
        assert "mend it first" in dx.report_


@pytest.mark.parametrize(
    ("slope", "unit", "words"),
    [
        (43.0, "m", "between metres and inches (39.37)"),
        (1 / 25.4, "mm", "between inches and millimetres (25.4)"),
        (52.0, "rad", "between radians and degrees"),
        (8.8, "rad/s", "between rad/s and rpm (9.549)"),
        (9e4, "Pa", "between bar and Pa"),
        (7100.0, "Pa", "between psi and Pa (6895)"),
        (0.0011, "V", "between a unit and its thousandth"),
    ],
)
def test_a_factor_is_named_by_what_the_signal_is_measured_in(slope, unit, words):
    assert alike_ratios(slope, [unit, "V"])[0].startswith(words)


def test_a_factor_that_is_no_change_of_units_has_no_name():
    assert alike_ratios(300.0, ["m"]) == []


def test_a_change_of_units_is_none_of_another_kind_than_the_signals():
    assert "feet" in alike_ratios(1 / 3.1, ["m/s", "V"])[0]
    assert alike_ratios(1 / 3.1, ["rpm", "N m"]) == []
    assert "feet" in alike_ratios(1 / 3.1, ["", "N m"])[0]  # the unit of a column may be anything


@pytest.mark.parametrize(
    ("slope", "offset", "unit", "words"),
    [
        (1.1, 273.15, "degC", "between degrees Celsius and kelvin (273.15)"),
        (0.9, -272.0, "K", "between degrees Celsius and kelvin (273.15)"),
        (1.7, 32.0, "degC", "between degrees Celsius and Fahrenheit (1.8, 32)"),
        (1.8, -459.67, "K", "between kelvin and degrees Fahrenheit (1.8, -459.67)"),
    ],
)
def test_scales_of_temperature_are_named(slope, offset, unit, words):
    assert named_zero(slope, offset, unit) == f", as {words}"
    assert named_zero(slope, offset, "m") == ""
    assert named_zero(slope, 2 * offset, unit) == ""
