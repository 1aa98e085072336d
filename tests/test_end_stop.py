"""End stops that are met in little of a record, where windows begin in another valley without them."""

from dataclasses import replace

import numpy as np
import pytest
import small_machines

from narx_sklearn.discrepancy import DiscrepancyRegressor, ODESimulator
from narx_sklearn.discrepancy.findings import where_in_words
from narx_sklearn.discrepancy.fitting.problem import LINE, PARABOLA, Model, Problem, measured_states
from narx_sklearn.discrepancy.fitting.refit import fit, fit_states
from narx_sklearn.discrepancy.noise import Noise
from narx_sklearn.discrepancy.placed import PlacedEffect, Port
from narx_sklearn.discrepancy.search.bank import make_bank
from narx_sklearn.discrepancy.search.candidate import Candidate
from narx_sklearn.discrepancy.search.detect import NONE_SILENT
from narx_sklearn.discrepancy.search.hypotheses import enumerate_hypotheses
from narx_sklearn.discrepancy.search.ranking import leaders
from narx_sklearn.discrepancy.search.unnamed.beyond_a_gap import damped_beyond
from narx_sklearn.discrepancy.simulators.simulator import Windows
from narx_sklearn.discrepancy.simulators.structure import find_structure
from narx_sklearn.discrepancy.simulators.windows import cut
from narx_sklearn.discrepancy.stages.forms import own_forms
from narx_sklearn.physics.effects import CATALOGUE, Setting

DT, NOISE = 0.01, 0.004
STOP = 0.55  # m
HARD = PlacedEffect(CATALOGUE["clearance"], Port("state", 1), (1.0, 0.0), theta=(300.0, 5.0, STOP - 5.0))
RATES = ((1, 0, 1.0),)


def make_axis(gain=9.0, damping=2.0):
    return small_machines.make_axis(gain, damping, dt=DT)


def in_windows(record):
    """Return the problem over short windows, and initial states that know of no rate."""
    u, y = record
    windows = cut([(slice(0, len(y)), 0)], 80, 8)
    problem = Problem(make_axis(), u, y, windows, Noise.white(np.array([NOISE])), RATES)
    return problem, np.column_stack([y[windows.first, 0], np.zeros(windows.count)])


def recorded_axis(n=2400, seed=3):
    """Return drive and position of an axis that follows waves in a loop, and meets its stop for a while."""
    rng = np.random.default_rng(seed)
    t = np.arange(n) * DT
    waves = zip(rng.uniform(0.05, 2.0, 12), rng.uniform(0, 2 * np.pi, 12), strict=True)
    wanted = sum(np.cos(2 * np.pi * hertz * t + phase) for hertz, phase in waves) / 8
    x, drive, position = np.zeros(2), np.zeros((n, 1)), np.zeros((n, 1))
    simulator = make_axis().with_effects([HARD])
    one = Windows.whole([slice(0, 2)])
    for k in range(n):
        position[k], drive[k] = x[0], 6.0 * (wanted[k] - x[0]) - 0.5 * x[1]
        x = simulator.run(np.repeat(drive[k : k + 1], 2, axis=0), one, x[None]).x[1]
    return drive, position + NOISE * rng.normal(size=position.shape)


@pytest.fixture(scope="module")
def record():
    return recorded_axis()


def test_the_record_meets_the_stop_in_little_of_it(record):
    _, y = record
    assert 0.01 < np.mean(y > STOP) < 0.1


def test_windows_begin_as_measured_where_a_bounce_leads_nowhere_from_what_was_fitted(record):
    """States fitted without the stop lie beyond it, moving back: no tangent leads through the bounce."""
    problem, x0 = in_windows(record)
    bent = fit_states(problem, Model(problem.simulator.nominal, (), x0)).model
    costs = [
        fit_states(p, bent._replace(effects=(HARD,))).cost for p in (problem, replace(problem, rates=()))
    ]
    assert costs[0] < 1.1 * problem.n_seen
    assert costs[1] > 2 * costs[0]  # the position alone does not do


def test_rates_are_read_in_their_own_unit():
    """A speed in m/s is a thousandth of the slope of a position in mm."""
    simulator = ODESimulator(
        lambda x, u, p: (1000.0 * x[1], p[0] * u[0] - x[1]),
        dt=DT,
        parameters={"gain": 1.0},
        states=["position [mm]", "velocity [m/s]"],
        inputs=["drive [V]"],
        output=(0,),
    )
    u = np.sin(0.1 * np.arange(200))[:, None]
    windows = cut([(slice(0, 200), 0)], 40, 8)
    run = simulator.run(u, Windows.whole([slice(0, 200)]), np.zeros((1, 2)))
    rates = find_structure(simulator, run.x, u).rates
    assert rates == ((1, 0, pytest.approx(1000.0)),)
    known = measured_states(simulator, u, run.y, windows, rates)
    np.testing.assert_allclose(known[:, 0], run.x[windows.first, 0])
    np.testing.assert_allclose(known[:, 1], run.x[windows.first, 1], atol=0.2 * np.ptp(run.x[:, 1]))
    assert np.isnan(measured_states(simulator, u, run.y, windows, ())[:, 1]).all()


