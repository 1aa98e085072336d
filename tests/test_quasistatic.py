"""Quasi-static sets and bounding structures against the thesis's formulas and a slow twin."""

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from thesis_models import (
    EXAMPLE_2_9,
    EXAMPLE_2_10,
    EXAMPLE_4_1,
    M_I,
    M_R,
    PHI,
    THETA_4_1,
    THETA_I,
    THETA_R,
)

from narx_sklearn.analysis import (
    bounding_structure,
    fixed_points,
    hysteresis_loop,
    quasi_static_sets,
)
from narx_sklearn.model import (
    AbsoluteDifference,
    AsymmetricSign,
    FunctionPhi,
    HystereticOperator,
    NARXModel,
    Play,
    SmoothSign,
    TermLibrary,
)

SINE = 70.0 * np.sin(2.0 * np.pi * np.arange(1000) * 0.001)  # V, the input of Figures 4.2 and 5.3


def delayed(values, lag):
    return np.concatenate([np.full(lag, values[0]), values[: values.size - lag]])


def held_phi(u):
    phi1 = np.diff(u, prepend=u[0])
    return phi1, np.sign(phi1)


def test_example_4_1_has_the_sets_of_its_formulas():
    t1, t2, t3, t4, t5, t6 = THETA_4_1
    phi1, phi2 = (delayed(p, 1) for p in held_phi(SINE))
    u = delayed(SINE, 1)
    with np.errstate(divide="ignore", invalid="ignore"):
        loading = (t2 * phi1 + t3 * phi1 * u + t5 * phi1 * u**2) / (1 - t1 - t4 * phi1 - t6 * phi1 * u)
        unloading = (t2 * phi1 - t3 * phi1 * u + t5 * phi1 * u**2) / (1 - t1 + t4 * phi1 - t6 * phi1 * u)
    expected = np.where(phi2 > 0, loading, unloading)  # (4.6)
    slope = t1 + t4 * phi2 * phi1 + t6 * phi1 * u  # (4.7)
    sets = quasi_static_sets(EXAMPLE_4_1, SINE)
    np.testing.assert_array_equal(sets.sample, np.flatnonzero(phi2))
    np.testing.assert_array_equal(sets.direction, phi2[sets.sample])
    np.testing.assert_array_equal(sets.level, u[sets.sample])
    np.testing.assert_allclose(sets.y[:, 0], expected[sets.sample], rtol=1e-8)  # 1 - t1 - ... cancels
    np.testing.assert_array_equal(sets.is_attracting[:, 0], np.abs(slope[sets.sample]) < 1.0)


def test_example_4_1_attracts_right_of_the_pole_in_loading_and_left_of_it_in_unloading():
    pole = -THETA_4_1[3] / THETA_4_1[5]  # -38.87 V, where the slope is 1 whatever the rate
    sets = quasi_static_sets(EXAMPLE_4_1, SINE)
    expected = np.where(sets.direction > 0, sets.level > pole, sets.level < -pole)
    np.testing.assert_array_equal(sets.is_attracting[:, 0], expected)


def test_the_first_five_terms_of_example_4_1_have_attracting_sets_only():
    keys = [str(term) for term in EXAMPLE_4_1.library]
    five = {k: v for k, v in zip(keys, EXAMPLE_4_1.parameters[:, 0], strict=True) if v != THETA_4_1[5]}
    assert len(five) == 5
    assert quasi_static_sets(NARXModel.from_equations(five, phi=PHI), SINE).is_attracting.all()  # Figure 4.4


def test_model_5_2_has_the_sets_of_its_formulas():
    t1, t2, t3, t4, t5, t6, t7, t8, t9 = THETA_R
    sets = quasi_static_sets(M_R, SINE)
    f, s = (delayed(p, 1)[sets.sample] for p in held_phi(SINE))
    u = sets.level
    numerator = t2 * f + s * t3 * f * u + t5 * f * u**2 + s * t8 * f**2 + s * t9 * u
    slope = t1 + s * t4 * f + t6 * f * u + s * t7  # (5.5)
    np.testing.assert_allclose(sets.y[:, 0], numerator / (1.0 - slope), rtol=1e-8)  # (5.4)
    np.testing.assert_allclose(sets.radius[:, 0], np.abs(slope), rtol=1e-14)


def test_model_5_6_reads_every_regressor_at_its_own_lag():
    t1, t2, t3, t4, t5, t6, t7, t8, t9 = THETA_I
    sets = quasi_static_sets(M_I, SINE)
    phi1, phi2 = held_phi(SINE)
    now, f, s, u = (delayed(v, lag)[sets.sample] for v, lag in ((phi1, 1), (phi1, 2), (phi2, 2), (SINE, 2)))
    numerator = t2 * f + t3 * s * f * u + t5 * f * u**2 + t8 * now + t9 * s * f**2
    slope = t1 + t4 * s * f + t6 * f * u + t7 * s  # (5.8)
    settled = sets.sample > 3
    expected = numerator[settled] / (1.0 - slope[settled])  # (5.7)
    np.testing.assert_allclose(sets.y[settled, 0], expected, rtol=1e-7)


