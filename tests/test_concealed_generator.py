"""The concealed cases: independent of the package, true where nothing is hidden, as deep as asked."""

import ast
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from scipy.interpolate import CubicSpline

ROOT = Path(__file__).resolve().parents[1]
if not (ROOT / "benchmarks" / "concealed" / "case.py").is_file():
    pytest.skip("benchmarks are not part of this distribution", allow_module_level=True)
sys.path.insert(0, str(ROOT))

from benchmarks.concealed import bounds, excitation, judge, noise  # noqa: E402
from benchmarks.concealed.case import DEPTH_TOLERANCE, build_case  # noqa: E402
from benchmarks.concealed.cells import CELLS, recipes  # noqa: E402
from benchmarks.concealed.diagnose import diagnose  # noqa: E402
from benchmarks.concealed.experiment import perform, rig_of  # noqa: E402
from benchmarks.concealed.hidden import Rig  # noqa: E402
from benchmarks.concealed.make import make  # noqa: E402
from benchmarks.concealed.plants.codes import CATALOGUE, FURTHER_OUTSIDE, OUTSIDE, THIRD_OUTSIDE, Code, Kind  # noqa: E402
from benchmarks.concealed.plants.dispatch import MACHINES, hidden_rates, nominal_rates  # noqa: E402
from benchmarks.concealed.plants.forces import friction  # noqa: E402
from benchmarks.concealed.plants.inputs import act  # noqa: E402
from benchmarks.concealed.plants.integrate import UNFORCED, run_nominal  # noqa: E402
from benchmarks.concealed.plants.machine import on_output  # noqa: E402
from benchmarks.concealed.plants.sensors import sense  # noqa: E402
from benchmarks.concealed.score import clearly_missed, score  # noqa: E402
from benchmarks.concealed.sealing import read_json, sha256, write_json  # noqa: E402
from benchmarks.concealed.specs import Concealed, Spec  # noqa: E402
from benchmarks.concealed.twins import chance_of_truth, could_be_told, nearest_twin  # noqa: E402

FOLDER = ROOT / "benchmarks" / "concealed"
MAY_IMPORT_THE_PACKAGE = {"diagnose.py"}  # the only file that meets the diagnosis
MODULES = sorted(path.relative_to(FOLDER) for path in FOLDER.rglob("*.py"))

per_machine = pytest.mark.parametrize("name", MACHINES)


def imported(path):
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            yield node.module or ""


def rig_for(name, **changes):
    machine = MACHINES[name]
    return replace(Rig(machine, dict(machine.constants), False, "white", np.zeros(1), (), 1.0), **changes)


@pytest.mark.parametrize("module", MODULES, ids=str)
def test_no_import_leads_from_the_generator_to_the_package(module):
    if module.name in MAY_IMPORT_THE_PACKAGE:
        return
    assert not [name for name in imported(FOLDER / module) if name.split(".")[0] == "narx_sklearn"]


def test_what_makes_the_cases_does_not_reach_the_diagnosis_either():
    reached, waiting = set(), ["make.py", "experiment.py"]
    while waiting:
        module = waiting.pop()
        reached.add(module)
        for name in imported(FOLDER / module):
            parts = name.split(".")[2:]
            path = Path(*parts).with_suffix(".py") if parts else None
            if name.startswith("benchmarks.concealed.") and (FOLDER / path).exists():
                waiting += [str(path)] if str(path) not in reached else []
    assert "diagnose.py" not in reached
    assert "plants/integrate.py" in {Path(m).as_posix() for m in reached}


@per_machine
def test_hidden_and_nominal_rates_agree_at_the_true_parameters(name):
    rng = np.random.default_rng(0)
    machine = MACHINES[name]
    number = list(MACHINES).index(name)
    x, u = rng.normal(size=len(machine.states)), rng.normal(size=len(machine.inputs))
    c = np.array(list(machine.constants.values()))
    p = np.array(list(machine.parameters(**machine.constants).values()))
    hidden, nominal = np.empty(x.size), np.empty(x.size)
    hidden_rates(number, x, u, c, hidden)
    nominal_rates(number, x, u, p, nominal)
    np.testing.assert_allclose(hidden, nominal, rtol=1e-12)
    np.testing.assert_allclose(machine.nominal(x, u, p), nominal, rtol=1e-12)


