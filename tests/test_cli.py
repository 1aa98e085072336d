"""The command line: what it writes, what it says, and with which exit code it ends."""

import io
import json
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from narx_sklearn.cli import _excite, main
from narx_sklearn.cli._demo import DATA_SHEET, demo_record, demo_simulator
from narx_sklearn.cli._files import replaced
from narx_sklearn.model import NARXModel

COMMANDS = ("diagnose", "identify", "compensate", "excite", "demo")
SERVO = """
from narx_sklearn.discrepancy import ODESimulator

def stage(x, u, p):
    return x[1], p[0] * u[0] - p[1] * x[1] - p[2] * x[0]

def make():
    return simulator

number = 3
simulator = ODESimulator(
    stage, dt=0.01, states=["position [m]", "velocity [m/s]"], inputs=["drive [V]"],
    parameters={"gain [m/s^2/V]": 4.3, "damping [1/s]": 5.0, "stiffness [1/s^2]": 170.0},
)
"""
FEW = "--effects=coulomb_friction,cubic_stiffness"


@pytest.fixture(scope="module")
def bench(tmp_path_factory):
    """A folder with a recording of the demo stage, its simulation's output beside it, and the simulation."""
    folder = tmp_path_factory.mktemp("bench")
    record = demo_record(2500)
    record.to_csv(folder / "bench.csv", index=False)
    y_sim = demo_simulator().simulate(record[["drive [V]"]].to_numpy(copy=True))[:, 0]
    record.assign(y_sim=y_sim).to_csv(
        folder / "trace.csv", index=False, sep=";", decimal=",", encoding="utf-8-sig"
    )
    (folder / "servo.py").write_text(SERVO)
    return folder


@pytest.fixture
def model(tmp_path):
    """A file with a model whose inverse is known: y[k] = 0.5 y[k-1] + 2 u[k-1]."""
    path = tmp_path / "model.json"
    NARXModel.from_equations("0.5*y[k-1] + 2*u[k-1]", units={"u": "V"}).save(path)
    return str(path)


def feed(monkeypatch, text):
    monkeypatch.setattr(sys, "stdin", io.TextIOWrapper(io.BytesIO(text.encode())))


def table(text):
    return pd.read_csv(io.StringIO(text))


@pytest.mark.parametrize("command", COMMANDS)
def test_help_of_every_command_has_examples(command, capsys):
    assert main([command, "--help"]) == 0
    assert f"narx-sklearn {command}" in capsys.readouterr().out.partition("examples:")[2]


def test_the_module_runs_as_the_command():
    done = subprocess.run(
        [sys.executable, "-m", "narx_sklearn", "--version"], capture_output=True, text=True, check=True
    )
    assert done.stdout.startswith("narx-sklearn ")


def test_help_waits_for_no_numerics():
    statements = ["import sys", "from narx_sklearn.cli import main", "main(['--help'])"]
    code = "\n".join([*statements, "print(*sys.modules, file=sys.stderr)"])
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert not {"numpy", "scipy", "pandas", "sklearn", "numba"} & set(done.stderr.split())


# -- wrong use and unusable data ---------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ([], "required: command"),
        (["diagnos"], "invalid choice"),
        (["diagnose", "{bench}", "--dt", "0"], "must be positive"),
        (["diagnose", "{bench}", "--dt", "0,01"], "write decimals with a point"),
        (["diagnose", "{bench}"], "Say it with --y-sim"),
        (["diagnose", "{bench}", "--u", "motor"], "--u motor names no column; the table has 'drive [V]'"),
        (["diagnose", "{bench}", "--model", "{servo}:sim"], "has no 'sim'; it holds simulator"),
        (["diagnose", "{bench}", "--model", "{servo}:number"], "'number' is a int; wanted is a Simulator"),
        (
            ["diagnose", "{bench}", "--model", "{servo}:make", "--y-sim", "1"],
            "Give --model or --y-sim, not both",
        ),
        (["diagnose", "{bench}", "--report", "-"], "--report needs a file name"),
        (["compensate", "{bench}"], "Give either --model"),
        (["compensate", "-", "--record", "-"], "cannot both come from standard input"),
        (["excite", "prvs", "--samples=9", "--dt=1", "--min=0", "--max=1"], "prvs needs --hold"),
        (["excite", "prfs", "--samples=9", "--dt=1", "--min=0", "--max=1"], "prfs needs --frequency"),
        (["excite", "prfs", "--samples=9", "--dt=1", "--min=0", "--max=1", "--odd"], "--odd does not belong"),
        (["excite", "prfs", "--samples=9", "--dt=1", "--min=1", "--max=1"], "--min 1 must lie below --max 1"),
        (["identify", "{bench}", "--save", "-", "--json", "-"], "cannot both go to standard output"),
        (["identify", "{bench}", "--test-fraction", "1"], "--test-fraction must lie in"),
    ],
)
def test_wrong_use_ends_with_2_and_says_what_is_wanted(bench, arguments, message, capsys):
    names = {"bench": str(bench / "bench.csv"), "servo": str(bench / "servo.py")}
    assert main([argument.format(**names) for argument in arguments]) == 2
    assert message in capsys.readouterr().err


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["diagnose", "absent.csv"], "Cannot read absent.csv: No such file"),
        (["diagnose", "{bench}", "--model", "absent.py"], "Cannot read the model absent.py"),
        (
            ["diagnose", "{bench}", "--model", "{servo}", "--dt", "0.02"],
            "sampled every 0.02 s, the simulator 0.01 s",
        ),
        (
            ["diagnose", "{bench}", "--model", "{servo}", "--effects", "gremlins"],
            "There is no effect 'gremlins'",
        ),
        (["diagnose", "{bench}", "--model", "{servo}", "--alpha", "2"], "alpha is a probability"),
        (["diagnose", "{bench}", "--json", "absent/a.json"], "there is no folder absent"),
        (["compensate", "{bench}", "--model", "absent.json"], "absent.json"),
        (["compensate", "{bench}", "--model", "{servo}"], "is not JSON"),
    ],
)
def test_unusable_data_end_with_1_in_a_sentence(bench, arguments, message, capsys):
    names = {"bench": str(bench / "bench.csv"), "servo": str(bench / "servo.py")}
    assert main([argument.format(**names) for argument in arguments]) == 1
    told = capsys.readouterr().err
    assert message in told
    assert "Traceback" not in told


