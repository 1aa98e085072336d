"""Laws rehearsed on a model of the machine beside a straight line, and what is told of those that lose."""

import warnings
from importlib import import_module

import numpy as np
import pandas as pd
import pytest
import scipy.signal

from narx_sklearn import NARXRegressor
from narx_sklearn.cli import main
from narx_sklearn.compensation import (
    AmplificationWarning,
    BoucWenCompensator,
    CompensationLaw,
    InverseCompensator,
    IsolatedCompensator,
    PrandtlIshlinskiiCompensator,
    Rehearsal,
    RootCompensator,
    Trial,
    UnreachableWarning,
)
from narx_sklearn.compensation.rehearsal import straight_line
from narx_sklearn.model import Difference, DifferenceSign, NARXModel, Polynomial
from narx_sklearn.physics import PrandtlIshlinskiiOperator
from narx_sklearn.signals import prfs

SINE = np.sin(2.0 * np.pi * np.arange(1001) / 100)
DOUBLES = NARXModel.from_equations("2*u[k-1]")


def doubled(u):
    return np.append(2.0 * u[0], 2.0 * u[:-1])


def explicit(text, **options):
    return CompensationLaw("explicit", (Polynomial.parse(text),), **options)


def coefficients(line):
    return {str(term): c for term, c in line.equations[0].coefficients.items()}


def stuck(u, *, band=3.0, slip=2.0):
    """A stem that sticks until the demand is a band away and then follows it by a slip, behind it a lag."""
    stem, flow, way, last = u[0], u[0], 0.0, u[0]
    out = np.empty(u.size)
    for k, now in enumerate(u):
        if (now - last) * way < 0.0:
            way = 0.0
        if way == 0.0 and abs(now - stem) > band:
            way = np.sign(now - stem)
        stem = now - way * slip if way else stem
        flow += 0.25 * (stem + 0.004 * (stem - 50.0) ** 2 - flow)
        out[k], last = flow, now
    return out


@pytest.fixture(scope="module")
def valve():
    u = 50.0 + prfs(3000, 0.02, 0.1, amplitudes=30.0, random_state=2)
    y = stuck(u)
    return u[:, None], y + 0.002 * np.ptp(y) * np.random.default_rng(7).normal(size=y.size)


def resting(structure, signal="u"):
    phi = Difference(signal, name="phi1"), DifferenceSign(signal, name="phi2")
    return NARXRegressor(
        1, 1, phi=phi, phi_lags=1, degree=3, structure=structure, constraints="continuum",
        fit_intercept=False, origin="zero",
    )  # fmt: skip


# -- by hand ---------------------------------------------------------------------------------------------


def test_a_law_is_worse_than_a_line_by_more_than_the_model_can_be_wrong_about_both():
    assert not Trial("r", law=0.75, line=0.25, deviation=1.0, doubt=0.25).is_worse
    assert Trial("r", law=0.76, line=0.25, deviation=1.0, doubt=0.25).is_worse
    assert Trial("r", law=np.inf, line=0.25, deviation=1.0, doubt=0.25).is_worse
    assert not Trial("r", law=9.0, line=np.nan, deviation=1.0).is_worse  # there is none


def test_the_line_reads_as_far_ahead_as_the_law_and_keeps_its_limits():
    law = explicit("3*r[k+2]", limits=(-0.5, 0.5), rate_limit=0.25)
    u = SINE[:200]
    line = straight_line(law, u, np.append([0.0, 0.0], 4.0 * u[:-2] + 8.0)[:, None], None)
    assert coefficients(line) == pytest.approx({"1": -2.0, "r[k+2]": 0.25}, abs=1e-12)
    assert (line.limits, line.rate_limit) == (law.limits, law.rate_limit)