@per_machine
def test_without_effects_runge_kutta_at_the_sampling_period_follows_well_below_the_noise(name):
    machine = MACHINES[name]
    rig = rig_for(name)
    u = rig.command("prvs", 600, np.random.default_rng(1))
    recording = rig.record(u, np.random.default_rng(0))
    p = np.array(list(rig.parameters.values()))
    states = run_nominal(list(MACHINES).index(name), p, rig.rest()[None], u, 600, machine.dt, UNFORCED)
    error = np.std(states[:, list(machine.measured)] - recording.clean, axis=0) / np.std(
        recording.clean, axis=0
    )
    assert np.all(error < 0.1 * 0.005)  # a tenth of the smallest noise


def test_what_a_sensor_tells_late_was_its_curve_between_the_samples():
    """A cubic spline stands for the curve; straight lines would be off by ten times as much."""
    rig = rig_for("two_tanks")
    site = next(site for site in rig.machine.sites[Code.delay] if site.kind == Kind.output)
    late = np.array([0.4 * rig.machine.dt, *np.zeros(7)])
    u = rig.command("multisine", 400, np.random.default_rng(1))
    runs = [
        rig.with_effects(effects).record(u, np.random.default_rng(0)).clean[:, site.index]
        for effects in ((), [(Concealed(Code.delay, site, 1.0), late)])
    ]
    at = np.arange(400.0)
    curve, straight = CubicSpline(at, runs[0])(at - 0.4), np.interp(at - 0.4, at, runs[0])
    error, of_lines = (np.std((told - runs[1])[20:-20]) for told in (curve, straight))
    assert error < 0.1 * of_lines


@pytest.mark.parametrize("first", [0, 1])
def test_what_acts_on_a_command_that_is_late_acts_however_the_two_are_listed(first):
    rig = rig_for("mass_spring_damper")
    site = rig.machine.sites[Code.input_polynomial][0]
    late = Concealed(Code.delay, site, 1.0), np.array([0.7 * rig.machine.dt, *np.zeros(7)])
    bent = Concealed(Code.input_polynomial, site, 1.0), np.array([0.3, *np.zeros(7)])
    u = rig.command("multisine", 200, np.random.default_rng(1))

    def run(*effects):
        return rig.with_effects(effects).record(u, np.random.default_rng(0)).clean

    both = run(*((late, bent) if first else (bent, late)))
    assert np.max(np.abs(both - run(late))) > 0.01 * np.ptp(both)
    assert np.max(np.abs(both - run(bent))) > 0.01 * np.ptp(both)


@per_machine
def test_a_machine_rests_at_its_working_point(name):
    rig = rig_for(name)
    u = np.full((50, len(rig.machine.inputs)), rig.machine.offset)
    states = rig.record(u, np.random.default_rng(0)).states
    np.testing.assert_allclose(states, np.broadcast_to(rig.rest(), states.shape), rtol=1e-9, atol=1e-12)


@pytest.mark.parametrize(
    ("code", "theta", "gain", "offset"),
    [
        (Code.sensor_memory, (0.3, 5.0), 1.0, 0.3),  # magnetised no more than all of it
        (Code.creep, (0.2, 50.0), 1.2, 0.0),
        (Code.lag, (50.0,), 1.0, 0.0),
    ],
)
@pytest.mark.parametrize("name", ["heated_mass", "two_tanks"])
def test_a_sensor_of_a_machine_at_rest_reads_what_it_always_will(name, code, theta, gain, offset):
    """Both machines rest far from zero, where a memory that began anywhere would be seen to fade."""
    site = on_output()
    numbers = np.zeros(8)
    numbers[: len(theta)] = theta
    rig = rig_for(name, effects=((Concealed(code, site, 1.0), numbers),))
    run = rig.record(np.full((200, len(rig.machine.inputs)), rig.machine.offset), np.random.default_rng(0))
    read, true = run.clean[:, site.index], run.states[:, rig.machine.measured[site.index]]
    np.testing.assert_allclose(read, read[0], rtol=1e-9)
    assert abs(read[0] - gain * true[0]) <= offset + 1e-9 * true[0]


