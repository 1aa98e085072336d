"""Every script in examples/ runs as from the command line and draws its figure, if it has one.

A script that needs a recording which is not there prints "skipped: ..." and ends; one that takes long knows
the option ``--quick``.
"""

import os
import runpy
import sys
from pathlib import Path

import pytest

EXAMPLES = Path(__file__).resolve().parents[1] / "examples"
SCRIPTS = sorted(path for path in EXAMPLES.glob("*.py") if not path.name.startswith("_"))
EMPTY_FIGURE = 5_000  # bytes; none of ours is as small
# whole diagnoses
SLOW = {"concealed_effect", "emps_friction", "own_effect", "simulink_trace", "tanks_overflow"}


def exit_code(script):
    """Run a script as Python does, and close its figures."""
    from matplotlib import pyplot as plt

    try:
        runpy.run_path(str(script), run_name="__main__")
    except SystemExit as end:
        return end.code
    finally:
        plt.close("all")
    return 0


@pytest.mark.parametrize(
    "script",
    [pytest.param(s, marks=[pytest.mark.long] if s.stem in SLOW else [], id=s.stem) for s in SCRIPTS],
)
def test_the_script_runs_and_draws_its_figure_if_it_has_one(script, tmp_path, monkeypatch, capsys):
    matplotlib = pytest.importorskip("matplotlib")
    matplotlib.use("Agg")
    quick = ["--quick"] if "--quick" in script.read_text(encoding="utf-8") else []
    monkeypatch.setattr(sys, "argv", [str(script), "--out", str(tmp_path / "figures"), *quick])
    monkeypatch.syspath_prepend(str(EXAMPLES))  # where Python looks first when it runs the script
    monkeypatch.chdir(tmp_path)
    beside = EXAMPLES.parents[1] / "shared" / "data"
    if "NARX_SKLEARN_DATA" not in os.environ and beside.is_dir():
        monkeypatch.setenv("NARX_SKLEARN_DATA", str(beside))
    assert not exit_code(script)
    said = capsys.readouterr().out
    if said.startswith("skipped:"):
        pytest.skip(said.strip())
    drawn = list(tmp_path.glob("figures/*.png"))
    assert drawn or "figure" not in script.read_text(encoding="utf-8"), f"{script.name} drew nothing"
    assert all(path.stat().st_size > EMPTY_FIGURE for path in drawn)


def test_there_are_scripts_to_run():
    assert {"quick_start", "thesis_2_1", "thesis_5_2_1"} <= {path.stem for path in SCRIPTS}
