"""The command line: what it writes, what it says, and with which exit code it ends."""

import io
import json
import os
import re
import shutil
import signal
import stat
import subprocess
import sys
import threading
import time
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from scipy.signal import lfilter

import narx_sklearn
import narx_sklearn.report
from narx_sklearn import DiscrepancyRegressor, ODESimulator
from narx_sklearn._progress import progress, write_beside
from narx_sklearn.analysis import continuum_of_steady_states
from narx_sklearn.cli import _demo, _diagnose, _excite, main
from narx_sklearn.cli._columns import read_recordings
from narx_sklearn.cli._demo import DATA_SHEET, demo_record, demo_simulator
from narx_sklearn.cli._diagnose import check_trace
from narx_sklearn.cli._files import replaced, write_text
from narx_sklearn.cli._parser import make_parser
from narx_sklearn.cli._simulators import load_simulator
from narx_sklearn.compensation import RootCompensator, law_stability, root_law
from narx_sklearn.model import Difference, NARXModel, free_run
from narx_sklearn.signals import prfs

COMMANDS = ("diagnose", "identify", "compensate", "excite", "demo")
SERVO = """
from narx_sklearn.discrepancy import ODESimulator

def stage(x, u, p):
    return x[1], p[0] * u[0] - p[1] * x[1] - p[2] * x[0]

def make():
    print("made")
    return simulator

def fail():
    raise LookupError("no such stage")

number = 3
simulator = ODESimulator(
    stage, dt=0.01, states=["position [m]", "velocity [m/s]"], inputs=["drive [V]"],
    parameters={"gain [m/s^2/V]": 4.3, "damping [1/s]": 5.0, "stiffness [1/s^2]": 170.0},
)
"""
ENVIRONMENT = {**os.environ, "PYTHONPATH": str(Path(narx_sklearn.__file__).parents[1])}
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
    record.assign(**{"current [A]": y_sim**2}).to_csv(folder / "both.csv", index=False)
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


def first_order(n_samples):
    rng = np.random.default_rng(0)
    u, y = rng.uniform(-1, 1, n_samples), np.zeros(n_samples)
    for k in range(1, n_samples):
        y[k] = 0.5 * y[k - 1] + 2 * u[k - 1] + 0.05 * rng.normal()
    return pd.DataFrame({"u": u, "y": y})


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