@pytest.mark.parametrize(
    ("name", "code"),
    [
        ("mass_spring_damper", Code.cubic_stiffness),
        ("pendulum", Code.stribeck_friction),
        ("two_tanks", Code.overflow),
        ("dc_motor", Code.input_saturation),
        ("rlc", Code.quantisation),
        ("heated_mass", Code.coupling),
    ],
)
def test_an_effect_is_as_deep_as_asked(name, code):
    site = MACHINES[name].sites[code][0]
    spec = Spec("T2", "", name, (Concealed(code, site, 0.5),), "white", "prvs", False, (3, 4), n_samples=1000)
    case = build_case(spec)
    assert abs(np.log(case.depths[0] / 0.5)) < DEPTH_TOLERANCE
    assert case.fit.ratio == pytest.approx(case.depths[0])


def test_nothing_concealed_leaves_nothing_but_noise():
    spec = Spec("T0", "", "servo_axis", (), "ar1", "prfs", True, (1,), n_samples=1000)
    assert build_case(spec).fit.ratio < 0.01


@pytest.mark.parametrize("w", [0.01, 0.3, 3.0])
def test_a_sine_stands_out_of_coloured_noise_as_the_noise_is_weak_at_its_frequency(w):
    sine = 0.1 * np.sin(w * np.arange(20_000))[:, None]
    plain = noise.stands_out(sine, "white")
    assert plain == pytest.approx(0.1 * np.sqrt(10_000), rel=1e-2)
    power_of_noise = (1 - 0.9**2) / abs(1 - 0.9 * np.exp(-1j * w)) ** 2
    assert noise.stands_out(sine, "ar1") == pytest.approx(plain / np.sqrt(power_of_noise), rel=1e-2)


def test_a_mass_under_less_than_breakaway_stays_exactly_at_rest():
    site = MACHINES["mass_spring_damper"].sites[Code.coulomb_friction][0]
    theta = np.array([2.0, 0, 0, 0, 0, 0, 0, 0])  # m/s^2; the drive makes 5 N/V / 1.2 kg * 0.4 V = 1.67
    rig = rig_for("mass_spring_damper", effects=((Concealed(Code.coulomb_friction, site, 1.0), theta),))
    assert np.all(rig.record(np.full((200, 1), 0.4), np.random.default_rng(0)).states == 0.0)
    assert rig.record(np.full((200, 1), 0.6), np.random.default_rng(0)).states[-1, 0] > 0.01


def test_friction_holds_more_than_it_slides_where_stribeck_says_so():
    theta = np.array([2.0, 1.5, 0.1, 0, 0, 0, 0, 0])
    slide, hold, *_ = friction(Code.stribeck_friction, theta, 10.0, 0.0)
    assert hold == 3.0
    assert slide == pytest.approx(2.0, rel=1e-3)
    assert friction.py_func(Code.stribeck_friction, theta, 0.0, 0.0)[0] == 3.0


def test_stiction_holds_then_jumps():
    theta, z = np.array([0.5, 0.2, 0, 0, 0, 0, 0, 0]), np.zeros(24)
    outputs = [act.py_func(Code.valve_stiction, theta, u, 0.0, 0.1, z) for u in (0.4, 0.5, 0.6, 0.7)]
    assert outputs == pytest.approx([0.0, 0.0, 0.4, 0.4])