@pytest.mark.parametrize("length", [5, 12, 40])
@pytest.mark.parametrize("slope", [LINE, PARABOLA])
def test_rates_are_slopes_of_polynomials_through_what_was_measured(record, length, slope):
    u, y = record[0], record[1].copy()
    y[::7], y[400:420] = np.nan, np.nan
    windows = cut([(slice(0, len(y)), 0)], length, 2)
    known = measured_states(make_axis(), u, y, windows, RATES, slope)
    degree, n = slope
    for (a, b), rate in zip(zip(windows.first, windows.last, strict=True), known[:, 1], strict=True):
        t = np.arange(a, min(a + n, b))
        t = t[np.isfinite(y[t, 0])]
        wanted = np.polyfit((t - a) * DT, y[t, 0], degree)[-2] if t.size > degree + 1 else np.nan
        np.testing.assert_allclose(rate, wanted, rtol=1e-7, atol=1e-9)


def test_a_stop_is_tried_wherever_it_is_met_for_a_hundredth_of_the_time():
    x = np.linspace(-1.0, 1.0, 1001) ** 9
    rest = np.zeros_like(x)
    own = np.sin(np.arange(x.size) * DT)  # rate of the state, which a force acts on
    setting = Setting(x, rest, own, rest, np.arange(x.size) * DT, DT, np.array([0]), rest, rest, rest)
    starts = CATALOGUE["clearance"].starts(setting)
    upper = starts[:, 1] + starts[:, 2]
    met = [np.mean(x > stop) for stop in upper if stop < x.max()]
    assert min(met) < 0.02


def test_a_law_beyond_a_threshold_leads_where_the_mismatch_is_in_few_places(record):
    """Tangents along a run that the stop throws far off say little of it: others stand before it."""
    problem, x0 = in_windows(record)
    found = fit(problem, Model(problem.simulator.nominal, (), x0))
    run = problem.run(found.model)
    structure = find_structure(problem.simulator, run.x, problem.u)
    everything = enumerate_hypotheses(CATALOGUE.values(), problem, run, structure)
    bank = make_bank(problem, found, everything)
    assert "clearance" in [effect.effect.code for effect in leaders(bank, 1, NONE_SILENT, 1.0)]
    evenly = replace(bank, residual=np.ones_like(bank.residual))
    assert "clearance" not in [effect.effect.code for effect in leaders(evenly, 1, NONE_SILENT, 1.0)]


def test_what_adds_something_elsewhere_too_is_not_told_to_act_in_a_place():
    zone = PlacedEffect(
        CATALOGUE["dead_zone"], Port("input", 0), theta=(0.5, 0.0, 0.0, 0.0), argument_name="drive"
    )
    drive = np.linspace(-2.0, 2.0, 101)
    assert where_in_words(zone, drive, -np.clip(drive, -0.5, 0.5)) == ""
    clip = PlacedEffect(CATALOGUE["sensor_clip"], Port("output", 0), theta=(-1.0, 1.5), argument_name="level")
    assert where_in_words(clip, drive, np.clip(drive, -1.0, 1.5) - drive) == "level is below -1 or above 1.5"
    assert where_in_words(clip, drive / 2, np.zeros(101)) == ""  # beyond the ends nothing was seen


class TestGivingWay:
    def test_what_is_hit_damps_beyond_the_gap(self):
        damped = damped_beyond(HARD)
        assert damped.placed.port == HARD.port
        assert damped.placed.weights == HARD.weights
        theta = damped.starts[0]
        np.testing.assert_allclose(theta, [1.0, STOP - 10.0, STOP])

        def force(x, rate):
            return damped.placed.effect.force(x, rate, 0.0, 0.0, 0.0, DT, np.zeros(1), theta, np.zeros(1))

        assert [force(x, 2.0) for x in (STOP - 0.01, STOP + 0.01, STOP - 10.1)] == [0.0, -2.0, -2.0]

    def test_between_two_bodies_the_ratio_in_which_it_pushes_back_comes_last(self):
        between = PlacedEffect(
            HARD.effect, Port("state", 3), (-1.0, 0.0, 1.0, 0.0), (), 1, (300.0, 0.2, 0.05, 0.7)
        )
        damped = damped_beyond(between).placed
        assert (damped.onward, damped.onward_theta) == (1, (0.7,))
        np.testing.assert_allclose(damped.own_theta, [0.0, -0.15, 0.25])

    @pytest.mark.parametrize(
        ("code", "port"),
        [
            ("cubic_stiffness", Port("state", 1)),
            ("dead_zone", Port("input", 0)),
            ("overflow", Port("state", 1)),
        ],
    )
    def test_what_is_not_beyond_a_gap_has_no_such_form(self, code, port):
        effect = CATALOGUE[code]
        assert damped_beyond(PlacedEffect(effect, port, theta=(0.1,) * len(effect.parameters))) is None

    def test_it_is_a_form_of_a_stop_where_it_takes_little(self, record):
        problem, x0 = in_windows(record)
        found = fit(problem, Model(problem.simulator.nominal, (HARD,), x0))
        structure = find_structure(problem.simulator, problem.run(found.model).x, problem.u)
        forms = own_forms(problem, Candidate(found, problem.n_seen), structure)
        assert "damped_beyond" in [form.placed.effect.code for form in forms]


@pytest.mark.long
def test_a_stop_of_an_axis_is_named(record):
    u, y = record
    effects = ["clearance", "extra_mode", "bouc_wen_hysteresis", "cogging", "coulomb_friction", "gain_drift"]
    dx = DiscrepancyRegressor(make_axis(10.0, 1.6), effects=effects, random_state=0).fit(u, y)
    assert (dx.verdict_, [finding.effect for finding in dx.findings_]) == ("explained", ["clearance"])
    assert ", where position is above 0.5" in dx.findings_[0].size
    found = dx.findings_[0].parameters
    assert found["g"] + found["c"] == pytest.approx(STOP, abs=0.005)