def test_milliseconds_that_were_taken_for_seconds_are_asked_about(bench, tmp_path, capsys):
    record = pd.read_csv(bench / "bench.csv")
    record["time [s]"] *= 1000
    record.to_csv(tmp_path / "ms.csv", index=False)
    assert main(["diagnose", str(tmp_path / "ms.csv"), "--model", str(bench / "servo.py")]) == 1
    told = capsys.readouterr().err
    assert "is column 'time [s]' in ms? Then label it 'time [ms]'. Else give the simulator dt=10.\n" in told


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ([], "required: command"),
        (["diagnos"], "invalid choice: 'diagnos' (choose from 'diagnose', "),
        (["diagnose", "{bench}", "--dt", "0"], "must be positive"),
        (["diagnose", "{bench}", "--dt", "0,01"], "write decimals with a point"),
        (["diagnose", "{bench}"], "Say it with --y-sim"),
        (
            ["diagnose", "{bench}", "--u", "motor"],
            "--u motor names no column; the table has 'time [s]', 'drive [V]'",
        ),
        (["diagnose", "{bench}", "--model", "{servo}:sim"], "has no 'sim'; it holds simulator"),
        (
            ["diagnose", "{bench}", "--model", "{servo}:stage"],
            "'stage' is a function of x, u, p; wanted is a Simulator",
        ),
        (["diagnose", "{bench}", "--model", "{servo}:number"], "'number' is of type int; wanted is a Sim"),
        (["diagnose", "{bench}", "--dt", "0.02"], "bench.csv one of 0.01 s. Leave out --dt to"),
        (["diagnose", "{bench}", "--u", "1"], "--u 1: column 'time [s]' is the time"),
        (
            ["diagnose", "{both}", "--model", "{servo}", "--y", "position,current"],
            "--y names 'current [A]', which the simulator does not know: its outputs are position [m]. Leave",
        ),
        (
            ["diagnose", "{both}", "--model", "{servo}", "--u", "drive,current"],
            "--u names 'current [A]', which the simulator does not know: its inputs are drive [V]. Leave",
        ),
        (
            ["diagnose", "{bench}", "--model", "{servo}:make", "--y-sim", "1"],
            "Give --model or --y-sim, not both",
        ),
        (["diagnose", "{bench}", "--report", "-"], "--report needs a file name"),
        (["diagnose", "{bench}", "--u=drive", "--y=drive", "--y-sim=position"], "was taken for --u and --y;"),
        (
            ["diagnose", "{bench}", "--quiet", "b.csv"],
            "unrecognized arguments: b.csv; several record",
        ),
        (["identify", "{bench}", "--input", "drive"], "--input drive; input columns are named with --u"),
        (["diagnose", "{bench}", "--seed", "-1"], "'-1' is not a whole number from 0"),
        (["diagnose", "{bench}", "--jobs", "0"], "'0' is no number of threads"),
        (["compensate", "{bench}"], "Give either --model"),
        (
            ["compensate", "{bench}", "--model", "m.json", "--method", "inverse"],
            "inverse identifies a model of",
        ),
        (["compensate", "{bench}", "--model", "m.json", "--limits", "1", "0"], "the least before the most"),
        (
            ["excite", "prvs", "--samples=9", "--dt=1", "--min=0", "--max=inf", "--hold", "1", "2"],
            "inf is not finite",
        ),
        (
            ["excite", "prvs", "--samples=9", "--dt=1", "--min=0", "--max=1", "--hold", "3", "2"],
            "--hold 3 2: the least",
        ),
        (["compensate", "-", "--record", "-"], "cannot both come from standard input"),
        (["compensate", "-", "--model", "m.json", "--u", "drive"], "--u names a column of --record, and"),
        (["excite", "prvs", "--samples=9", "--dt=1", "--min=0", "--max=1"], "prvs needs --hold"),
        (["excite", "prfs", "--samples=9", "--dt=1", "--min=0", "--max=1"], "prfs needs --frequency"),
        (["excite", "prfs", "--samples=9", "--dt=1", "--min=0", "--max=1", "--odd"], "--odd does not belong"),
        (["excite", "prfs", "--samples=9", "--dt=1", "--min=1", "--max=1"], "--min 1 must lie below --max 1"),
        (["identify", "{bench}", "--save", "-", "--json", "-"], "cannot both go to standard output"),
        (["identify", "{bench}", "--test-fraction", "1"], "--test-fraction must lie in"),
    ],
)
def test_wrong_use_ends_with_2_and_says_what_is_wanted(bench, arguments, message, capsys):
    names = {"both": bench / "both.csv", "bench": str(bench / "bench.csv"), "servo": str(bench / "servo.py")}
    assert main([argument.format(**names) for argument in arguments]) == 2
    *_, sentence, way = capsys.readouterr().err.splitlines()
    assert message in sentence
    assert way.startswith("Try: narx-sklearn")


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (
            ["diagnose", "{bench}", "--model", "{servo}", "--time=none", "--dt=10"],
            "That is 1000 times as much: is --dt in ms? It is wanted in s: pass --dt 0.01. Else give",
        ),
        (
            ["diagnose", "{bench}", "--model", "{servo}", "--resample", "0.001"],
            "simulator 0.01 s. Give the simulator dt=0.001, or pass --resample 0.01.",
        ),
        (["diagnose", "absent.csv"], "Cannot read absent.csv: No such file"),
        (["diagnose", "{bench}", "--model", "absent.py"], "Cannot read the model absent.py"),
        (
            ["diagnose", "{bench}", "--model", "{servo}", "--time=none", "--dt=0.02"],
            "sampled every 0.02 s, the simulator 0.01 s",
        ),
        (
            ["diagnose", "{bench}", "--model", "{servo}", "--effects", "gremlins"],
            "There is no effect 'gremlins'",
        ),
        (["diagnose", "{bench}", "--model", "{servo}", "--alpha", "2"], "alpha is a probability"),
        (
            ["diagnose", "{bench}", "--model", "{servo}:fail"],
            "servo.py, line 12, raised LookupError: no such",
        ),
        (
            ["excite", "multisine", "--samples=1000000000000000", "--dt=1", "--min=0", "--max=1"],
            "not enough memory",
        ),
        (["diagnose", "{bench}", "--json", "absent/a.json"], "there is no folder absent"),
        (
            ["identify", "{bench}", "--output-lags=20", "--input-lags=20", "--degree=9"],
            "degree=9 with 40 lagged variables makes 2,054,455,634 candidate terms; at most 1,000,000",
        ),
        (["compensate", "{bench}", "--model", "absent.json"], "Cannot read the model absent.json: No such"),
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


def test_an_error_inside_the_equations_tells_the_line_of_the_model_file(tmp_path, bench, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    Path("typo.py").write_text(SERVO.replace("p[2] * x[0]", "p[7] * x[0]"))
    for path in ("typo.py", str(tmp_path / "typo.py")):
        assert main(["diagnose", str(bench / "bench.csv"), "--model", path]) == 1
        assert "typo.py, line 5, raised ValueError" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("equation", "where"),
    [
        ("p[0] * u[0] + 90 * x[1]", "grows e-fold in 1.1 samples"),
        ("p[0] * u[0] + math.nan", "first at sample 1 of the record"),
    ],
)
def test_a_simulation_that_diverges_says_where(tmp_path, bench, capsys, equation, where):
    text = SERVO.replace("p[0] * u[0] - p[1] * x[1] - p[2] * x[0]", equation)
    (tmp_path / "diverges.py").write_text(f"import math\n{text}")
    assert main(["diagnose", str(bench / "bench.csv"), "--model", str(tmp_path / "diverges.py")]) == 1
    told = capsys.readouterr().err
    assert re.search(rf"The simulation diverges: .*{where}", told)
    assert "Check the signs of its terms" in told


def test_a_model_file_that_ends_the_program_is_named(tmp_path, bench, capsys):
    (tmp_path / "quits.py").write_text("import sys\nsys.exit(3)\n")
    assert main(["diagnose", str(bench / "bench.csv"), "--model", str(tmp_path / "quits.py")]) == 1
    assert "quits.py, line 2, raised SystemExit: 3" in capsys.readouterr().err


def test_of_several_simulators_one_must_be_named(tmp_path, bench, capsys):
    (tmp_path / "two.py").write_text(SERVO.replace("\nsimulator = ", "\nstage_a = stage_b = "))
    assert main(["diagnose", str(bench / "bench.csv"), "--model", str(tmp_path / "two.py")]) == 2
    assert "it holds stage_a, stage_b. Name the one that is meant: --model" in capsys.readouterr().err