def test_compliant_play_loses_its_width_at_a_reversal():
    theta, z = np.array([0.1, 0, 0, 0, 0, 0, 0, 0]), np.zeros(24)
    up = [act(Code.backlash, theta, u, 0.0, 0.1, z) for u in np.linspace(0.0, 1.0, 50)]
    down = [act(Code.backlash, theta, u, 0.0, 0.1, z) for u in np.linspace(1.0, 0.0, 50)]
    assert up[-1] == pytest.approx(0.9)  # mean half-width 0.1 behind
    assert down[-1] == pytest.approx(0.1)
    assert up[-1] == down[1]  # nothing moves yet


@pytest.mark.parametrize(("code", "number"), [(Code.rate_limit, 20.0), (Code.lag, 0.004)])
def test_what_follows_a_command_within_a_fine_step_does_as_much_as_in_much_finer_ones(code, number):
    """Its first moments over a sample of 0.1 s: what a mass would be moved by, and how far."""
    commands, lever = [0.0, 1.5, 1.4, -0.2, -0.2], []
    for n_fine in (20, 4000):
        h, z, reached = 0.1 / n_fine, np.zeros(24), []
        theta = np.array([number, 0, 0, 0, 0, 0, 0, 0])
        for u in commands:
            reached += [act(code, theta, u, 0.0, h, z) for _ in range(n_fine)]
        lacking = np.repeat(commands, n_fine) - np.array(reached)
        time = h * (np.arange(lacking.size) + 0.5)
        lever.append([np.sum(lacking) * h, np.sum(lacking * time) * h])
    np.testing.assert_allclose(lever[0], lever[1], rtol=0.02)


def test_a_quantised_reading_has_the_step_asked_for():
    assert sense(Code.quantisation, np.array([0.25, 0, 0, 0, 0, 0, 0, 0]), 0.6, 0.0, 0.1, np.zeros(24)) == 0.5


@pytest.mark.parametrize("kind", excitation.KINDS)
def test_inputs_stay_within_their_swing(kind):
    u = excitation.excite(kind, 2000, 0.01, 3.0, np.random.default_rng(2))
    assert u.shape == (2000,)
    assert np.max(np.abs(u)) <= 1.0 + 1e-12


@pytest.mark.parametrize("kind", [k for k in noise.NOISES if k != "quantised"])
def test_noise_has_unit_power(kind):
    e = noise.draw_noise(kind, 3000, 2, np.random.default_rng(3))
    np.testing.assert_allclose(np.mean(e**2, axis=0), 1.0)


def test_every_effect_of_the_catalogue_has_a_plant():
    placed = {code for machine in MACHINES.values() for code in machine.sites}
    assert {*CATALOGUE, *OUTSIDE, *FURTHER_OUTSIDE, *THIRD_OUTSIDE} == placed
    assert len(OUTSIDE) >= 12
    assert len(FURTHER_OUTSIDE) >= 8
    assert len(THIRD_OUTSIDE) >= 12


@pytest.mark.parametrize("cell", CELLS)
def test_recipes_repeat_and_fit_their_plants(cell):
    batches = recipes(cell, 3)
    assert batches
    assert repr(batches) == repr(recipes(cell, 3))
    assert repr(batches) != repr(recipes(cell, 4))
    for spec in (spec for options in batches for spec in options):
        assert all(e.site in MACHINES[spec.plant].sites[e.code] for e in spec.effects)
        assert spec.closed_loop or not MACHINES[spec.plant].closed_only


def test_a_run_may_be_made_of_some_strata_only(tmp_path):
    manifest = make(["T0"], [0, 1], tmp_path, n_samples=600, strata=["drifting", "closed loop"])
    strata = [read_json(tmp_path / "truth" / f"{name}.json")["stratum"] for name in manifest["cases"]]
    assert sorted(strata) == ["closed loop", "closed loop", "drifting", "drifting"]


def test_a_stratum_that_no_cell_has_is_refused(tmp_path):
    with pytest.raises(ValueError, match=r"no stratum \['closed_loop'\].*'closed loop'"):
        make(["T0"], [0], tmp_path, n_samples=600, strata=["closed_loop"])


