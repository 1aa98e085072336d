"""Hysteresis verdicts: continuum of steady states, loops, memory, symmetry, rate; Assumption 4.1."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from thesis_models import EXAMPLE_2_9, EXAMPLE_2_10, EXAMPLE_4_1, M_I, M_INVERSE, M_R, PHI

from narx_sklearn.analysis import continuum_of_steady_states, hysteresis_loop, hysteresis_report
from narx_sklearn.identification.structure.candidates import structure_filter
from narx_sklearn.identification.structure.hysteresis import hysteresis_structure, vanishes_at_rest
from narx_sklearn.model import (
    AsymmetricSign,
    FunctionPhi,
    HystereticOperator,
    NARXModel,
    Play,
    TermLibrary,
    free_run,
)


def of(equations, phi=PHI, **fields):
    return NARXModel.from_equations(equations, phi=phi, **fields)


@pytest.mark.parametrize("model", [EXAMPLE_4_1, M_R, M_I, M_INVERSE], ids=["4.5", "5.2", "5.6", "5.9"])
def test_the_models_of_table_5_1_have_a_continuum_of_steady_states(model):
    verdict = continuum_of_steady_states(model)
    assert verdict.exists
    assert verdict.violations == ()
    assert verdict.output_sums[0, 0] == 1.0
    u = np.concatenate([40.0 * np.sin(0.01 * np.arange(700)), np.full(500, 40.0 * np.sin(6.99))])
    y = free_run(model, u, np.zeros(model.max_lag)).y[:, 0]
    assert np.ptp(y[710:]) == 0.0  # stays where the input stopped


@pytest.mark.parametrize(
    ("equation", "reason"),
    [
        ("0.9*y[k-1] + 0.5*phi2[k-1]", "the output coefficients sum to 0.9, which is not 1"),
        ("2.5*y[k-1] - 1.5*y[k-2]", "sum to 1, but another eigenvalue has modulus 1.5"),
        ("y[k-1] + 0.1*u[k-1]", "u keeps acting when the input stops"),
        ("y[k-1] + 0.1 + 0.2*u[k-1]^2", "1, u^2 keep acting"),
    ],
)
def test_models_without_a_continuum_say_why(equation, reason):
    verdict = continuum_of_steady_states(of(equation))
    assert not verdict.exists
    assert reason in verdict.reason


def test_terms_that_cancel_at_rest_do_no_harm_but_are_reported():
    verdict = continuum_of_steady_states(of("1.4*y[k-1] - 0.4*y[k-2] + 0.1*u[k-1] - 0.1*u[k-2]"))
    assert verdict.exists
    assert verdict.other_radius == pytest.approx(0.4)
    assert verdict.violations == ("u",)


def test_powers_of_the_output_that_vanish_at_rest_leave_the_continuum():
    verdict = continuum_of_steady_states(of("y[k-1] + 0.1*y[k-1]^2*phi1[k-1]"))
    assert verdict.exists
    assert verdict.violations == ("y^2*phi1",)


def test_the_operating_point_is_where_the_terms_vanish():
    assert continuum_of_steady_states(of("y[k-1] + 0.5*phi1[k-1]", origin={"y": 300.0})).exists


def test_several_outputs_can_rest_along_a_line_or_anywhere():
    line = NARXModel.from_equations({"a": "a[k-1]", "b": "0.5*a[k-1] + 0.5*b[k-1]"})
    assert continuum_of_steady_states(line).exists
    assert continuum_of_steady_states(line).other_radius == pytest.approx(0.5)
    plane = NARXModel.from_equations({"a": "a[k-1]", "b": "b[k-1]"})
    assert continuum_of_steady_states(plane).exists
    drift = NARXModel.from_equations({"a": "a[k-1] + b[k-1]", "b": "0.5*b[k-1] + 1"})
    assert not continuum_of_steady_states(drift).exists


def test_memory_of_a_phi_regressor_is_another_reason_to_stay():
    verdict = continuum_of_steady_states(of("0.5*y[k-1] + phi1[k-1]", phi=[Play("u", radius=1.0)]))
    assert verdict.exists
    assert "memory of phi1, not by Lemma 4.1" in verdict.reason
    assert not continuum_of_steady_states(of("y[k-1] + phi1[k-1]", phi=[Play("u", radius=1.0)])).exists


@given(seed=st.integers(0, 10_000))
def test_models_of_the_structure_with_lemma_4_1_stay_where_the_input_stops(seed):
    rng = np.random.default_rng(seed)
    variables = ["y[k-1]", "y[k-2]", "u[k-1]", "phi1[k-1]", "phi2[k-2]"]
    keep = structure_filter("hysteresis", (), ["y"], ["u"], PHI)
    library = TermLibrary.polynomial(variables, degree=3).filter(keep)
    moving = library - TermLibrary(["y[k-1]", "y[k-2]"])
    chosen = moving.subset(rng.choice(len(moving), size=4, replace=False))
    second = rng.uniform(-0.9, 0.9)  # eigenvalues 1 and -c(2)
    equation = {"y[k-1]": 1.0 - second, "y[k-2]": second}
    equation |= {str(term): rng.normal(scale=0.05) for term in chosen}
    model = of(equation)
    verdict = continuum_of_steady_states(model)
    assert verdict.exists
    assert verdict.other_radius == pytest.approx(abs(second), abs=1e-9)
    u = np.concatenate([np.sin(0.3 * np.arange(40)), np.full(1000, 0.7)])
    y = free_run(model, u, np.zeros(model.max_lag)).y[:, 0]
    assert np.ptp(y[-10:]) < 1e-9 * max(1.0, np.abs(y[-1]))


def test_assumption_4_1_leaves_what_vanishes_at_rest_and_linear_outputs():
    library = TermLibrary.polynomial(["y[k-1]", "u[k-1]", "phi1[k-1]", "phi2[k-1]"], degree=3)
    keep = hysteresis_structure(["y"], ["u"], PHI)
    clusters = {"*".join(s if e == 1 else f"{s}^{e}" for s, e in t.cluster) for t in library.filter(keep)}
    assert clusters == {
        *("y", "phi1", "phi2", "y*phi1", "y*phi2", "u*phi1", "u*phi2", "phi1^2", "phi1*phi2"),
        *("y*u*phi1", "y*u*phi2", "u^2*phi1", "u^2*phi2", "y*phi1^2", "y*phi1*phi2", "u*phi1^2"),
        *("u*phi1*phi2", "phi1^3", "phi1^2*phi2"),
    }


@pytest.mark.parametrize("model", [EXAMPLE_4_1, M_R, M_I, M_INVERSE], ids=["4.5", "5.2", "5.6", "5.9"])
def test_every_term_of_the_published_models_is_a_candidate(model):
    keep = structure_filter("hysteresis", (), model.outputs, model.inputs, model.phi)
    assert all(keep(term) for term in model.library)


def test_functions_of_the_user_count_by_what_they_are_at_rest():
    moving = FunctionPhi(lambda a, b: (a - b) * a, ["u[k]", "u[k-1]"], name="phi1")
    square = FunctionPhi(np.square, ["u[k]"], name="phi2")
    assert vanishes_at_rest(moving)
    assert not vanishes_at_rest(square)
    assert not vanishes_at_rest(HystereticOperator("u"))
    assert vanishes_at_rest(AsymmetricSign("u", rising=(1, 2), falling=(-1,)))
    keep = hysteresis_structure(["y"], ["u"], [moving, square])
    library = TermLibrary(["phi1[k-1]", "phi2[k-1]", "y[k-1]*phi1[k-1]"])
    assert library.filter(keep).names == ["phi1[k-1]", "y[k-1]*phi1[k-1]"]


def test_the_loop_of_a_play_is_the_parallelogram_worked_by_hand():
    loop = hysteresis_loop(of("phi1[k]", phi=[Play("u", radius=1.0)]), -3.0, 3.0, samples_per_branch=600)
    assert loop.area == pytest.approx(8.0)  # width 2, height 4
    assert loop.y_range == pytest.approx(4.0)
    assert loop.opening == pytest.approx(0.5)
    assert loop.orientation == "counterclockwise"
    assert loop.asymmetry == pytest.approx(0.0, abs=1e-12)
    assert loop.settled
    assert loop.u.shape == loop.y.shape == (1201,)
    assert loop.to_frame()["regime"].value_counts()["unloading"] == 600


def test_a_slow_model_is_run_until_its_loop_repeats():
    slow = of("0.99*y[k-1] + 0.01*u[k-1]", phi=())
    loop = hysteresis_loop(slow, 0.0, 1.0, samples_per_branch=20)
    assert loop.settled
    assert loop.n_periods > 4
    assert loop.y.mean() == pytest.approx(0.5, abs=1e-3)  # that of the input


def test_a_loop_that_drifts_is_said_to():
    drifting = of("y[k-1] + 0.5*phi1[k-1] + 0.01*phi1[k-1]^2")
    report = hysteresis_report(drifting, -1.0, 1.0)
    assert not report.loops[0].settled
    assert "not settled after 64 periods: the loop still drifts" in str(report)


def test_other_inputs_are_held():
    model = of("u2[k]*phi1[k]", phi=[Play("u1", radius=1.0)], inputs=("u1", "u2"))
    loop = hysteresis_loop(model, -3.0, 3.0, samples_per_branch=60, driver="u1", at={"u2": 2.0})
    assert loop.y_range == pytest.approx(8.0)
    with pytest.raises(
        ValueError, match=r"at names \['u1'\]; it gives constant values of the inputs \['u2'\]"
    ):
        hysteresis_loop(model, -3.0, 3.0, driver="u1", at={"u1": 2.0})


def test_a_play_is_local_and_two_plays_are_not():
    one = hysteresis_report(of("phi1[k]", phi=[Play("u", radius=1.0)]), -5.0, 5.0)
    assert (one.has_loop, one.memory) == (True, "local")
    assert one.memory_spread < 1e-6
    two = of("phi1[k] + 0.5*phi2[k]", phi=[Play("u", radius=0.5), Play("u", radius=2.0)])
    both = hysteresis_report(two, -5.0, 5.0)
    assert (both.has_loop, both.memory, both.is_rate_dependent) == (True, "non-local", False)
    assert both.memory_spread > 0.01


def test_the_published_piezo_models_have_a_loop_local_memory_and_rest():
    report = hysteresis_report(M_R, -40.0, 40.0)
    assert report.has_loop
    assert report.memory == "local"
    assert report.is_symmetric
    assert report.continuum.exists
    assert 0.1 < report.loops[-1].opening < 0.25
    for word in ("loop: yes", "continuum of steady states: yes", "memory: local", "symmetric"):
        assert word in report.to_text()


def test_example_2_9_depends_on_the_rate_and_cannot_rest():
    report = hysteresis_report(EXAMPLE_2_9, -1.0, 1.0, samples_per_branch=10)
    assert report.has_loop
    assert report.is_rate_dependent
    assert not report.continuum.exists
    assert report.is_symmetric


def test_example_2_10_is_asymmetric():
    report = hysteresis_report(EXAMPLE_2_10, -1.0, 1.0)
    assert report.has_loop
    assert not report.is_symmetric


def test_a_lag_is_no_hysteresis():
    report = hysteresis_report(of("0.9*y[k-1] + 0.1*u[k-1]", phi=()), -1.0, 1.0)
    assert not report.has_loop
    assert report.memory == "none"
    assert "no, it closes as the input slows down" in str(report)


def test_a_constant_model_has_nothing_to_report():
    report = hysteresis_report(of("0.5*y[k-1] + 1", phi=()), -1.0, 1.0)
    assert (report.has_loop, report.memory, report.rate_sensitivity) == (False, "none", 0.0)


def test_slow_models_are_given_slow_inputs():
    report = hysteresis_report(of("0.99*y[k-1] + 0.01*u[k-1]", phi=()), -1.0, 1.0)
    assert report.loops[0].samples_per_branch == 995  # ten time constants of -1 / log(0.99)


def test_the_verdicts_do_not_depend_on_the_operating_point():
    shifted = of(
        EXAMPLE_4_1.equation(), origin={"y": 20.0, "u": 10.0}
    )  # the same model, moved to another place
    report, moved = hysteresis_report(EXAMPLE_4_1, -40.0, 40.0), hysteresis_report(shifted, -30.0, 50.0)
    assert moved.loops[-1].opening == pytest.approx(report.loops[-1].opening, rel=1e-6)
    assert moved.loops[0].y[0] == pytest.approx(report.loops[0].y[0] + 20.0, rel=1e-6)


def test_a_model_that_runs_away_is_said_to():
    runaway = of("1.5*y[k-1] + u[k-1]", phi=())
    with pytest.raises(ValueError, match=r"left the finite range at sample \d+ \(input .*quasi_static_sets"):
        hysteresis_loop(runaway, -1.0, 1.0)
    with pytest.raises(ValueError, match=r"u_min must lie below u_max, got u_min=1.0 and u_max=0.0"):
        hysteresis_loop(runaway, 1.0, 0.0)