def test_what_a_model_file_prints_stays_out_of_standard_output(bench, capsys):
    assert load_simulator(f"{bench / 'servo.py'}:make").dt == 0.01
    assert capsys.readouterr() == ("", "made\n")


def test_a_model_file_may_hold_dataclasses_and_be_named_like_a_module_of_the_library(tmp_path):
    text = "from __future__ import annotations\nfrom dataclasses import dataclass\n"
    (tmp_path / "signal.py").write_text(f"{text}@dataclass\nclass Stage:\n    mass: float\n{SERVO}")
    assert load_simulator(str(tmp_path / "signal.py")).dt == 0.01
    assert sys.modules["signal"] is signal


@pytest.mark.parametrize("option", ["alpha", "level", "max_effects", "test_fraction", "window"])
def test_a_diagnosis_by_command_has_the_defaults_of_the_estimator(option):
    options = vars(make_parser("narx-sklearn").parse_args(["diagnose", "a.csv"]))
    assert options[option] == DiscrepancyRegressor(None).get_params()[option]


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


def test_a_link_stays_a_link_and_what_is_no_file_is_written_to(tmp_path):
    (tmp_path / "old.csv").write_text("old")
    (tmp_path / "link.csv").symlink_to(tmp_path / "old.csv")
    write_text(str(tmp_path / "link.csv"), "new")
    assert (tmp_path / "link.csv").is_symlink()
    assert (tmp_path / "old.csv").read_text() == "new"
    write_text(os.devnull, "gone")
    assert stat.S_ISCHR(os.stat(os.devnull).st_mode)


EXCITE = [
    sys.executable,
    "-m",
    "narx_sklearn",
    *["excite", "prvs", "--samples", "9", "--dt", "1", "--min", "0", "--max", "1", "--hold", "1", "2"],
]


@pytest.mark.skipif(os.name != "posix", reason="needs a shell and /dev/full")
@pytest.mark.parametrize(
    ("target", "message"),
    [(">&-", "standard output: it is closed"), (">/dev/full", "standard output: No space left on device")],
)
def test_a_standard_output_that_takes_nothing_is_told(target, message):
    command = f'"$0" "$@" {target}'
    done = subprocess.run(["sh", "-c", command, *EXCITE], capture_output=True, text=True, env=ENVIRONMENT)
    assert done.returncode == 1
    assert (
        done.stderr
        == f"narx-sklearn excite: Cannot write to {message}{'. Name a file' * ('closed' in message)}.\n"
    )


def test_an_interrupt_ends_with_130(monkeypatch, capsys):
    def interrupted(options):
        raise KeyboardInterrupt

    monkeypatch.setattr(_excite, "run", interrupted)
    assert main(["excite", "prfs", "--samples=9", "--dt=1", "--min=0", "--max=1"]) == 130
    assert "interrupted" in capsys.readouterr().err


# -- progress ----------------------------------------------------------------------------------------------


@pytest.fixture
def terminal():
    """One end of a pseudo-terminal, to write to, and the list of what was shown on it so far."""
    pty = pytest.importorskip("pty", reason="this system has no pseudo-terminals")
    master, slave = pty.openpty()
    shown = []

    def read():
        while True:
            try:
                shown.append(os.read(master, 1024).decode(errors="replace"))
            except OSError:  # the other end was closed
                return

    reader = threading.Thread(target=read, daemon=True)
    reader.start()
    stream = open(slave, "w", encoding="utf-8")  # noqa: SIM115 - closed below, before its reader ends
    yield stream, shown
    stream.close()
    reader.join(10)
    os.close(master)


def wait_for(text, shown, seconds=20):
    """Return what was shown when the text has appeared."""
    end = time.monotonic() + seconds
    while text not in "".join(shown):
        assert time.monotonic() < end, f"no {text!r} in {''.join(shown)!r}"
        time.sleep(0.02)
    return "".join(shown)


def test_a_terminal_shows_the_stages_and_keeps_only_what_was_said_beside_them(terminal, monkeypatch):
    stream, shown = terminal
    monkeypatch.setattr(sys, "stderr", stream)
    with progress({"first": 0, "second": 40}, quiet=False) as begin:
        begin("first")
        begin("second")
        write_beside("a word in between")
        begin("a stage that nobody knew of")
    print("end", file=stream, flush=True)
    told = wait_for("end\r\n", shown)
    assert "first |" in told
    assert " 40 % [00:0" in told
    before, after = told.split("a word in between\r\n")
    assert not before.split("\r")[-1].strip()
    assert "a stage that nobody knew of |" in after
    assert not after.split("\r")[-3].strip()  # wiped away


def test_the_clock_beside_the_bar_runs_while_a_stage_takes_its_time(terminal, monkeypatch):
    stream, shown = terminal
    monkeypatch.setattr(sys, "stderr", stream)
    with progress({"long": 0}, quiet=False) as begin:
        begin("long")
        wait_for("[00:01]", shown)


def test_a_pipe_shows_no_bar(capsys):
    with progress({"first": 0}, quiet=False) as begin:
        begin("first")
    assert capsys.readouterr() == ("", "")


def test_a_terminal_that_was_asked_to_be_quiet_shows_no_bar(terminal, monkeypatch):
    stream, shown = terminal
    monkeypatch.setattr(sys, "stderr", stream)
    with progress({"first": 0}, quiet=True) as begin:
        begin("first")
    print("end", file=stream, flush=True)
    assert wait_for("end", shown).strip() == "end"