def test_a_run_grows_and_what_was_made_before_stays(tmp_path):
    options = {"n_samples": 600, "strata": ["white"]}
    (first,) = make(["T0"], [0], tmp_path, **options)["cases"]
    recording = tmp_path / "cases" / first / "recording.csv"
    recording.write_text("as it was")
    manifest = make(["T0"], [0, 1], tmp_path, **options)
    assert len(manifest["cases"]) == 2
    assert first in manifest["cases"]
    assert read_json(tmp_path / "manifest.json") == manifest
    assert recording.read_text() == "as it was"


def test_a_case_on_disk_shows_nothing_of_its_truth_and_its_seal_holds(tmp_path):
    manifest = make(["T10"], [0], tmp_path, n_samples=600, effects=["clearance"])
    assert len(manifest["cases"]) == 1
    for name, seals in manifest["cases"].items():
        seen = " ".join(p.read_text(encoding="utf-8") for p in (tmp_path / "cases" / name).iterdir())
        assert "clearance" not in seen
        assert {p.name for p in (tmp_path / "cases" / name).iterdir()} == {
            "recording.csv",
            "heldout.csv",
            "nominal.py",
        }
        assert all(sha256(tmp_path / "truth" / file) == digest for file, digest in seals.items())
        truth = read_json(tmp_path / "truth" / f"{name}.json")
        u = np.load(tmp_path / "truth" / f"{name}.npz")["other_u"]
        again = rig_of(truth).record(u, np.random.default_rng(0)).clean
        np.testing.assert_allclose(
            again, np.load(tmp_path / "truth" / f"{name}.npz")["other_clean"], rtol=1e-9
        )


def test_a_proposed_experiment_is_run_beside_a_random_one_of_equal_energy(tmp_path):
    (name,) = make(["T8"], [0], tmp_path, n_samples=600, effects=["gravity"])["cases"]
    proposed = np.sin(0.1 * np.arange(300))[:, None]
    made = perform(tmp_path, {name: {"next_input": proposed.tolist()}})
    assert made == [f"{name}-next", f"{name}-random"]
    inputs = []
    for case in made:
        table = pd.read_csv(tmp_path / "experiments" / case / "recording.csv")
        assert table["session"].value_counts().to_dict() == {"training": 600, "experiment": 300}
        inputs.append(table.loc[table["session"] == "experiment"].iloc[:, 2].to_numpy())
    np.testing.assert_allclose(inputs[0], proposed[:, 0])
    assert np.std(inputs[1]) == pytest.approx(np.std(inputs[0]), rel=0.02)
    assert np.abs(inputs[1] - inputs[0].mean()).max() <= np.abs(inputs[0] - inputs[0].mean()).max() + 1e-9


@pytest.mark.parametrize(
    ("distance", "n_more", "chance"),
    [
        (2.0, 0, 0.841345),  # the ratio of likelihoods is two of its deviations of two ahead of nothing
        (0.0, 1, 1.0),  # of two that are the same the shorter one is told
        (0.0, 0, 0.5),
        (0.0, -1, 0.0),
        (np.inf, -1, 1.0),
    ],
)
def test_an_oracle_chooses_between_two_forms_by_their_likelihood(distance, n_more, chance):
    assert chance_of_truth(distance, n_more, 1000) == pytest.approx(chance, abs=1e-6)


def test_a_form_is_its_own_twin_holds_its_special_case_and_is_far_from_others():
    machine = MACHINES["mass_spring_damper"]
    rubbing = Concealed(Code.coulomb_friction, machine.sites[Code.coulomb_friction][0], 1.0)
    rig = rig_for(machine.name, effects=((rubbing, np.array([0.5, *[0.0] * 7])),), duration=400 * machine.dt)
    u = rig.command("prfs", 400, np.random.default_rng(0))
    clean = rig.record(u, np.random.default_rng(0)).clean
    sigma = np.full(1, 0.01 * np.std(clean))
    own, falling, delayed = (
        nearest_twin(rig, u, clean, sigma, code)
        for code in (Code.coulomb_friction, Code.stribeck_friction, Code.delay)
    )
    assert own.distance < 0.1
    assert own.n_numbers == 1
    assert falling.distance < 0.1
    assert falling.n_numbers == 3
    assert delayed.distance > 10.0