def test_a_model_file_that_raises_is_named(tmp_path, bench, capsys):
    (tmp_path / "broken.py").write_text("import no_such_module_anywhere\n")
    assert main(["diagnose", str(bench / "bench.csv"), "--model", str(tmp_path / "broken.py")]) == 1
    assert "raised ModuleNotFoundError" in capsys.readouterr().err


# -- files -------------------------------------------------------------------------------------------------


def test_an_interrupted_write_leaves_the_old_file_and_no_draft(tmp_path):
    target = tmp_path / "out.csv"
    target.write_text("old")

    def write_half():
        with replaced(str(target)) as draft:
            Path(draft).write_text("half")
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        write_half()
    assert target.read_text() == "old"
    assert os.listdir(tmp_path) == ["out.csv"]


def test_an_interrupt_ends_with_130(monkeypatch, capsys):
    def interrupted(options):
        raise KeyboardInterrupt

    monkeypatch.setattr(_excite, "run", interrupted)
    assert main(["excite", "prfs", "--samples=9", "--dt=1", "--min=0", "--max=1"]) == 130
    assert "interrupted" in capsys.readouterr().err


# -- excite ------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "extra",
    [
        ["prvs", "--hold", "5", "9"],
        ["prfs", "--frequency", "2"],
        ["multisine", "--band", "0.5", "5", "--odd"],
    ],
    ids=lambda extra: extra[0],
)
def test_excitation_stays_in_its_range_and_repeats_with_its_seed(extra, capsys):
    arguments = ["excite", *extra, "--samples=400", "--dt=0.05", "--min=-1", "--max=3", "--name=drive [V]"]
    assert main(arguments) == 0
    first = capsys.readouterr().out
    assert main(arguments) == 0
    assert capsys.readouterr().out == first
    signal = table(first)
    assert list(signal) == ["time [s]", "drive [V]"]
    assert len(signal) == 400
    assert signal["time [s]"].iloc[-1] == pytest.approx(399 * 0.05)
    assert signal["drive [V]"].between(-1 - 1e-9, 3 + 1e-9).all()
    assert main([*arguments, "--seed", "7"]) == 0
    assert capsys.readouterr().out != first


# -- identify and compensate -------------------------------------------------------------------------------


def test_identify_finds_a_known_model_and_compensate_inverts_it(tmp_path, capsys, monkeypatch):
    rng = np.random.default_rng(0)
    u, y = rng.uniform(-1, 1, 600), np.zeros(600)
    for k in range(1, 600):
        y[k] = 0.5 * y[k - 1] + 2 * u[k - 1]
    text = pd.DataFrame({"t [s]": 0.1 * np.arange(600), "u [V]": u, "y [m]": y}).to_csv(index=False)
    feed(monkeypatch, text)
    saved, metrics = tmp_path / "m.json", tmp_path / "metrics.json"
    asked = ["--output-lags=1", "--input-lags=2", "--degree=2"]
    assert main(["identify", "-", "--save", str(saved), "--json", str(metrics), "--quiet", *asked]) == 0
    assert "y[k] = " in capsys.readouterr().out
    found = NARXModel.load(saved)
    assert found.sampling_period == pytest.approx(0.1)
    assert {str(t): v for t, v in found.equation().items} == pytest.approx({"y[k-1]": 0.5, "u[k-1]": 2.0})
    assert json.loads(metrics.read_text())["metrics"]["held_out_free_run_nrmse"] < 1e-9

    feed(monkeypatch, "reference [m]\n" + "\n".join(map(str, [0.0, 1.0, 1.0, 1.0])))
    assert main(["compensate", "-", "--model", str(saved), "--quiet"]) == 0
    done = table(capsys.readouterr().out)
    # r[k+1] = 0.5 r[k] + 2 m[k]: the step needs 0.5, holding it 0.25; the reference is held after its end
    np.testing.assert_allclose(done["u [V]"], [0.5, 0.25, 0.25, 0.25], rtol=1e-9)