def test_an_estimator_shows_the_same_bar_where_it_is_asked_to(terminal, monkeypatch):
    stream, shown = terminal
    monkeypatch.setattr(sys, "stderr", stream)
    sim = ODESimulator(
        lambda x, u, p: (p[0] * u[0] - x[0],), dt=0.1, parameters={"a": 1.0}, states=["h"], inputs=["u"]
    )
    u = np.repeat(np.random.default_rng(0).normal(size=30), 5)
    y = sim.simulate(u) + 0.01 * np.random.default_rng(1).normal(size=(150, 1))
    DiscrepancyRegressor(sim, effects=["constant_load"], verbose=1).fit(u, y)
    print("end", file=stream, flush=True)
    told = wait_for("end", shown)
    assert "location |" in told
    assert " 82 % [" in told
    assert "[narx_sklearn]" not in told


# tests that run in the background inherit that SIGINT is ignored
INTERRUPTIBLE = """
import signal, sys
signal.signal(signal.SIGINT, signal.default_int_handler)
from narx_sklearn.cli import main
sys.exit(main(sys.argv[1:]))
"""


def test_an_interrupted_diagnosis_leaves_no_file_and_ends_with_130(bench, tmp_path, terminal):
    stream, shown = terminal
    record, model = str(bench / "bench.csv"), str(bench / "servo.py")
    command = ["diagnose", record, "--model", model, "--json", "result.json", "--report", "result.html"]
    with subprocess.Popen(
        [sys.executable, "-c", INTERRUPTIBLE, *command],
        stdout=subprocess.PIPE,
        stderr=stream,
        cwd=tmp_path,
        env=ENVIRONMENT,
    ) as work:
        try:
            wait_for("fit of the simulator's own parameters |", shown, seconds=60)  # compiles, when run alone
        finally:
            work.send_signal(signal.SIGINT)
        out, _ = work.communicate(timeout=60)
    assert work.returncode == 130
    assert out == b""
    assert "interrupted; no file was left half written" in wait_for("written", shown)
    assert os.listdir(tmp_path) == []


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


def test_identify_with_hysteresis_gives_a_model_that_rests_where_its_input_stops(
    tmp_path, monkeypatch, capsys
):
    u = prfs(1500, 1.0, 0.01, amplitudes=5.0, random_state=0)
    h, y = 0.0, np.zeros(u.size)
    for k in range(1, u.size):
        h += 0.3 * (u[k] - u[k - 1]) - 0.2 * abs(u[k] - u[k - 1]) * h
        y[k] = 0.5 * y[k - 1] + 0.5 * (u[k] - h)
    feed(monkeypatch, pd.DataFrame({"drive [V]": u, "position [um]": y}).to_csv(index=False))
    saved = tmp_path / "stage.json"
    asked = ["--u=drive", "--y=position", "--structure=hysteresis", "--quiet", "--save", str(saved)]
    assert main(["identify", "-", *asked]) == 0
    model = NARXModel.load(saved)
    assert continuum_of_steady_states(model).exists
    assert {"drive"} <= {s for p in model.phi for s in p.signals}
    assert free_run(model, u, y_init=y).y[:, 0] == pytest.approx(y, abs=0.03 * np.ptp(y))


def test_identify_with_hysteresis_chooses_lags_whose_law_can_be_followed(tmp_path, monkeypatch, capsys):
    rng = np.random.default_rng(0)
    u = prfs(2500, 1.0, 0.01, amplitudes=5.0, random_state=1)
    half_widths = np.array([0.5, 1.0, 2.0, 4.0])
    plays, force = np.full(4, u[0]), np.zeros(u.size)
    for k in range(u.size):
        plays = np.clip(plays, u[k] - half_widths, u[k] + half_widths)
        force[k] = u[k] + plays.sum()
    y = lfilter([0.0, 0.3], [1.0, -0.7], force) + 0.02 * rng.normal(size=u.size)
    feed(monkeypatch, pd.DataFrame({"drive [V]": u, "position [um]": y}).to_csv(index=False))
    saved = tmp_path / "stage.json"
    asked = ["--u=drive", "--y=position", "--structure=rate_independent", "--quiet", "--save", str(saved)]
    assert main(["identify", "-", *asked]) == 0
    model = NARXModel.load(saved)
    reference = 8.0 * np.sin(2 * np.pi * np.arange(1000) / 500)
    assert law_stability(root_law(model), reference).is_stable
    given = RootCompensator(model).fit().predict(reference)
    followed = free_run(model, given[:, None], np.zeros((model.max_lag, 1))).y[:, 0]
    assert np.std((followed - reference)[10:]) < 0.05 * np.std(reference)