def test_the_line_is_drawn_within_sessions_and_beside_other_inputs():
    rng = np.random.default_rng(0)
    u, v = rng.normal(size=(2, 40))
    sessions = np.repeat([0, 1], 20)
    y = np.full(40, np.nan)  # y[k] = 2 u[k-1] + v[k-1]; the first of each session is not of this record
    for begin in (0, 20):
        y[begin] = 99.0
        y[begin + 1 : begin + 20] = 2.0 * u[begin : begin + 19] + v[begin + 1 : begin + 20]
    line = straight_line(explicit("r[k+1] - v[k+1]", others=("v",)), u, np.column_stack([y, v]), sessions)
    assert coefficients(line) == pytest.approx({"r[k+1]": 0.5, "v[k+1]": -0.5, "1": 0.0}, abs=1e-12)


def test_what_a_law_leaves_is_counted_in_deviations_of_the_reference():
    """Of twice the right input the output is twice the reference, so that one reference is left."""
    rehearsal = Rehearsal.of(explicit("r[k+1]"), DOUBLES, SINE, doubled(SINE))
    assert [t.law for t in rehearsal.trials] == pytest.approx([1.0] * 4, abs=0.01)
    assert [t.line for t in rehearsal.trials] == pytest.approx([0.0] * 4, abs=1e-9)
    assert rehearsal.left == pytest.approx(1.0, abs=0.01)
    deviations = [t.deviation for t in rehearsal.trials]
    assert deviations == pytest.approx(np.array([0.5, 0.5, 0.25, 0.25]) * np.std(2.0 * SINE), rel=0.01)


def test_a_model_that_errs_doubts_its_own_verdict():
    noise = np.where(np.arange(SINE.size) % 2 == 0, 0.3, -0.3)
    rehearsal = Rehearsal.of(explicit("r[k+1]"), DOUBLES, SINE, doubled(SINE) + noise)
    assert rehearsal.error == pytest.approx(0.3, abs=1e-3)
    half, quarter = rehearsal.trials[0], rehearsal.trials[-1]
    assert half.doubt == pytest.approx(0.3 / half.deviation, abs=1e-3)
    assert half.is_worse  # 1 against twice 0.42
    assert not quarter.is_worse  # and against twice 0.85


def test_the_part_of_a_record_that_moves_most_is_rehearsed_whatever_its_gaps():
    u = np.concatenate([np.zeros(3000), SINE])
    y = doubled(u)
    y[2500] = np.nan
    whole = Rehearsal.of(explicit("r[k+1]"), DOUBLES, SINE, doubled(SINE))
    found = Rehearsal.of(explicit("r[k+1]"), DOUBLES, u, y, sessions=np.repeat([0, 1], [3000, SINE.size]))
    assert [t.deviation for t in found.trials] == pytest.approx([t.deviation for t in whole.trials], rel=0.01)


def test_nothing_is_rehearsed_where_the_record_rests_or_the_model_is_lost():
    for model, u in ((DOUBLES, np.ones(50)), (NARXModel.from_equations("9*y[k-1] + u[k-1]"), SINE)):
        rehearsal = Rehearsal.of(explicit("r[k+1]"), model, u, doubled(u))
        assert rehearsal.trials == ()
        assert rehearsal.worst is None
        assert np.isnan(rehearsal.left)
        assert "Nothing could be rehearsed" in str(rehearsal)


# -- what users are told ---------------------------------------------------------------------------------


def test_a_law_that_has_lost_its_reference_is_told_once_with_the_way_out():
    """A square cannot follow the lower half of a sine: left are that half, 71 % of all, and what is kept.

    That is the last output before it, h = sin(pi / 100): sqrt(1/2 + 2 h (2/pi) + h^2) = 0.735 in all.
    """
    compensator = RootCompensator(NARXModel.from_equations("u[k-1]^2"), branch="rising").fit()
    with pytest.warns(UnreachableWarning) as told:
        compensator.predict(np.sin(2.0 * np.pi * (np.arange(1000) + 0.5) / 100), m_init=0.0)
    (message,) = [str(one.message) for one in told]
    assert message.startswith("Of 1000 samples 501 had no admissible input")  # the end is held
    assert "not even the model follows the reference: it stays 74% of its deviation away from it" in message
    assert "structure='rate_independent', other lags or fewer terms" in message