def test_identify_without_lags_chooses_them(monkeypatch, capsys):
    rng = np.random.default_rng(1)
    u, y = rng.uniform(-1, 1, 250), np.zeros(250)
    for k in range(2, 250):
        y[k] = 0.6 * y[k - 1] - 0.2 * y[k - 2] + u[k - 1] + 0.01 * rng.normal()
    feed(monkeypatch, pd.DataFrame({"u": u, "y": y}).to_csv(index=False))
    assert main(["identify", "-", "--quiet", "--save", "-"]) == 0
    said = capsys.readouterr()
    equation = json.loads(said.out)["equations"]["y"]
    assert equation["y[k-1]"] == pytest.approx(0.6, abs=0.01)
    assert equation["y[k-2]"] == pytest.approx(-0.2, abs=0.01)
    assert "held out free run nrmse" in said.err  # words go beside what a program reads


def test_compensate_keeps_the_limits_and_tells_so(model, monkeypatch, capsys):
    feed(monkeypatch, "r;load\n0,0;1,0\n5,0;1,0\n5,0;1,0\n")
    assert main(["compensate", "-", "--model", model, "--limits", "-1", "1", "--r", "r"]) == 0
    said = capsys.readouterr()
    assert table(said.out)["u [V]"].abs().max() <= 1
    assert "no admissible input" in said.err


def test_a_reference_that_cannot_be_told_is_asked_for(model, monkeypatch, capsys):
    feed(monkeypatch, "a,b\n0,1\n5,1\n")
    assert main(["compensate", "-", "--model", model]) == 2
    assert "Which column is the reference? Name it with --r; there are a, b" in capsys.readouterr().err


# -- diagnose ----------------------------------------------------------------------------------------------


def test_diagnose_names_the_friction_from_a_model_file(bench, tmp_path, capsys):
    result = tmp_path / "result.json"
    model = f"{bench / 'servo.py'}:simulator"
    assert main(["diagnose", str(bench / "bench.csv"), "--model", model, FEW, "--json", str(result)]) == 0
    said = capsys.readouterr()
    assert "Coulomb friction" in said.out
    assert "Sampling period 0.01 s" in said.err
    content = json.loads(result.read_text())
    finding = content["findings"][0]
    assert finding["effect"] == "coulomb_friction"
    low, high = finding["intervals"]["Fc"]
    assert low - 0.1 < 1.6 < high + 0.1
    assert content["settings"]["random_state"] == 0
    assert {row["parameter"] for row in content["parameters"]} == {name.split(" [")[0] for name in DATA_SHEET}


def test_diagnose_takes_a_simulated_trace_with_semicolons_and_decimal_commas(bench, capsys, monkeypatch):
    monkeypatch.setattr(sys, "stdin", io.TextIOWrapper(io.BytesIO((bench / "trace.csv").read_bytes())))
    arguments = ["--u", "drive", "--y", "position", "--y-sim", "y_sim", FEW, "--json", "-"]
    assert main(["diagnose", "-", *arguments]) == 0
    said = capsys.readouterr()
    content = json.loads(said.out)
    assert content["verdict"] in ("refit", "explained", "ambiguous", "unknown")
    assert "position[k-1]" in {row["parameter"] for row in content["parameters"]}  # the twin's
    assert "decimal comma" in said.err
    assert "Verdict:" in said.err


def test_demo_names_its_friction_and_writes_a_report(tmp_path, capsys, monkeypatch):
    pytest.importorskip("jinja2")
    monkeypatch.chdir(tmp_path)
    assert main(["demo", "--json", "demo.json", "--csv", "demo.csv"]) == 0
    assert "search for missing physics" in capsys.readouterr().err
    finding = json.loads((tmp_path / "demo.json").read_text())["findings"][0]
    assert finding["effect"] == "coulomb_friction"
    assert finding["parameters"]["Fc"] == pytest.approx(1.6, rel=0.05)
    assert "Coulomb friction" in (tmp_path / "narx-demo.html").read_text(encoding="utf-8")
    assert sorted(os.listdir(tmp_path)) == ["demo.csv", "demo.json", "narx-demo.html"]