@pytest.mark.skipif(shutil.which("gcc") is None, reason="no C compiler")
def test_identify_writes_a_model_of_two_outputs_as_c(tmp_path, capsys):
    rng = np.random.default_rng(0)
    u, y = rng.uniform(-1, 1, 600), np.zeros((600, 2))
    for k in range(1, 600):
        y[k] = 0.5 * y[k - 1, 0] + 2 * u[k - 1], 0.25 * y[k - 1, 1] + y[k - 1, 0]
    record = pd.DataFrame({"u [V]": u, "x [m]": y[:, 0], "force [N]": y[:, 1]})
    record.to_csv(tmp_path / "bench.csv", index=False)
    source = tmp_path / "x-axis.c"
    asked = ["--y=x,force", "--output-lags=1", "--input-lags=1", "--degree=1", "--quiet"]
    assert main(["identify", str(tmp_path / "bench.csv"), "--c", str(source), *asked]) == 0
    assert "force[k] = " in capsys.readouterr().out
    (tmp_path / "main.c").write_text(
        '#include "x-axis.c"\n#include <stdio.h>\nint main(void)\n{\n    x_axis_state s;\n'
        "    double y[2] = {0.0, 0.0};\n    x_axis_reset(&s, y, 0.0);\n    x_axis_step(&s, 1.0, y);\n"
        '    x_axis_step(&s, 0.0, y);\n    printf("%.9g %.9g", y[0], y[1]);\n    return 0;\n}\n'
    )
    subprocess.run(["gcc", "-std=c99", tmp_path / "main.c", "-o", tmp_path / "main", "-lm"], check=True)
    done = subprocess.run([tmp_path / "main"], capture_output=True, text=True, check=True)
    # a pulse of 1 V makes x = 2 m, of which a sample later half is left in x, and all in the force
    assert [float(v) for v in done.stdout.split()] == pytest.approx([1.0, 2.0])


def test_compensate_writes_its_law_as_c(tmp_path, model, monkeypatch):
    feed(monkeypatch, "r\n0\n1\n")
    law, made = tmp_path / "law.c", tmp_path / "input.csv"
    assert main(["compensate", "-", "--model", model, "--c", str(law), "--output", str(made)]) == 0
    compensator = RootCompensator(NARXModel.load(model)).fit()
    assert law.read_text() == compensator.explain("c", "law")
    assert table(made.read_text())["u [V]"].tolist() == [0.5, 0.25]


def test_of_what_is_written_one_goes_to_standard_output(model, monkeypatch, capsys):
    feed(monkeypatch, "r\n0\n1\n")
    assert main(["identify", "-", "--c", "-", "--json", "-"]) == 2
    assert "--c and --json cannot both go to standard output" in capsys.readouterr().err
    assert main(["compensate", "-", "--model", model, "--c", "-"]) == 2
    assert "The input and --c cannot both go to standard output" in capsys.readouterr().err


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


def test_a_lag_at_the_edge_of_what_was_tried_is_told_by_its_option(monkeypatch, capsys):
    rng = np.random.default_rng(1)
    u, y = rng.uniform(-1, 1, 300), np.zeros(300)
    for k in range(5, 300):
        y[k] = 0.4 * y[k - 1] + u[k - 1] + u[k - 3] + u[k - 5] + 0.01 * rng.normal()
    feed(monkeypatch, pd.DataFrame({"u": u, "y": y}).to_csv(index=False))
    assert main(["identify", "-", "--quiet"]) == 0
    said = capsys.readouterr().err
    assert re.search(r"The best choice has .*--input-lags=\d, the largest of the grid", said)
    assert "Pass larger values for" in said
    assert "input_lags" not in said


def test_dead_values_of_a_record_are_told_and_taken_as_missing(monkeypatch, capsys):
    record = first_order(400)
    record.loc[200:209, "y"] = -9999.0
    feed(monkeypatch, record.to_csv(index=False))
    assert main(["identify", "-", "--output-lags=1", "--input-lags=1", "--degree=1"]) == 0
    said = capsys.readouterr()
    assert "10 samples of 'y' are -9999 (200 to 209), where all others lie between" in said.err
    assert "taken as missing" in said.err
    assert "worse than that part's mean" not in said.out


def test_a_model_that_is_worse_than_the_mean_is_told(monkeypatch, capsys):
    rng = np.random.default_rng(0)
    y = np.cumsum(rng.normal(size=400))
    feed(monkeypatch, pd.DataFrame({"u": rng.normal(size=400), "y": y}).to_csv(index=False))
    assert main(["identify", "-", "--quiet", "--output-lags=1", "--input-lags=1", "--degree=1"]) == 0
    said = capsys.readouterr().out
    assert float(said.split("free run nrmse: ")[1].split()[0]) > 1
    assert "Run freely, the model predicts the held-out part worse than that part's mean does." in said


def test_a_record_of_twenty_samples_gives_a_model_whose_residuals_are_not_tested(monkeypatch, capsys):
    feed(monkeypatch, first_order(20).to_csv(index=False))
    assert main(["identify", "-", "--quiet"]) == 0
    told = capsys.readouterr().out
    assert "y[k] = " in told
    assert "The residuals could not be tested. The record has 15 usable samples" in told


def test_a_record_that_tells_nothing_is_refused(monkeypatch, capsys):
    still = first_order(60).assign(y=2.5)
    halting = first_order(60)
    halting.loc[40:, "y"] = 1.0
    for record, message in [
        (first_order(2), "The record has 2 samples, 2 of them to identify a model from; at least 10"),
        (still, "Output 'y' of standard input is 2.5 in every row"),
        (halting, "An output stands still all through the held-out part"),
    ]:
        feed(monkeypatch, record.to_csv(index=False))
        assert main(["identify", "-", "--quiet"]) == 1
        assert message in capsys.readouterr().err


def test_a_warning_that_arises_many_times_is_told_once(monkeypatch, capsys):
    feed(monkeypatch, first_order(60).assign(u=1.0).to_csv(index=False))
    assert main(["identify", "-", "--quiet"]) == 0
    assert capsys.readouterr().err.count("u is constant in this record") == 1


def test_compensate_keeps_the_limits_and_tells_so(model, monkeypatch, capsys):
    feed(monkeypatch, "r;load\n0,0;1,0\n0,0;1,0\n5,0;1,0\n5,0;1,0\n")
    assert main(["compensate", "-", "--model", model, "--limits", "-1", "1", "--r", "r"]) == 0
    said = capsys.readouterr()
    assert table(said.out)["u [V]"].abs().max() <= 1
    assert "no admissible input" in said.err


