"""The diagnosis on real recordings whose missing physics their authors documented; short training parts."""

import os
import sys
from importlib import import_module
from pathlib import Path

import numpy as np
import pytest

BENCHMARKS = Path(__file__).resolve().parent.parent / "benchmarks"
FRICTION = ["coulomb_friction", "asymmetric_friction", "stribeck_friction"]

pytestmark = pytest.mark.skipif(
    not os.environ.get("NARX_SKLEARN_DATA"), reason="NARX_SKLEARN_DATA names no folder of recordings"
)


@pytest.fixture(scope="module")
def cases():
    return _of_benchmarks("mismatch.cases")


@pytest.fixture(scope="module")
def diagnose():
    return _of_benchmarks("mismatch.judge").diagnose


def _of_benchmarks(name):
    sys.path.insert(0, str(BENCHMARKS))
    try:
        return import_module(name)
    finally:
        sys.path.remove(str(BENCHMARKS))


@pytest.mark.long
def test_silverbox_says_cubic_stiffness_and_extrapolates_to_the_arrow(cases, diagnose):
    outcome = diagnose(cases.silverbox(20_000), max_effects=1)
    assert outcome.effects == ["cubic_stiffness"]
    assert outcome.rmse["arrow"]["refitted"] > 12.0
    assert outcome.rmse["arrow"]["augmented"] < 1.0


@pytest.mark.long
def test_emps_says_dry_friction_of_the_documented_size(cases, diagnose):
    outcome = diagnose(cases.emps())
    assert outcome.effects[0] in FRICTION
    mass, friction = outcome.parameters["mass"], outcome.parameters[f"{outcome.effects[0]} Fc"]
    assert mass == pytest.approx(95.1, rel=0.05)
    assert mass * friction == pytest.approx(20.4, rel=0.10)
    assert outcome.gain("pulses") > 5.0


@pytest.mark.long
def test_tanks_say_overflow_that_spills_onward_and_run_freely_as_well_as_published_models(cases, diagnose):
    outcome = diagnose(cases.cascaded_tanks())
    assert outcome.effects[0] == "overflow"
    assert "going on to lower level" in outcome.diagnosis.findings_[0].place
    assert outcome.rmse["test"]["augmented"] < 0.34 < 0.6 < outcome.rmse["test"]["refitted"]


def test_linear_hold_of_the_raised_input_passes_through_a_sine_of_its_band(cases):
    time = np.arange(4000)
    sine = np.sin(2 * np.pi * 0.2 * time)[:, None]
    raised = cases.for_linear_hold(sine)
    # the mean of a triangle-weighted sine is the sine times sinc^2: raised by just that
    inside = slice(500, 3500)
    np.testing.assert_allclose(raised[inside], sine[inside] / np.sinc(0.2) ** 2, atol=5e-3)