def test_the_loop_of_example_4_1_lies_between_its_attracting_sets():
    loop = hysteresis_loop(EXAMPLE_4_1, -70.0, 70.0, samples_per_branch=500, shape="sine")
    sets = quasi_static_sets(EXAMPLE_4_1, SINE)
    level, upper = sets.select(1, attracting=True)
    assert np.nanmin(upper) > np.interp(level[np.nanargmin(upper)], loop.u[:501], loop.y[:501])
    assert np.nanmax(sets.select(-1, attracting=True)[1]) < loop.y[loop.u.size // 2 :].max()


def test_levels_at_a_rate_agree_with_a_ramp():
    ramp = np.arange(-2.0, 2.0, 0.05)
    on_ramp = quasi_static_sets(M_I, ramp)
    settled = on_ramp.sample > 3
    at_levels = quasi_static_sets(M_I, on_ramp.level[settled], rate=0.05)
    up = at_levels.direction > 0
    np.testing.assert_allclose(at_levels.y[up], on_ramp.y[settled], rtol=1e-6)
    np.testing.assert_allclose(at_levels.radius[up], on_ramp.radius[settled], rtol=1e-9)


@given(seed=st.integers(0, 10_000))
def test_sets_are_those_of_one_sample_at_a_time(seed):
    rng = np.random.default_rng(seed)
    variables = ["y[k-1]", "y[k-2]", "u[k-1]", "phi1[k-1]", "phi2[k-2]"]
    library = TermLibrary.polynomial(variables, degree=3)
    chosen = library.subset(rng.choice(len(library), size=6, replace=False))
    origin = {"y": rng.normal(), "u": rng.normal()}
    model = NARXModel(chosen, rng.normal(scale=0.5, size=6), phi=PHI, origin=origin)
    u = np.sin(np.arange(12) * 0.7)
    sets = quasi_static_sets(model, u)
    phi1, phi2 = held_phi(u)
    for point, k in enumerate(sets.sample):
        known = {
            "u[k-1]": delayed(u, 1)[k] - origin["u"],
            "phi1[k-1]": delayed(phi1, 1)[k],
            "phi2[k-2]": delayed(phi2, 2)[k],
        }
        side = model.equation().substitute(known)
        found = sets.y[point][np.isfinite(sets.y[point])] - origin["y"]
        for y in found:
            at = {"y[k-1]": y, "y[k-2]": y}
            assert abs(side(at) - y) <= 1e-6 * max(1.0, abs(y)) ** 3
        balance = np.zeros(4)
        for term, value in side.items:
            balance[term.degree] += value
        balance[1] -= 1.0
        grid = np.linspace(-20.0, 20.0, 40_001)
        values = np.polynomial.polynomial.polyval(grid, balance)
        crossings = grid[:-1][np.diff(np.sign(values)) != 0]
        assert all(np.abs(found - crossing).min() < 2e-3 for crossing in crossings)  # none is missed


def test_example_2_9_is_bounded_by_plus_and_minus_five():
    structure = bounding_structure(EXAMPLE_2_9, np.linspace(-1.0, 1.0, 11))
    np.testing.assert_allclose(structure.sets.y[:, 0], 5.0 * structure.sets.direction, rtol=1e-14)
    assert structure.theorem == "2.2"
    assert structure.is_stable
    assert structure.width == pytest.approx(10.0)


@pytest.mark.parametrize("samples", [10, 30, 300])
def test_the_loop_of_example_2_9_stays_inside_and_approaches_its_bounds_when_slow(samples):
    loop = hysteresis_loop(EXAMPLE_2_9, -1.0, 1.0, samples_per_branch=samples, shape="sine")
    assert np.abs(loop.y).max() <= 5.0
    # half a period from -y to y: y = 5 (1 - 0.9^n) - 0.9^n y
    decay = 0.9**samples
    assert loop.y.max() == pytest.approx(5.0 * (1.0 - decay) / (1.0 + decay), rel=1e-3)


def test_example_2_10_is_bounded_by_five_u_above_and_minus_five_below():
    levels = np.linspace(-1.0, 1.0, 21)
    sets = bounding_structure(EXAMPLE_2_10, levels).sets
    np.testing.assert_allclose(sets.y[sets.direction > 0, 0], 5.0 * levels, rtol=1e-12, atol=1e-12)
    np.testing.assert_allclose(sets.y[sets.direction < 0, 0], -5.0, rtol=1e-12)
    loop = hysteresis_loop(EXAMPLE_2_10, -1.0, 1.0, samples_per_branch=300)
    assert loop.asymmetry > 0.2


@given(
    s0=st.floats(-2, 2), sy=st.floats(-1.5, 1.5), sp=st.floats(-2, 2).filter(bool), syp=st.floats(-1.5, 1.5)
)
def test_the_form_of_theorem_2_3_has_its_equilibria_and_its_domain_of_validity(s0, sy, sp, syp):
    assume(min(abs(abs(sy + syp) - 1.0), abs(abs(sy - syp) - 1.0)) > 1e-6)
    model = NARXModel.from_equations(
        {"1": s0, "y[k-1]": sy, "phi2[k-1]": sp, "y[k-1]*phi2[k-1]": syp}, phi=[PHI[1]]
    )
    structure = bounding_structure(model, [0.0])
    loading, unloading = structure.sets.y[:, 0]
    assert loading == pytest.approx((sp + s0) / (1.0 - sy - syp), rel=1e-9, abs=1e-9)  # (2.62)
    assert unloading == pytest.approx((-sp + s0) / (1.0 - sy + syp), rel=1e-9, abs=1e-9)
    assert structure.is_stable == (abs(sy + syp) < 1.0 and abs(sy - syp) < 1.0)  # (2.63)
    assert structure.theorem in ("2.2", "2.3")


def test_a_bounding_structure_is_the_fixed_points_with_the_sign_held():
    levels = [-1.0, 0.3]
    sets = bounding_structure(M_R, levels).sets
    for level, direction, y in zip(sets.level, sets.direction, sets.y[:, 0], strict=True):
        held = fixed_points(M_R, [level], phi={"phi1": 0.0, "phi2": direction})
        assert held[0].y[0] == pytest.approx(y, rel=1e-12)


def test_structures_that_confine_nothing_say_so():
    outside = NARXModel.from_equations("1.1*y[k-1] + 0.5*phi2[k-1]", phi=[PHI[1]])
    assert "not stable in both regimes" in str(bounding_structure(outside, [0.0]))
    linear = NARXModel.from_equations("0.9*y[k-1] + 0.5*u[k-1]")
    assert "the same in both regimes" in str(bounding_structure(linear, [0.0, 1.0]))
    assert bounding_structure(linear, [0.0]).theorem is None
    assert "no equilibrium" in str(bounding_structure(EXAMPLE_4_1, [1.0]))


@pytest.mark.parametrize(
    "phi",
    [
        AbsoluteDifference("u"),
        SmoothSign("u", width=0.01),
        AsymmetricSign("u", rising=(0.2, 1), falling=(-1,)),
        Play("u", radius=0.5),
        FunctionPhi(lambda now, before: (now - before) * now, ["u[k]", "u[k-1]"]),
    ],
    ids=lambda phi: type(phi).__name__,
)
def test_every_kind_of_phi_has_sets_at_levels_as_on_a_long_ramp(phi):
    model = NARXModel.from_equations("0.8*y[k-1] + 0.3*phi1[k-1] + 0.1*u[k-2]", phi=[phi])
    ramp = np.arange(-3.0, 3.0, 0.02)
    on_ramp = quasi_static_sets(model, ramp)
    late = on_ramp.sample > 100
    at_levels = quasi_static_sets(model, on_ramp.level[late], rate=0.02)
    np.testing.assert_allclose(at_levels.y[at_levels.direction > 0], on_ramp.y[late], rtol=1e-9, atol=1e-12)


def test_the_hysteretic_operator_has_sets_on_its_signal():
    model = NARXModel.from_equations("phi1[k]", phi=[HystereticOperator("u")])
    u = np.array([0.0, 1.0, 2.0, 1.0, 0.0])
    sets = quasi_static_sets(model, u)
    np.testing.assert_allclose(sets.y[:, 0], model.phi[0].run(u)[sets.sample])


def test_a_function_of_output_and_input_has_sets():
    phi = FunctionPhi(lambda y, u: np.tanh(y - u), ["y[k]", "u[k]"], name="phi1")
    model = NARXModel.from_equations("0.5*phi1[k-1] + 0.1*phi2[k-1]", phi=[phi, PHI[1]])
    sets = quasi_static_sets(model, [0.0, 0.5, 1.0], rate=0.01)
    expected_sign = 0.1 * sets.direction[:, None]
    residual = 0.5 * np.tanh(sets.y - sets.level[:, None]) + expected_sign - sets.y
    assert np.nanmax(np.abs(residual)) < 1e-9
    assert np.isfinite(sets.y).any(axis=1).all()


def test_tables_and_selections_hold_every_solution_once():
    sets = quasi_static_sets(EXAMPLE_4_1, SINE)
    frame = sets.to_frame()
    assert len(frame) == np.isfinite(sets.y).sum()
    n_selected = sum(
        np.isfinite(sets.select(direction, attracting=attracting)[1]).sum()
        for direction in (1, -1)
        for attracting in (True, False)
    )
    assert n_selected == len(frame)
    assert set(frame["regime"]) == {"loading", "unloading"}


def test_bad_arguments_are_refused():
    with pytest.raises(ValueError, match=r"rate must be positive and finite .* got 0"):
        quasi_static_sets(EXAMPLE_2_9, [0.0], rate=0)
    with pytest.raises(ValueError, match="driver='v'"):
        quasi_static_sets(EXAMPLE_2_9, [0.0], driver="v")
    with pytest.raises(ValueError, match="output='v'"):
        quasi_static_sets(EXAMPLE_2_9, [0.0], output="v")