def test_the_other_inputs_of_a_law_stand_beside_the_reference(tmp_path, monkeypatch, capsys):
    path = tmp_path / "oven.json"
    NARXModel.from_equations("0.5*y[k-1] + u[k-1] + v[k-1]", inputs=["u", "v"]).save(path)
    feed(monkeypatch, "y [K],v [K]\n2,1\n2,1\n2,0\n2,0\n")
    assert main(["compensate", "-", "--model", str(path), "--quiet"]) == 0
    assert table(capsys.readouterr().out)["u"].tolist() == [0.0, 0.0, 1.0, 1.0]
    feed(monkeypatch, "y [K]\n2\n2\n")
    assert main(["compensate", "-", "--model", str(path), "--quiet"]) == 2
    assert "The law also needs the input v, which no column gives; the table has" in capsys.readouterr().err


def test_a_model_that_rests_anywhere_starts_where_the_machine_is_said_to_be_held(
    tmp_path, monkeypatch, capsys
):
    path = tmp_path / "stage.json"
    phi = [Difference("u", name="phi1")]
    NARXModel.from_equations("y[k-1] + 0.5*phi1[k-1]", phi=phi).save(path)
    for start, said in (([], "Pass --start with the input"), (["--start", "50"], "The law:")):
        feed(monkeypatch, "r\n8\n8\n9\n9\n")
        assert main(["compensate", "-", "--model", str(path), *start]) == 0
        told = capsys.readouterr()
        assert said in told.err
        assert ("--start" in told.err) == (not start)
    assert table(told.out)["u"].tolist() == [50.0, 52.0, 52.0, 52.0]


def test_a_saved_model_begins_and_stays_within_what_was_recorded(tmp_path, monkeypatch, capsys):
    u = prfs(1500, 1.0, 0.01, amplitudes=5.0, random_state=0)
    y = 20.0 + 2.0 * np.concatenate([u[:1], u[:-1]])
    feed(monkeypatch, pd.DataFrame({"drive [V]": u, "position [um]": y}).to_csv(index=False))
    saved = tmp_path / "stage.json"
    asked = ["--structure=rate_independent", "--u=drive", "--y=position", "--quiet", "--save", str(saved)]
    assert main(["identify", "-", *asked]) == 0
    capsys.readouterr()
    low, _, high = NARXModel.load(saved).recorded["drive"]
    for r, said in (
        (20.0, "note: The model can rest at any"),
        (90.0, "warning: The reference begins at 90, b"),
    ):
        feed(monkeypatch, f"r [um]\n{r}\n{r}\n")
        assert main(["compensate", "-", "--model", str(saved)]) == 0
        told = capsys.readouterr()
        assert said in told.err
        m = table(told.out)["drive [V]"].to_numpy()
        assert low - 1e-9 <= m.min() <= m.max() <= high + 1e-9  # written to twelve digits
        if r == 20.0:
            assert m == pytest.approx([0.0, 0.0], abs=0.05 * (high - low))


def test_a_reference_that_begins_beyond_the_record_is_told(tmp_path, monkeypatch, capsys):
    u = prfs(1500, 1.0, 0.01, amplitudes=5.0, random_state=0)
    h, y = 0.0, np.zeros(u.size)
    for k in range(1, u.size):
        h += 0.3 * (u[k] - u[k - 1]) - 0.2 * abs(u[k] - u[k - 1]) * h
        y[k] = u[k - 1] - h
    pd.DataFrame({"u": u, "y": y}).to_csv(tmp_path / "record.csv", index=False)
    for r, warned in ((0.0, False), (90.0, True)):
        feed(monkeypatch, f"r\n{r}\n{r}\n")
        assert main(["compensate", "-", "--record", str(tmp_path / "record.csv"), "--quiet"]) == 0
        told = capsys.readouterr()
        assert ("warning: The reference begins at 90, beyond the recorded output" in told.err) == warned
        assert np.abs(table(told.out)["u"]).max() <= np.abs(u).max() + 1e-9  # written to twelve digits


def test_where_nothing_tells_which_input_holds_the_first_reference_a_warning_says_so(
    tmp_path, monkeypatch, capsys
):
    path = tmp_path / "stage.json"
    NARXModel.from_equations("y[k-1] + 0.5*phi1[k-1]", phi=[Difference("u", name="phi1")]).save(path)
    feed(monkeypatch, "r\n8\n8\n")
    assert main(["compensate", "-", "--model", str(path), "--quiet"]) == 0
    assert (
        "warning: The model can rest at any input, and --start tells none; the first one is 8, the number"
        in (capsys.readouterr().err)
    )


def test_a_reference_in_another_unit_than_the_model_s_output_is_refused(tmp_path, monkeypatch, capsys):
    path = tmp_path / "stage.json"
    NARXModel.from_equations("0.5*y[k-1] + u[k-1]", units={"y": "um"}).save(path)
    feed(monkeypatch, "reference [mm]\n0\n0.001\n")
    assert main(["compensate", "-", "--model", str(path)]) == 1
    said = capsys.readouterr().err
    assert (
        "'reference [mm]' is in another unit than the model's output 'y [um]': its values are to be" in said
    )


