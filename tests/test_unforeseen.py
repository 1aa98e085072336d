"""What follows no signal: a load that wanders, an input that drops out, told from laws and from noise."""

from itertools import pairwise
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.signal import lfilter
from small_machines import make_oscillator, oscillator

from narx_sklearn import write_report
from narx_sklearn.discrepancy import DiscrepancyRegressor, ODESimulator
from narx_sklearn.discrepancy.fitting.problem import Model, Problem
from narx_sklearn.discrepancy.fitting.refit import fit, fit_states
from narx_sklearn.discrepancy.locate import BesideFit, Course, Entry, Refined, latent_force, tangent
from narx_sklearn.discrepancy.locate._covered import Entrance, cover
from narx_sklearn.discrepancy.locate._likelihood import Colour
from narx_sklearn.discrepancy.locate._search import Likeliest
from narx_sklearn.discrepancy.noise import Noise
from narx_sklearn.discrepancy.placed import PlacedEffect, Port
from narx_sklearn.discrepancy.search.candidate import Candidate
from narx_sklearn.discrepancy.simulators.structure import find_structure
from narx_sklearn.discrepancy.simulators.windows import cut
from narx_sklearn.discrepancy.stages import diagnosis, unforeseen
from narx_sklearn.discrepancy.stages.foretold import are_foretelling, share_foretold
from narx_sklearn.discrepancy.stages.judgement import Judgement
from narx_sklearn.discrepancy.stages.unforeseen import (
    ADDED,
    FACTOR,
    GAIN,
    beside_laws,
    factors_inside,
    fitted_beside,
    leave_little,
    look_for_unforeseen,
    noise_left,
    that_pay,
    which_leads,
)
from narx_sklearn.discrepancy.surrogates.twin import TwinSimulator
from narx_sklearn.physics.effects import CATALOGUE
from narx_sklearn.report._words import headline

N, DT, SIGMA = 2000, 0.02, 0.002
FEW = ["coulomb_friction", "constant_load", "gain_drift", "cubic_stiffness", "periodic_disturbance"]
LEVEL = 0.0025


@pytest.fixture
def rng():
    return np.random.default_rng(0)


def disturbed(x, u, p):
    """An oscillator with an input's factor, a load and a spring's factor that its simulator has not."""
    rubs = u[4] * np.sign(x[1])
    return x[1], p[0] * (1.0 + u[1]) * u[0] - p[1] * x[1] - p[2] * (1.0 + u[3]) * x[0] + u[2] - rubs


def wandering(rng, memory, size, n=N):
    forgetting = np.exp(-1.0 / memory)
    steps = rng.normal(size=n + 2000) * np.sqrt(1 - forgetting**2)
    return size * lfilter([1.0], [1.0, -forgetting], steps)[2000:]


