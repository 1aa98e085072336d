"""A reference that goes farther or faster than the record that the model is from is told of, once."""

import warnings

import numpy as np
import pandas as pd
import pytest

from narx_sklearn import NARXRegressor
from narx_sklearn.cli import main
from narx_sklearn.compensation import InverseCompensator, RootCompensator, UnreachableWarning
from narx_sklearn.identification.records.record import Moments
from narx_sklearn.model import Difference, NARXModel

KNOWN = {
    "recorded": {"u": (-2.0, 0.0, 2.0), "y": (-1.0, 0.0, 1.0)},
    "recorded_change": {"u": 0.5, "y": 0.25},
}
MODEL = NARXModel.from_equations("0.5*y[k-1] + 0.2*u[k-1]", **KNOWN)
WIDE = {"limits": (-100.0, 100.0)}


def told(compensator, reference, **options):
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        compensator.predict(reference, **options)
    return [str(w.message) for w in caught]


def ramp(to, by):
    return np.minimum(np.arange(60) * by, to)


@pytest.mark.parametrize(("to", "by"), [(1.0, 0.25), (1.05, 0.1), (-1.0, -0.25), (0.6, 0.27)])
def test_references_within_the_record_are_silent(to, by):
    reference = ramp(to, by) if by > 0 else -ramp(-to, -by)
    assert told(RootCompensator(MODEL, **WIDE).fit(), reference) == []


def test_a_reference_that_goes_farther_is_told():
    (words,) = told(RootCompensator(MODEL, **WIDE).fit(), ramp(3.0, 0.2))
    assert words == (
        "The reference goes to 3 at sample 15, where the record showed an output from -1 to 1. Of what the "
        "machine does there the model knows nothing, and the law may go astray. Keep it within, or identify "
        "the model from a record that goes as far."
    )


def test_a_reference_that_goes_faster_is_told():
    (words,) = told(RootCompensator(MODEL, **WIDE).fit(), ramp(1.0, 0.4))
    assert (
        "changes by 0.4 in one sample, at sample 1, where the record's output changed by at most 0.25"
        in words
    )
    assert "faster than that at 2 of 60 samples" in words  # the third change is the last 0.2 to the end
    assert words.endswith("Slow it down, or identify the model from a record that goes as fast.")


def test_all_is_told_in_one_warning():
    assert "goes to 3 at sample 8, where" in told(RootCompensator(MODEL, **WIDE).fit(), ramp(3.0, 0.4))[0]
    assert told(RootCompensator(MODEL, **WIDE).fit(), ramp(3.0, 0.4))[0].endswith("goes as far and as fast.")
    (words,) = told(RootCompensator(MODEL).fit(), ramp(3.0, 0.4))  # its limits are those of the record
    assert words.startswith("Of 60 samples 59 had no admissible input")
    assert "The reference goes to 3 at sample 8" in words


def test_a_model_without_a_record_is_silent():
    bare = NARXModel.from_equations("0.5*y[k-1] + 0.2*u[k-1]")
    assert told(RootCompensator(bare, **WIDE).fit(), ramp(9.0, 5.0)) == []


def test_an_inverse_model_knows_the_record_of_its_input():
    inverse = NARXModel.from_equations(
        "5*y[k-1] - 2.5*y[k-2]", outputs=["u"], inputs=["y"],
        recorded=KNOWN["recorded"], recorded_change=KNOWN["recorded_change"],
    )  # fmt: skip
    (words,) = told(InverseCompensator(inverse, **WIDE).fit(), ramp(1.0, 0.4))
    assert "changes by 0.4 in one sample" in words


def test_a_fit_keeps_the_largest_change_within_a_session(tmp_path):
    u = np.array([0.0, 1.0, 3.0, 2.0, 50.0, 51.0, np.nan, 0.0, 0.5, 1.0])
    sessions = np.array([0, 0, 0, 0, 1, 1, 1, 1, 1, 1])
    moments = Moments.of(u[:, None], 2.0 * u[:, None], sessions)
    assert moments.change.tolist() == [4.0, 2.0]
    assert Moments.of(u[:, None], u[:, None]).change.tolist() == [48.0, 48.0]
    rng = np.random.default_rng(0)
    u = rng.uniform(-1, 1, 300)
    y = np.append(0.0, u[:-1])
    model = NARXRegressor(1, 1, degree=1).fit(u[:, None], y).model_
    assert model.recorded_change == pytest.approx(
        {"u": np.abs(np.diff(u)).max(), "y": np.abs(np.diff(y)).max()}
    )
    model.save(tmp_path / "model.json")
    assert NARXModel.load(tmp_path / "model.json").recorded_change == model.recorded_change
    assert model.expanded().recorded_change == model.recorded_change


@pytest.mark.parametrize("change", [-1.0, np.nan, np.inf])
def test_a_change_that_cannot_be_is_refused(change):
    with pytest.raises(ValueError, match="recorded_change must hold the largest change"):
        NARXModel.from_equations("0.5*y[k-1] + u[k-1]", recorded_change={"y": change})


def test_the_command_line_tells_it_too(tmp_path, capsys):
    MODEL.save(tmp_path / "model.json")
    pd.DataFrame({"r": ramp(0.8, 0.4)}).to_csv(tmp_path / "r.csv", index=False)
    asked = ["compensate", str(tmp_path / "r.csv"), "--model", str(tmp_path / "model.json"), "--quiet"]
    assert main([*asked, "--limits", "-100", "100"]) == 0
    assert "warning: The reference changes by 0.4 in one sample" in capsys.readouterr().err


def test_resting_where_the_model_was_never_recorded_asks_nothing_of_it():
    model = NARXModel.from_equations("y[k-1] + 0.2*phi1[k-1]", phi=[Difference("u")], **KNOWN)
    compensator = RootCompensator(model, **WIDE).fit()
    with warnings.catch_warnings():
        warnings.simplefilter("error", UnreachableWarning)
        assert compensator.predict(np.full(5, 9.0), m_init=1.0).tolist() == [1.0] * 5


def test_the_command_line_tells_of_a_law_whose_own_model_does_not_follow(tmp_path, capsys):
    path = tmp_path / "model.json"
    pd.DataFrame({"r": np.sin(0.1 * np.arange(200))}).to_csv(tmp_path / "r.csv", index=False)
    asked = ["compensate", str(tmp_path / "r.csv"), "--model", str(path), "--output", str(tmp_path / "u.csv")]
    NARXModel.from_equations("0.5*y[k-1] + 0.5*u[k-1]").save(path)
    assert main([*asked, "--quiet", "--limits", "-3", "3"]) == 0
    assert capsys.readouterr().err == ""
    assert main([*asked, "--quiet", "--limits", "-0.2", "0.2"]) == 0
    said = capsys.readouterr().err
    assert "no admissible input solved the law, so it was held" in said
    assert "Driven by this input not even the model follows the reference: it stays" in said