def test_what_an_oracle_would_name_is_told_by_stratum_and_noise(tmp_path):
    (name,) = make(["T8"], [0], tmp_path, n_samples=600, effects=["gravity"])["cases"]
    finding = {"effect": "gravity", "port": "state:1", "lookalikes": ["cubic_stiffness"]}
    (tmp_path / "verdicts").mkdir()
    file = tmp_path / "verdicts" / f"{name}.json"
    write_json(file, {"verdict": "ambiguous", "findings": [finding]})
    write_json(tmp_path / "verdicts.json", {file.name: sha256(file)})
    rivals, told = could_be_told(tmp_path)
    assert rivals[["truth", "rival"]].to_numpy().tolist() == [["gravity", "cubic_stiffness"]]
    assert told["right"].tolist() == [1.0]
    sees = read_json(tmp_path / "truth" / f"{name}.json")["oracle"]["z_in_colour"] > 5
    assert told["oracle_right"].tolist() == pytest.approx([sees * rivals["chance"][0]])


def test_a_name_forced_on_what_no_catalogue_has_is_held_against_its_distance(tmp_path):
    (name,) = make(["T6"], [0], tmp_path, n_samples=600, effects=["position_damping"])["cases"]
    finding = {"effect": "quadratic_drag", "port": "state:1", "lookalikes": []}
    (tmp_path / "verdicts").mkdir()
    file = tmp_path / "verdicts" / f"{name}.json"
    write_json(file, {"verdict": "explained", "findings": [finding]})
    write_json(tmp_path / "verdicts.json", {file.name: sha256(file)})
    rivals, told = could_be_told(tmp_path)
    assert rivals[["truth", "rival"]].to_numpy().tolist() == [["position_damping", "quadratic_drag"]]
    assert told[["stratum", "right"]].to_numpy().tolist() == [["outside", 0.0]]


@pytest.mark.long
def test_make_diagnose_and_score_run_end_to_end(tmp_path):
    make(
        ["T0", "T2"],
        [0],
        tmp_path,
        n_samples=1000,
        plants=["mass_spring_damper"],
        effects=["cubic_stiffness"],
    )
    diagnose(tmp_path, options={"effects": ["cubic_stiffness", "quadratic_drag"]})
    tables = score(tmp_path)
    assert not tables["cases"]["failed"].any()
    assert {"T0", "T2"} <= set(tables["cells"]["cell"])
    nulls = tables["cases"].query("cell == 'T0'")
    assert (nulls["n_intervals"] == 3).all()  # gain, damping, stiffness: of every one it is judged


def test_intervals_are_held_against_the_true_parameters():
    truth = truth_of(cell="T1") | {"parameters": {"gain [N/V]": 1.0, "damping [1/s]": 2.0}}
    verdict = verdict_of("refit") | {"parameters": {"gain": [1.1, 0.9, 1.3], "damping": [1.0, 0.5, 1.5]}}
    row = judge.judge(
        truth, verdict, {"other_clean": np.ones((3, 1)), "amplitude_clean": np.ones((3, 1))}, {}, None
    )
    assert (row["covered"], row["n_intervals"]) == (0.5, 2)


def verdict_of(said, *effects, port="state:1", lookalikes=()):
    findings = [{"effect": e, "port": port, "lookalikes": list(lookalikes)} for e in effects]
    return {"verdict": said, "findings": findings, "seconds": 1.0}