def test_where_limits_alone_keep_a_law_from_its_reference_they_are_what_is_told():
    compensator = RootCompensator(DOUBLES, limits=(-0.2, 0.2)).fit()
    with pytest.warns(UnreachableWarning, match="widen the limits") as told:
        compensator.predict(SINE)
    assert "not even the model" not in str(told[0].message)
    trial = compensator.rehearse(SINE)
    assert trial.is_bound
    assert trial.law > 0.2


def test_of_an_input_that_comes_in_two_signs_either_is_right():
    """Of a square the law may take the other sign than the record; another model says that it follows."""
    rng = np.random.default_rng(1)
    u = np.convolve(rng.normal(size=1040), np.hanning(41), "valid") / 5.0
    y = np.append(0.0, u[:-1] ** 2) + 1e-3 * rng.normal(size=u.size)
    compensator = RootCompensator(NARXRegressor(1, 1, degree=2, n_terms=1)).fit(u[:, None], y)
    assert compensator.model_.library.names == ["u[k-1]^2"]
    assert not any(trial.is_worse for trial in compensator.rehearsal_.trials)


@pytest.mark.parametrize(
    "build",
    [
        lambda: RootCompensator(resting("hysteresis")),
        lambda: InverseCompensator(resting("hysteresis", "y")),
        lambda: RootCompensator(NARXRegressor(2, 2, degree=3)),
    ],
)
def test_laws_that_a_sticking_valve_follows_worse_than_a_line_are_told_at_fit(valve, build):
    X, y = valve
    reference = 50.0 + 10.0 * np.sin(2.0 * np.pi * np.arange(1200) / 600)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", AmplificationWarning)
        with pytest.warns(UnreachableWarning, match="The law does no better than a straight line"):
            compensator = build().fit(X, y)
        warnings.simplefilter("ignore", UnreachableWarning)
        m = compensator.predict(reference)
    line = compensator.rehearsal_.line.run(reference).m
    assert left(reference, m) > left(reference, line)
    assert "a straight line of it" in compensator.explain()
    assert "straight" not in compensator.explain("c")


def left(reference, m):
    return np.sqrt(np.mean((stuck(m) - reference)[100:] ** 2))


@pytest.mark.parametrize("compensator", [RootCompensator(), InverseCompensator()])
def test_the_defaults_beat_a_line_on_a_sticking_valve_and_say_so(valve, compensator):
    reference = 50.0 + 10.0 * np.sin(2.0 * np.pi * np.arange(1200) / 600)
    compensator.fit(*valve)
    line = compensator.rehearsal_.line.run(reference).m
    assert left(reference, compensator.predict(reference)) < 0.8 * left(reference, line)
    trial = compensator.rehearse(reference)
    assert trial.law < 0.8 * trial.line
    assert str(compensator.rehearsal_) in compensator.explain()


@pytest.mark.parametrize("estimator", [PrandtlIshlinskiiCompensator, BoucWenCompensator])
def test_a_law_of_hysteresis_is_rehearsed_on_a_machine_that_lags(estimator):
    u = SINE * np.linspace(0.2, 1.0, SINE.size)
    y = scipy.signal.lfilter([0.0, 0.05], [1.0, -0.95], u)
    y += 0.01 * y.std() * np.random.default_rng(0).normal(size=y.size)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", AmplificationWarning)
        with pytest.warns(UnreachableWarning, match="straight line.*not all there is: try RootCompensator"):
            compensator = estimator().fit(u[:, None], y)
        assert compensator.rehearsal_.worst.is_worse
        warnings.simplefilter("error", UnreachableWarning)
        compensator = estimator(rehearsed=False).fit(u[:, None], y)
    assert compensator.rehearsal_ is None
    assert compensator.rehearse(u) is None