def record(rng, n=N, *, gain=0.0, load=0.0, spring=0.0, friction=0.0, sigma=SIGMA, colour=0.0):
    u = np.repeat(rng.uniform(-1.0, 1.0, -(-n // 12)), 12)[:n]
    machine = ODESimulator(
        disturbed,
        dt=DT,
        parameters={"gain": 4.4, "damping": 1.2, "stiffness": 19.0},
        states=["position [m]", "velocity [m/s]"],
        inputs=["drive [V]", "gain's", "load", "spring's", "friction"],
    )
    hidden = [np.broadcast_to(signal, n) for signal in (gain, load, spring, friction)]
    y = machine.simulate(np.column_stack([u, *hidden]))[:, 0]
    noise = lfilter([np.sqrt(1 - colour**2)], [1.0, -colour], rng.normal(size=n))
    return u[:, None], (y + sigma * noise)[:, None]


def fitted(u, y, effects=()):
    """Return the problem of the oscillator, its fit, and its structure."""
    sim = make_oscillator()
    windows = cut([(slice(0, len(u)), 0)], 250, 4)
    problem = Problem(sim, u, y, windows, Noise.white(np.array([SIGMA])))
    x0 = np.column_stack([np.nan_to_num(y[windows.first, 0]), np.zeros(windows.count)])
    found = fit(problem, Model(sim.nominal, effects, x0))
    return problem, found, find_structure(sim, problem.run(found.model).x, u)


def dense_deviance(beside, entrance, phi, w_var):
    """Return minus twice the log-likelihood under white noise from one covariance matrix; a slow twin."""
    covered = beside.covered
    n, n_states = covered.A.shape[:2]
    starts = np.concatenate([[0], np.flatnonzero(covered.seam[:-1] != 0) + 1, [n]])
    to_outputs = np.zeros((n, n))
    initial = np.zeros((n, n_states * (starts.size - 1)))
    for w, (first, last) in enumerate(pairwise(starts)):
        for k in range(first, last):
            x = np.zeros(n_states)
            to_outputs[k, k] = entrance.d[k, 0]
            x = entrance.g[k].copy()
            for later in range(k + 1, last):
                to_outputs[later, k] = covered.C[later, 0] @ x
                x = covered.A[later] @ x
        travelled = np.eye(n_states)
        for k in range(first, last):
            initial[k, w * n_states : (w + 1) * n_states] = covered.C[k, 0] @ travelled
            travelled = covered.A[k] @ travelled
    apart = np.abs(np.subtract.outer(covered.samples, covered.samples))
    V = np.eye(n) + to_outputs @ (w_var * phi**apart) @ to_outputs.T
    inverse = np.linalg.inv(V)
    b, X = covered.b[:, 0, 0], np.column_stack([initial, beside.responses[:, 0]])
    left = (
        b
        - X
        @ np.linalg.lstsq(np.linalg.cholesky(inverse).T @ X, np.linalg.cholesky(inverse).T @ b, rcond=None)[0]
    )
    degrees = n - initial.shape[1]
    return (
        degrees * np.log(left @ inverse @ left / degrees)
        + np.linalg.slogdet(V)[1]
        + np.linalg.slogdet(initial.T @ inverse @ initial)[1]
    )


@pytest.mark.parametrize("entry", ["load", "factor"])
def test_the_likelihood_is_that_of_one_covariance_matrix(rng, entry):
    u, y = record(rng, 120, load=wandering(rng, 8, 0.3, 120))
    sim = make_oscillator()
    windows = cut([(slice(0, 120), 0)], 60, 4)
    problem = Problem(sim, u, y, windows, Noise.white(np.array([1.0])))
    found = fit(problem, Model(sim.nominal, (), np.zeros((windows.count, 2))))
    run = problem.run(found.model)
    linear = tangent(sim, run, u, windows, found.model.p)
    responses = np.zeros((120, 1, 3))
    responses[problem.rows[problem.inside]] = rng.normal(size=(120, 1, 3))
    beside = BesideFit.of(linear, y - run.y, windows, responses)
    entry = Entry(Port("state", 1), None if entry == "load" else run.x[:, 0])
    entrance = Entrance.of(linear, beside.covered, entry, beside.against.sigma)

    def both(w_var, memory):
        course = Course(entry, memory, Likeliest(w_var, Colour.of(np.zeros(1)), 0.0))
        dense = dense_deviance(beside, entrance, np.exp(-1.0 / memory), w_var)
        return beside.deviance(course), dense

    ours, dense = np.transpose([both(0.0, 8.0), both(0.5, 8.0), both(30.0, 2.0), both(30.0, 50.0)])
    np.testing.assert_allclose(np.diff(ours), np.diff(dense), atol=1e-3 * np.ptp(dense))


def test_a_force_between_two_states_is_taken_off_the_other(rng):
    u, y = record(rng, 300)
    problem, found, _ = fitted(u, y)
    run = problem.run(found.model)
    linear = tangent(problem.simulator, run, u, problem.windows, found.model.p)
    covered = cover(linear, y - run.y, problem.windows, np.ones(1))
    one, other = (Entrance.of(linear, covered, Entry(Port("state", i)), np.ones(1)) for i in (0, 1))
    both = Entrance.of(linear, covered, Entry(Port("state", 0), None, 1, 0.3), np.ones(1))
    np.testing.assert_array_equal(both.g, one.g - 0.3 * other.g)


@pytest.mark.parametrize("colour", [0.0, 0.9, 0.99])
def test_noise_of_a_sensor_is_no_force(colour):
    found = []
    for seed in range(5):
        u, y = record(np.random.default_rng(seed), sigma=5 * SIGMA, colour=colour)
        problem, fit, structure = fitted(u, y)
        found.append(look_for_unforeseen(problem, fit.model, structure).p_value)
    assert min(found) > LEVEL


def heated(x, u, p):
    """A block that is heated and warms its casing, beside a source that its simulator has not."""
    across = x[0] - x[1]
    return p[0] * (u[0] + u[1]) - p[1] * across, p[2] * across - p[3] * x[1]


def fitted_heater(seed, *, walk, load=0.0, memory=100, dt=2.5, sigma=0.02):
    """Return what :func:`fitted` does for the block, both of its sensors walking off in their own way."""
    rng = np.random.default_rng(seed)
    names = {
        "parameters": {"heating": 2e-3, "contact": 0.012, "casing": 0.016, "loss": 0.005},
        "states": ["block [K]", "casing [K]"],
        "output": lambda x, u, p: (x[0], x[1]),
        "outputs": ["block [K]", "casing [K]"],
    }
    machine = ODESimulator(heated, dt=dt, inputs=["heater [W]", "other [W]"], **names)
    simulator = ODESimulator(lambda x, u, p: heated(x, (u[0], 0.0), p), dt=dt, inputs=["heater [W]"], **names)
    u = np.repeat(rng.uniform(0.0, 100.0, N // 40), 40)
    y = machine.simulate(np.column_stack([u, wandering(rng, memory, load)]))
    walks = np.cumsum(rng.normal(size=(N, 2)), axis=0) / np.sqrt(N / 2)
    y += sigma * (0.8 * rng.normal(size=(N, 2)) + walk * walks)
    windows = cut([(slice(0, N), 0)], N // 2, 4)
    problem = Problem(simulator, u[:, None], y, windows, Noise.white(np.full(2, sigma)))
    found = fit(problem, Model(simulator.nominal, (), y[windows.first]))
    return problem, found, find_structure(simulator, problem.run(found.model).x, u[:, None])


@pytest.mark.parametrize(("seed", "walk"), [(10, 0.6), (0, 1.5), (3, 1.5), (4, 1.5), (14, 1.5)])
def test_sensors_that_walk_off_each_in_its_own_way_are_no_force(seed, walk):
    problem, found, structure = fitted_heater(seed, walk=walk)
    assert look_for_unforeseen(problem, found.model, structure).p_value > LEVEL


@pytest.mark.parametrize(
    ("seed", "walk"),
    [(1, 0.0), *(pytest.param(*draw, marks=pytest.mark.long) for draw in [(2, 0.0), (1, 0.6), (2, 0.6)])],
)
def test_a_load_is_found_that_a_refit_takes_into_its_parameters(seed, walk):
    problem, found, structure = fitted_heater(seed, walk=walk, load=1.0)
    seen = look_for_unforeseen(problem, found.model, structure)
    assert seen.acting.entry.port == Port("state", 0)
    assert seen.p_value < 1e-6
    before = np.abs(found.model.p / problem.simulator.nominal - 1.0)
    beside, again = fitted_beside(problem, found, seen)
    assert (np.abs(beside.model.p / problem.simulator.nominal - 1.0) < before).sum() >= 3
    assert (np.abs(beside.model.p - problem.simulator.nominal) < 4 * again.errors).all()


def test_white_noise_over_a_walk_is_an_autoregression_with_a_moving_average(rng):
    colour = Colour(np.array([0.98, 0.9]), np.array([0.5, 3.0]), np.array([0.8, 0.1]))
    noise = noise_left(Refined(np.zeros(0), np.zeros(0), np.array([1.0, 10.0]), colour))
    for output, unit in enumerate((1.0, 10.0)):
        rho, coloured, white = (part[output] for part in colour)
        lags = np.arange(200)
        expected = unit**2 * (coloured * rho**lags + np.where(lags == 0, white, 0.0))
        a, b = noise.colour(output)
        impulse = lfilter([1.0, -b], [1.0, -a[0]], np.eye(1, 5000)[0]) * noise.sigma[output]
        ours = [impulse[: 5000 - k] @ impulse[k:] for k in lags]
        np.testing.assert_allclose(ours, expected, rtol=1e-6, atol=1e-9 * unit**2)


@pytest.mark.parametrize(
    ("hidden", "port", "title"),
    [("load", "state:1", ADDED), ("gain", "input:0", GAIN), ("spring", "state:1", FACTOR)],
)
def test_what_follows_no_signal_is_found_where_it_acts(rng, hidden, port, title):
    course = wandering(rng, 100, {"load": 0.15, "gain": 0.2, "spring": 0.2}[hidden])
    u, y = record(rng, **{hidden: course})
    problem, found, structure = fitted(u, y)
    seen = look_for_unforeseen(problem, found.model, structure)
    assert (str(seen.acting.entry.port), seen.acting.title) == (port, title)
    assert seen.p_value < 1e-6
    # its course is that of what was hidden
    entry, run = seen.acting.entry, problem.run(found.model)
    linear = tangent(problem.simulator, run, u, problem.windows, found.model.p)
    force = latent_force(linear, y - run.y, problem.windows, entry, memory=seen.memory)
    acts = np.abs(entry.times) > 0.3 * np.abs(entry.times).max() if entry.times is not None else slice(None)
    sign = -1.0 if hidden == "spring" else 1.0
    assert sign * np.corrcoef(force.w[acts], course[acts])[0, 1] > 0.8


def test_an_input_is_in_proportion_from_zero_or_from_where_it_mostly_is(rng):
    u, y = record(rng, 600)
    problem, found, structure = fitted(u + 5.0, y)
    places = factors_inside(problem, problem.run(found.model).x, structure)
    signals = [acting.entry.times for acting in places if acting.entry.port.kind == "input"]
    assert [round(float(np.median(signal))) for signal in signals] == [5, 0]


@pytest.mark.parametrize("load", [0.0, 0.15])
def test_a_law_that_is_right_stands_beside_a_disturbance(rng, load):
    u, y = record(rng, friction=0.3, load=wandering(rng, 40, load))
    friction = PlacedEffect(CATALOGUE["coulomb_friction"], Port("state", 1), (0.0, 1.0), theta=(0.2,))
    problem, alone, structure = fitted(u, y)
    _, told, _ = fitted(u, y, (friction,))
    seen = look_for_unforeseen(problem, alone.model, structure)
    candidates = [Candidate(found, problem.n_seen) for found in (alone, told)]
    leading = which_leads(problem, seen, candidates[0], beside_laws(problem, candidates[1], structure, LEVEL))
    assert leading is None or leading[0] is candidates[1]
    assert leave_little(problem, seen, *candidates) == (load == 0)


def test_a_law_that_stands_in_for_a_disturbance_does_not(rng):
    u, y = record(rng, load=wandering(rng, 40, 0.15))
    line = PlacedEffect(CATALOGUE["periodic_disturbance"], Port("state", 1), theta=(0.1, 2.0, 0.0))
    problem, alone, structure = fitted(u, y)
    _, told, _ = fitted(u, y, (line,))
    seen = look_for_unforeseen(problem, alone.model, structure)
    candidates = [Candidate(found, problem.n_seen) for found in (alone, told)]
    worth = beside_laws(problem, candidates[1], structure, LEVEL)
    leading, _ = which_leads(problem, seen, candidates[0], worth)
    assert leading is candidates[0]
    assert not leave_little(problem, seen, *candidates)


@pytest.mark.parametrize(("wanders", "swings", "stay"), [(0.15, 0.0, 1), (0.15, 0.5, 2), (0.0, 0.0, 2)])
def test_a_name_beside_another_one_has_to_pay_beside_a_disturbance(rng, wanders, swings, stay):
    """Where none acts, another test says what is noise."""
    swing = swings * np.sin(2.0 * DT * np.arange(N))
    u, y = record(rng, friction=0.3, load=wandering(rng, 40, wanders) + swing)
    friction = PlacedEffect(CATALOGUE["coulomb_friction"], Port("state", 1), (0.0, 1.0), theta=(0.2,))
    line = PlacedEffect(CATALOGUE["periodic_disturbance"], Port("state", 1), theta=(0.1, 2.0, 0.0))
    problem, found, structure = fitted(u, y, (friction, line))
    told = Candidate(found, problem.n_seen)
    left, seen = that_pay(problem, beside_laws(problem, told, structure, LEVEL), structure, LEVEL)
    assert [e.effect.code for e in left.effects] == ["coulomb_friction", "periodic_disturbance"][:stay]
    assert (left is told) == (stay == 2)
    assert (seen is not None) == (wanders > 0)
    assert seen is None or (seen.acting.title, str(seen.acting.entry.port)) == (ADDED, "state:1")


def test_names_are_not_asked_to_pay_beside_what_a_twin_gets_wrong():
    twin = object.__new__(TwinSimulator)
    searched = SimpleNamespace(problem=SimpleNamespace(simulator=twin))
    said = Judgement("explained", None, (), None)
    settings = SimpleNamespace(n_jobs=1)
    assert diagnosis._beside(said, None, searched, None, settings) is said


def test_a_drift_pays_for_itself_beside_a_disturbance_or_is_none(rng):
    drift = PlacedEffect(CATALOGUE["additive_drift"], Port("state", 1), theta=(0.5, 20.0, 0.0, 0.0))
    slow = 0.6 * (1 - np.exp(-DT * np.arange(N) / 20.0))
    for load, is_told in ((slow, True), (wandering(rng, 400, 0.3), False)):
        u, y = record(rng, load=load)
        problem, alone, structure = fitted(u, y)
        _, told, _ = fitted(u, y, (drift,))
        seen = look_for_unforeseen(problem, alone.model, structure)
        candidates = [Candidate(found, problem.n_seen) for found in (alone, told)]
        assert not leave_little(problem, seen, *candidates)
        worth = beside_laws(problem, candidates[1], structure, LEVEL)
        leading = which_leads(problem, seen, candidates[0], worth)
        assert (leading is None) == is_told


@pytest.mark.parametrize(
    ("hidden", "code", "theta", "weights", "is_told"),
    [
        ("friction", "coulomb_friction", (0.2,), (0.0, 1.0), True),
        ("load", "periodic_disturbance", (0.1, 2.0, 0.0), (), False),
        ("load", "cubic_stiffness", (0.1,), (1.0, 0.0), False),
    ],
)
def test_laws_foretell_the_other_half_and_stand_ins_do_not(rng, hidden, code, theta, weights, is_told):
    acting = 0.3 if hidden == "friction" else wandering(rng, 40, 0.15)
    u, y = record(rng, **{hidden: acting})
    law = PlacedEffect(CATALOGUE[code], Port("state", 1), weights, theta=theta)
    problem, alone, _ = fitted(u, y)
    _, told, _ = fitted(u, y, (law,))
    assert told.cost < alone.cost
    assert are_foretelling(problem, alone.model, told.model) is is_told
    # a second reading in another unit, far larger and of nothing but noise, changes nothing
    noisy = 1e6 * rng.normal(size=u.shape)
    simulator = ODESimulator(
        oscillator,
        dt=DT,
        parameters=dict(zip(("gain", "damping", "stiffness"), problem.simulator.nominal, strict=True)),
        states=["position [m]", "velocity [m/s]"],
        inputs=["drive [V]"],
        output=lambda x, u, p: (x[0], 0.0 * x[0]),
        outputs=["position [m]", "hum [um]"],
    )
    both = Problem(simulator, u, np.hstack([y, noisy]), problem.windows, Noise.white(np.array([SIGMA, 1e6])))
    assert are_foretelling(both, alone.model, told.model) is is_told


def test_one_window_foretells_nothing(rng):
    u, y = record(rng, 600, friction=0.3)
    simulator = make_oscillator()
    problem = Problem(simulator, u, y, cut([(slice(0, 600), 0)], 600, 8), Noise.white(np.ones(1)))
    base = Model(simulator.nominal, (), np.zeros((1, 2)))
    assert np.isnan(share_foretold(problem, base, base))
    assert not are_foretelling(problem, base, base)


@pytest.fixture(scope="module")
def dropping_out():
    """A diagnosis of a machine whose input drops out now and then."""
    rng = np.random.default_rng(4)
    phase = np.arange(N) / 190 + 0.3 * np.sin(np.arange(N) / 310)
    u, y = record(rng, gain=np.where(phase % 1.0 < 0.1, -1.0, 0.0))
    dx = DiscrepancyRegressor(make_oscillator(), effects=FEW).fit(u, y)
    return dx, u, y


@pytest.mark.long
def test_an_input_that_drops_out_is_told(dropping_out):
    dx, *_ = dropping_out
    (finding,) = dx.findings_
    assert (dx.verdict_, finding.effect) == ("unknown", "unknown")
    assert (finding.port, finding.title) == ("input:0", GAIN)
    assert finding.evidence["unforeseen"] < 1e-6
    assert not finding.modelled
    low, high = finding.adds
    assert low < -0.3  # of a drive of 1 V
    assert high > 0.3
    assert "by itself" in dx.report_
    assert headline(dx).startswith("A parameter of the simulation is not always the same")


@pytest.mark.long
def test_its_course_is_kept(dropping_out):
    dx, u, _ = dropping_out
    course = dx.location_.force
    assert list(course.columns) == ["sample", "force", "deviation"]
    samples = course["sample"].to_numpy()
    phase = samples / 190 + 0.3 * np.sin(samples / 310)
    out = phase % 1.0 < 0.1
    force, drive = course["force"].to_numpy(), u[samples, 0]
    assert np.corrcoef(force[out], -drive[out])[0, 1] > 0.8
    assert np.sqrt(np.mean(force[~out] ** 2)) < 0.3 * np.sqrt(np.mean(force[out] ** 2))
    assert dx.location_.ports.loc[0, "kind"] == "input"


@pytest.mark.long
def test_parameters_are_fitted_beside_it(dropping_out):
    dx, *_ = dropping_out
    table = dx.parameters_
    truth = np.array([0.9 * 4.4, 1.2, 19.0])  # the drive is off a tenth of the time; a course has no mean
    missed = np.abs(table[["refitted", "augmented"]].sub(truth, axis=0))
    assert (missed["augmented"] < missed["refitted"]).all()
    inside = (table["augmented_low"] < truth) & (truth < table["augmented_high"])
    assert inside.all()
    noise = dx.noise_["position [m]"]
    assert noise["sigma"] == pytest.approx(SIGMA, rel=0.1)
    assert noise["deviation"] == pytest.approx(SIGMA, rel=0.1)
    assert "Fitted beside what acts by itself" in dx.report_


@pytest.mark.long
def test_nothing_is_added_to_the_simulation(dropping_out):
    dx, *_ = dropping_out
    assert dx.simulator_.effects == ()
    # held-out samples are disturbed too, and a refit holds a part of that
    errors = dx.scores_["nrmse"]
    kept = "refitted" if errors["refitted"] < errors["augmented"] else "augmented"
    np.testing.assert_allclose(dx.simulator_.nominal, dx.parameters_[kept])
    assert ("refitted parameters, which hold a part" in dx.report_) == (kept == "refitted")


@pytest.mark.long
def test_the_report_draws_its_course(dropping_out, tmp_path):
    pytest.importorskip("matplotlib")
    pytest.importorskip("jinja2")
    dx, u, y = dropping_out
    write_report(dx, tmp_path / "report.html", u, y)
    text = (tmp_path / "report.html").read_text(encoding="utf-8")
    assert "its course, two standard errors to either side" in text


@pytest.mark.long
def test_what_acts_beside_a_name_is_told_and_the_name_fitted_beside_it(rng):
    """Its load, taken for noise of a colour, bends the friction to 0.62, 0.604 to 0.642."""
    u, y = record(rng, friction=0.6, load=wandering(rng, 40, 0.08))
    dx = DiscrepancyRegressor(make_oscillator(), effects=FEW).fit(u, y)
    assert dx.verdict_ in ("explained", "ambiguous")
    (finding,) = dx.findings_
    assert finding.effect == "coulomb_friction"
    assert "Beside these something acts in the equation of velocity that follows no signal" in dx.report_
    assert "Fitted beside what acts by itself" in dx.report_
    ((lower, upper),) = (finding.intervals[name] for name in finding.parameters)
    assert lower < 0.6 < upper
    assert upper - lower < 0.05
    assert finding.confidence > 0.5
    assert dx.noise_["position [m]"]["deviation"] == pytest.approx(SIGMA, rel=0.1)  # the sensor's alone


@pytest.mark.long
def test_a_name_that_stands_in_for_what_acts_beside_another_is_not_told(rng):
    """A gain that drifts stood beside the friction; what wanders says more than either, and goes first."""
    u, y = record(rng, friction=0.3, load=wandering(rng, 40, 0.15))
    dx = DiscrepancyRegressor(make_oscillator(), effects=FEW).fit(u, y)
    assert dx.verdict_ == "unknown"
    load, friction = dx.findings_
    assert load.title == ADDED
    assert friction.effect == "coulomb_friction"
    ((lower, upper),) = (friction.intervals[name] for name in friction.parameters)
    assert lower < 0.3 < upper
    assert upper - lower < 0.1


def test_a_simulation_that_was_corrected_is_fitted_beside_it_too(rng):
    u, y = record(rng, friction=0.2, load=wandering(rng, 40, 0.15))
    friction = PlacedEffect(CATALOGUE["coulomb_friction"], Port("state", 1), (0.0, 1.0), theta=(0.2,))
    problem, alone, structure = fitted(u, y, (friction,))
    seen = look_for_unforeseen(problem, alone.model, structure)
    found, seen = fitted_beside(problem, alone, seen)
    assert seen.errors.shape == found.model.q.shape
    assert found.model.effects[0].theta[0] == pytest.approx(0.2, abs=4 * seen.errors[-1])
    assert (np.abs(found.model.p - (4.4, 1.2, 19.0)) < 4 * seen.errors[:3]).all()


@pytest.mark.parametrize("factor", [0.3, 2.0])
def test_steps_beside_it_are_as_long_as_they_help(rng, factor):
    # whole Gauss-Newton steps from there stop at a friction of 0.17 and 0.14, eight errors away
    u, y = record(rng, friction=0.2, load=wandering(rng, 40, 0.15))
    friction = PlacedEffect(CATALOGUE["coulomb_friction"], Port("state", 1), (0.0, 1.0), theta=(0.2,))
    problem, alone, structure = fitted(u, y, (friction,))
    seen = look_for_unforeseen(problem, alone.model, structure)
    far = fit_states(problem, alone.model.with_q(alone.model.q * (1.0, 1.0, factor, 1.0)))
    found, seen = fitted_beside(problem, far, seen)
    assert (np.abs(found.model.p - (4.4, 1.2, 19.0)) < 4 * seen.errors[:3]).all()
    assert found.model.effects[0].theta[0] == pytest.approx(0.2, abs=0.01)


def test_a_step_with_which_a_run_diverges_is_not_taken(rng, monkeypatch):
    u, y = record(rng, 800, load=wandering(rng, 40, 0.15, 800))
    problem, alone, structure = fitted(u, y)
    seen = look_for_unforeseen(problem, alone.model, structure)
    far = fit_states(problem, alone.model.with_q(alone.model.q * (1.0, 1.0, 1.3)))
    asked = []

    def astray(problem, model):
        asked.append(model.p[2])
        wild = model if len(asked) % 2 == 0 else model.with_q(model.q * (1.0, 1e4, 1.0))
        return fit_states(problem, wild)

    monkeypatch.setattr(unforeseen, "fit_states", astray)
    found, _ = fitted_beside(problem, far, seen)
    assert len(asked) >= 2
    assert np.isfinite(found.cost)
    assert found.cost < far.cost