def test_a_reference_with_another_sampling_period_than_the_model_is_refused(tmp_path, monkeypatch, capsys):
    path = tmp_path / "slow.json"
    NARXModel.from_equations("0.5*y[k-1] + u[k-1]", sampling_period=0.1).save(path)
    reference = "time [s],r\n0,0\n1,1\n2,1\n"
    feed(monkeypatch, reference)
    assert main(["compensate", "-", "--model", str(path)]) == 1
    said = capsys.readouterr().err
    assert "The reference is sampled every 1 s, the model 0.1 s" in said
    assert "Pass --resample 0.1" in said
    feed(monkeypatch, reference)
    assert main(["compensate", "-", "--model", str(path), "--resample", "0.1", "--quiet"]) == 0
    assert len(table(capsys.readouterr().out)) == 21


def test_a_reference_with_another_sampling_period_than_the_record_is_refused(tmp_path, monkeypatch, capsys):
    record = first_order(300)
    record.insert(0, "time [s]", 0.1 * np.arange(300))
    record.to_csv(tmp_path / "record.csv", index=False)
    feed(monkeypatch, "time [s],r\n0,0\n1,0.1\n2,0.1\n")
    assert main(["compensate", "-", "--record", str(tmp_path / "record.csv"), "--quiet"]) == 1
    assert "sampled every 1 s, the record 0.1 s" in capsys.readouterr().err


def test_no_file_is_written_where_the_law_has_no_solution_at_all(tmp_path, monkeypatch, capsys):
    path = tmp_path / "even.json"
    NARXModel.from_equations("0.5*y[k-1] + u[k-1]^2").save(path)  # no input makes y negative
    feed(monkeypatch, "r\n" + "-1\n" * 5)
    assert main(["compensate", "-", "--model", str(path), "--output", str(tmp_path / "u.csv")]) == 1
    assert "No admissible input solves the law at any sample" in capsys.readouterr().err
    assert os.listdir(tmp_path) == ["even.json"]


def test_a_reference_that_cannot_be_told_is_asked_for(model, monkeypatch, capsys):
    feed(monkeypatch, "a,b\n0,1\n5,1\n")
    assert main(["compensate", "-", "--model", model]) == 2
    assert "Which column is the reference? Name it with --r; there are a, b" in capsys.readouterr().err


def test_a_band_that_was_cut_is_told(capsys):
    arguments = ["--samples=500", "--dt=0.01", "--min=-1", "--max=1", "--band", "10", "500"]
    assert main(["excite", "multisine", *arguments]) == 0
    assert "warning: The band (10, 500) Hz is cut at 50 Hz" in capsys.readouterr().err


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


@pytest.mark.long
def test_several_recordings_are_diagnosed_as_sessions(bench, tmp_path, capsys):
    record = pd.read_csv(bench / "bench.csv")
    parts = [tmp_path / "a.csv", tmp_path / "b.csv"]
    record[:1250].to_csv(parts[0], index=False)
    record[1250:].to_csv(parts[1], index=False)
    together = tmp_path / "both.csv"
    record.assign(run=(np.arange(len(record)) >= 1250).astype(int)).to_csv(together, index=False)
    model = f"{bench / 'servo.py'}:simulator"
    said = []
    for arguments in (list(map(str, parts)), [str(together), "--session", "run", "--u", "drive"]):
        assert main(["diagnose", *arguments, "--model", model, FEW, "--json", "-"]) == 0
        said.append(capsys.readouterr())
    assert json.loads(said[0].out) == json.loads(said[1].out)
    assert f"2 recordings, each another session: {parts[0]}, {parts[1]}." in said[0].err
    assert said[0].err.count("Sampling period 0.01 s") == 1  # what is so of all is said once


def test_nothing_reaches_from_one_recording_into_the_next(tmp_path, capsys):
    record = first_order(400)
    for name, part in (("a", record[:200]), ("b", record[200:])):
        part[["y", "u"] if name == "b" else ["u", "y"]].to_csv(tmp_path / f"{name}.csv", index=False)
    record.assign(run=np.repeat([0, 1], 200)).to_csv(tmp_path / "both.csv", index=False)
    lags = ["--output-lags=1", "--input-lags=1", "--degree=1", "--dt=0.1", "--save", "-", "--quiet"]
    models = []
    for files in (["a.csv", "b.csv"], ["both.csv", "--session", "run"]):
        assert main(["identify", *(str(tmp_path / f) if "." in f else f for f in files), *lags]) == 0
        models.append(capsys.readouterr().out)
    assert models[0] == models[1]


def test_simulated_outputs_of_several_recordings_are_joined_by_name(tmp_path):
    (tmp_path / "a.csv").write_text("t,u,y,y_sim\n0,1,2,3\n1,4,5,6\n")
    (tmp_path / "b.csv").write_text("t,y_sim,y,u\n0,30,20,10\n1,60,50,40\n2,61,51,41\n6,90,80,70\n")
    files = [str(tmp_path / name) for name in ("a.csv", "b.csv")]
    read = read_recordings(files, make_parser("p").parse_args(["diagnose", *files]), simulated=True)
    assert read.u["u"].tolist() == [1, 4, 10, 40, 41, 70]
    assert read.y_sim["y_sim"].tolist() == [3, 6, 30, 60, 61, 90]
    assert read.sessions.tolist() == [0, 0, 1, 1, 1, 2]  # a gap begins a session of its own
    assert any(note.startswith(f"{files[1]}: 1 gap in time") for note in read.notes)