def test_a_law_of_the_hysteresis_that_a_machine_has_is_no_worse_than_a_line():
    operator = PrandtlIshlinskiiOperator(radii=(0.0, 0.8, 1.7), weights=(5.88, 1.58, 0.47))
    u = 5.0 * np.tile(SINE[1:], 2) * np.linspace(0.2, 1.0, 2000)
    y = operator.run(u) + 0.1 * np.random.default_rng(0).normal(size=u.size)
    rehearsal = PrandtlIshlinskiiCompensator().fit(u[:, None], y).rehearsal_
    assert len(rehearsal.trials) == 4
    assert all(trial.law < trial.line for trial in rehearsal.trials)


@pytest.mark.parametrize("estimator", [RootCompensator, IsolatedCompensator, InverseCompensator])
def test_no_law_is_rehearsed_where_that_is_not_wanted(estimator):
    u = SINE[:300, None]
    compensator = estimator(NARXRegressor(1, 1, degree=1), rehearsed=False).fit(u, doubled(u[:, 0]))
    assert compensator.rehearsal_ is None
    assert compensator.explain() == str(compensator.law_)


def test_the_command_line_calls_methods_by_its_options(tmp_path, capsys):
    model = NARXModel.from_equations("0.5*y[k-1] + u[k-1] + 0.2*u[k-1]^2")
    model.save(tmp_path / "model.json")
    pd.DataFrame({"r": 0.2 * SINE}).to_csv(tmp_path / "r.csv", index=False)
    asked = ["compensate", str(tmp_path / "r.csv"), "--model", str(tmp_path / "model.json")]
    assert main([*asked, "--method", "isolated"]) == 1
    said = capsys.readouterr().err
    assert "use --method roots." in said
    assert "Compensator" not in said


@pytest.mark.parametrize(
    ("command", "said"),
    [("identify", "use `compensate --method roots`."), ("diagnose", "use RootCompensator.")],
)
def test_a_command_calls_by_options_only_what_it_knows(command, said, monkeypatch, capsys):
    def refuse(options):
        raise ValueError("Of this model use RootCompensator.")

    monkeypatch.setattr(import_module(f"narx_sklearn.cli._{command}"), "run", refuse)
    assert main([command, "record.csv"]) == 1
    assert said in capsys.readouterr().err


def test_the_command_line_tells_of_an_inverse_that_is_worse_than_a_line(tmp_path, capsys, monkeypatch):
    five = NARXModel.from_equations("5*y[k-1]", outputs=["u"], inputs=["y"])
    monkeypatch.setattr(InverseCompensator, "_best_inverse", lambda *_: five)
    pd.DataFrame({"u": SINE, "y": doubled(SINE)}).to_csv(tmp_path / "record.csv", index=False)
    pd.DataFrame({"r": 0.2 * SINE}).to_csv(tmp_path / "r.csv", index=False)
    asked = ["compensate", str(tmp_path / "r.csv"), "--record", str(tmp_path / "record.csv"), "--quiet"]
    assert main([*asked, "--method", "inverse", "--output", str(tmp_path / "m.csv")]) == 0
    said = capsys.readouterr().err
    assert said.count("no better than a straight line") == 1
    assert "this reference; the straight line" in said


@pytest.mark.parametrize(("structure", "is_told"), [("hysteresis", True), ("rate_independent", False)])
def test_identify_tells_of_a_structure_whose_law_is_worse_than_a_line(
    valve, tmp_path, capsys, structure, is_told
):
    X, y = valve
    pd.DataFrame({"u": X[:, 0], "y": y}).to_csv(tmp_path / "record.csv", index=False)
    assert main(["identify", str(tmp_path / "record.csv"), "--structure", structure, "--quiet"]) == 0
    said = capsys.readouterr().err
    assert ("The law does no better than a straight line." in said) is is_told
    assert ("Take --structure rate_independent" in said) is is_told