def truth_of(*effects, cell="T2", noise="white"):
    rows = [{"effect": e, "port": "state:1", "R": 0.5, "segment": [0, 10]} for e in effects]
    return {
        "case": "a",
        "cell": cell,
        "stratum": "",
        "plant": "rlc",
        "noise": noise,
        "seed": [0, 1],
        "effects": rows,
        "oracle": {"z_scores": [5.0] * len(rows), "z_in_colour": 9.0},
        "parameters": {},
        "n_samples": 10,
    }


@pytest.mark.parametrize(
    ("truth", "verdict", "measures"),
    [
        (truth_of("gravity"), verdict_of("explained", "gravity"), {"first_right": 1, "wrong_name": 0}),
        (truth_of("gravity"), verdict_of("explained", "creep"), {"first_right": 0, "wrong_name": 1}),
        (
            truth_of("gravity"),
            verdict_of("ambiguous", "cubic_stiffness", lookalikes=["gravity"]),
            {"first_right": 0, "wrong_name": 0, "set_holds": 1, "set_size": 2},
        ),
        (truth_of("gravity"), verdict_of("refit"), {"abstains": 1, "wrong_name": 0, "port_right": None}),
        (
            truth_of("shocks", cell="T6"),
            verdict_of("unknown", "unknown"),
            {"unknown_at_port": 1, "forced_name": 0},
        ),
        (truth_of("shocks", cell="T6"), verdict_of("explained", "gravity"), {"forced_name": 1}),
        (
            truth_of("gravity", "creep"),
            verdict_of("explained", "creep", "gravity"),
            {"exact_set": 1, "set_f1": 1},
        ),
        (truth_of(cell="T0"), verdict_of("refit"), {"false_alarm": 0}),
        (truth_of(cell="T0"), verdict_of("unknown", "unknown"), {"false_alarm": 1}),
        (
            truth_of(cell="T0", noise="drifting"),
            verdict_of("explained", "additive_drift", port="output:0"),
            {"false_alarm": 0},
        ),
        (
            truth_of(cell="T0", noise="drifting"),
            verdict_of("explained", "additive_drift", port="state:0"),
            {"false_alarm": 1},
        ),
        (
            truth_of(cell="T0"),
            {"verdict": "error", "seconds": 0.0, "findings": []},
            {"false_alarm": 1, "failed": 1},
        ),
    ],
)
def test_verdicts_are_judged_as_the_protocol_says(truth, verdict, measures):
    arrays = {"other_clean": np.ones((3, 1)), "amplitude_clean": np.ones((3, 1))}
    row = judge.judge(truth, verdict, arrays, {}, None)
    assert {k: row[k] for k in measures} == measures


def test_a_readable_rule_becomes_its_samples():
    signals = {"position [m]": np.array([-2.0, 0.0, 1.0, 3.0])}
    assert judge.rule_mask("position [m] > 0.5 and position [m] <= 2", signals).tolist() == [0, 0, 1, 0]
    assert judge.rule_mask("|position [m]| > 1.5", signals).tolist() == [1, 0, 0, 1]
    assert judge.rule_mask("0.5 < |position [m]| <= 2", signals).tolist() == [1, 0, 1, 0]
    assert judge.rule_mask("-2.5 < position [m] <= 0.2", signals).tolist() == [1, 1, 0, 0]
    assert judge.rule_mask("speed > 1", signals) is None


def test_exact_bounds_agree_with_the_rule_of_three_and_with_symmetry():
    low, high = bounds.clopper_pearson(0, 300)
    assert low == 0.0
    assert high == pytest.approx(1.0 - 0.025 ** (1 / 300))
    assert bounds.clopper_pearson(30, 100)[0] == pytest.approx(1.0 - bounds.clopper_pearson(70, 100)[1])


def test_only_what_chance_cannot_explain_is_clearly_missed():
    rows = [(0.5, 4, 0.95, True), (0.5, 40, 0.95, True), (0.0, 300, 0.01, False), (0.1, 300, 0.01, False)]
    cells = pd.DataFrame(rows, columns=["value", "n", "target", "at_least"]).assign(low=0.0, high=1.0)
    assert clearly_missed(cells).index.tolist() == [1, 3]