@pytest.mark.parametrize(
    ("other", "code", "message"),
    [
        ("u [A],y\n1,2\n3,4\n", 1, "Column 'u' is in 'A' in b.csv and in 'V' in a.csv; recordings that"),
        ("u,y\n1,2\n3,4\n", 1, "Column 'u' is without a unit in b.csv and in 'V' in a.csv;"),
        ("u [V],y_2\n1,2\n3,4\n", 1, "For --y, b.csv has 'y_2', and a.csv has 'y'; recordings that are"),
        ("t,u [V],y\n0,1,2\n1,3,4\n", 1, "a.csv does not tell the time as b.csv does. Add a time column"),
        (None, 2, "a.csv is named twice; a recording counts once."),
    ],
)
def test_recordings_that_do_not_go_together_are_told(tmp_path, monkeypatch, capsys, other, code, message):
    monkeypatch.chdir(tmp_path)
    Path("a.csv").write_text("u [V],y\n1,2\n3,5\n")
    Path("b.csv").write_text(other or "")
    assert main(["identify", "a.csv", "a.csv" if other is None else "b.csv"]) == code
    assert message in capsys.readouterr().err


def test_recordings_of_two_periods_are_refused(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    for name, period in (("a.csv", 0.1), ("b.csv", 0.2)):
        first_order(30).assign(t=period * np.arange(30)).to_csv(name, index=False)
    assert main(["identify", "a.csv", "b.csv"]) == 1
    told = capsys.readouterr().err
    assert "b.csv is sampled every 0.2 s, a.csv every 0.1 s; " in told
    assert "Pass --resample 0.2, or mend the unit" in told


@pytest.mark.long
def test_diagnose_takes_a_simulated_trace_with_semicolons_and_decimal_commas(bench, capsys, monkeypatch):
    monkeypatch.setattr(sys, "stdin", io.TextIOWrapper(io.BytesIO((bench / "trace.csv").read_bytes())))
    arguments = ["--u", "drive", "--y", "position", "--y-sim", "y_sim", FEW, "--json", "-"]
    assert main(["diagnose", "-", *arguments]) == 0
    said = capsys.readouterr()
    content = json.loads(said.out)
    assert content["verdict"] in ("refit", "explained", "ambiguous", "unknown")
    # those of the twin's equation of motion
    assert {row["parameter"] for row in content["parameters"]} == {"drive", "position", "position'"}
    assert "decimal comma" in said.err
    assert "Verdict:" in said.err


def test_a_trace_that_diverges_is_refused_and_one_in_another_unit_is_not(bench, capsys, tmp_path):
    record = pd.read_csv(bench / "bench.csv").assign(y_sim=lambda table: table["position [m]"])
    growing = 1.1 ** np.arange(len(record))
    record.assign(y_sim=growing).to_csv(tmp_path / "grows.csv", index=False)
    columns = ["--u", "drive", "--y", "position"]
    assert main(["diagnose", str(tmp_path / "grows.csv"), *columns]) == 1
    told = capsys.readouterr().err
    spread = np.ptp(record["position [m]"])
    row = int(np.log(1e6 * spread) / np.log(1.1)) + 2  # rows count from 1
    assert f"'y_sim' has diverged: it is {growing[row - 1]:.3g} in row {row} of the values" in told
    y = record[["position [m]"]]
    check_trace(y * 1e9, y)


@pytest.mark.long
def test_demo_names_its_friction_and_writes_a_report(tmp_path, capsys, monkeypatch):
    pytest.importorskip("jinja2")
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(_demo, "demo_record", lambda: demo_record(1500))  # a third of it: the same, sooner
    assert main(["demo", "--json", "demo.json", "--csv", "demo.csv"]) == 0
    told = capsys.readouterr().err
    assert "Report written to narx-demo.html" in told
    assert "search for missing physics" not in told  # progress is for terminals
    finding = json.loads((tmp_path / "demo.json").read_text())["findings"][0]
    assert finding["effect"] == "coulomb_friction"
    assert finding["parameters"]["Fc"] == pytest.approx(1.6, rel=0.05)
    assert "Coulomb friction" in (tmp_path / "narx-demo.html").read_text(encoding="utf-8")
    assert sorted(os.listdir(tmp_path)) == ["demo.csv", "demo.json", "narx-demo.html"]


def test_words_and_numbers_are_told_before_a_report_that_fails(bench, tmp_path, capsys, monkeypatch):
    def broken(*_, **__):
        raise ValueError("no page today")

    monkeypatch.setattr(narx_sklearn.report, "render_report", broken)
    asked = ["diagnose", str(bench / "bench.csv"), "--model", str(bench / "servo.py"), FEW, "--quiet"]
    assert main([*asked, "--json", str(tmp_path / "a.json"), "--report", str(tmp_path / "a.html")]) == 1
    said = capsys.readouterr()
    assert "Coulomb friction" in said.out
    assert "no page today" in said.err
    assert json.loads((tmp_path / "a.json").read_text())["findings"]
    assert not (tmp_path / "a.html").exists()


@pytest.mark.long
def test_a_report_is_written_where_no_experiment_can_be_proposed(bench, tmp_path, monkeypatch):
    def lost(*_):
        raise ValueError("In 500 samples a simulation is lost.")

    monkeypatch.setattr(_diagnose, "propose", lost)
    asked = ["diagnose", str(bench / "bench.csv"), "--model", str(bench / "servo.py"), FEW, "--quiet"]
    assert main([*asked, "--report", str(tmp_path / "a.html")]) == 0
    page = (tmp_path / "a.html").read_text(encoding="utf-8")
    assert "No experiment is proposed that would tell more. In 500 samples a simulation is lost." in page
