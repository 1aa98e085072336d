"""Fixed points and static curves: the thesis's Example 2.7, laws of the free run, several outputs."""

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from thesis_models import EXAMPLE_2_9, EXAMPLE_4_1

from narx_sklearn.analysis import fixed_points, static_curve
from narx_sklearn.model import (
    Difference,
    FunctionPhi,
    NARXModel,
    Play,
    SmoothSign,
    TermLibrary,
    free_run,
    predict_one_step,
)

# no nearer to zero than a millionth: where an input multiplies a power of y, a point may lie at its inverse
INPUTS = st.floats(-1.5, 1.5).map(lambda value: round(value, 6))
THETA = (0.5, 0.2, 0.1, 0.05, -0.1, 0.02, 0.3)
MODEL_2_30 = NARXModel.from_equations(
    dict(
        zip(
            (
                "y[k-1]",
                "u[k-2]",
                "phi1[k-1]",
                "y[k-2]*u[k-4]",
                "y[k-1]*y[k-2]",
                "y[k-1]*u[k-1]",
                "u[k-1]*phi1[k-2]",
            ),
            THETA,
            strict=True,
        )
    ),
    phi=[Difference("u", name="phi1")],
)


def one_step(model, u, y):
    """Return the next output when inputs and outputs have been ``u`` and ``y`` for long."""
    n_samples = model.max_lag + 1
    prediction = predict_one_step(model, np.tile(u, (n_samples, 1)), np.tile(y, (n_samples, 1)))
    return prediction[-1]


@st.composite
def models(draw):
    """Draw a model of degree 3 with an operating point."""
    rng = np.random.default_rng(draw(st.integers(0, 10_000)))
    library = TermLibrary.polynomial(["y[k-1]", "y[k-2]", "u[k-1]", "phi1[k-1]"], degree=3)
    chosen = library.subset(rng.choice(len(library), size=6, replace=False)) | TermLibrary(["y[k-1]"])
    parameters = rng.normal(scale=0.4, size=len(chosen))
    origin = {"y": rng.normal(), "u": rng.normal()} if draw(st.booleans()) else {}
    return NARXModel(chosen, parameters, phi=[Difference("u")], origin=origin)


@pytest.mark.parametrize("u", [-2.0, 0.5, 1.0, 3.0])
def test_example_2_7_has_the_two_fixed_points_of_its_formulas(u):
    s_y, s_u, _, theta4, s_yy, theta6, _ = THETA
    s_yu = theta4 + theta6
    root = np.sqrt((s_yu * u + s_y - 1) ** 2 - 4 * s_yy * s_u * u)
    expected = sorted([(1 - s_y - s_yu * u + root) / (2 * s_yy), (1 - s_y - s_yu * u - root) / (2 * s_yy)])
    found = fixed_points(MODEL_2_30, [u])
    np.testing.assert_allclose([point.y[0] for point in found], expected, rtol=1e-12)
    for point, y in zip(found, expected, strict=True):
        d1, d2 = s_y + s_yy * y + theta6 * u, theta4 * u + s_yy * y  # (2.37)
        by_hand = np.roots([1.0, -d1, -d2])
        assert point.radius == pytest.approx(np.abs(by_hand).max(), rel=1e-12)
        assert (point.stability == "stable") == (np.abs(by_hand).max() < 1.0)


@given(model=models(), u=INPUTS)
def test_fixed_points_are_fixed_under_one_step(model, u):
    for point in fixed_points(model, [u]):
        size = max(1.0, np.abs(point.y[0])) ** 3
        assert (
            abs(one_step(model, [u], point.y)[0] - point.y[0]) <= 1e-6 * size
        )  # a double root is known to 1e-8


@pytest.mark.filterwarnings("ignore::narx_sklearn.exceptions.DivergenceWarning")
@given(model=models(), u=INPUTS)
def test_stable_fixed_points_attract_a_nearby_free_run_and_unstable_ones_repel_it(model, u):
    for point in fixed_points(model, [u]):
        assume(abs(point.radius - 1.0) > 0.02)
        assume(np.abs(point.y[0]) < 30.0)
        start = point.y[0] + 1e-7
        y = free_run(model, np.full((2000, 1), u), np.full(model.max_lag, start), bound=1e6).y[:, 0]
        if point.stability == "stable":
            assert abs(y[-1] - point.y[0]) < 1e-9 * max(1.0, abs(point.y[0]))
        else:
            assert np.nanmax(np.abs(y - point.y[0])) > 1e-6


@given(model=models(), u=INPUTS)
def test_the_operating_point_changes_nothing_in_measured_units(model, u):
    def values(m):
        return [point.y[0] for point in fixed_points(m, [u])]

    separate = np.array(values(model))
    assume(separate.size < 2 or np.diff(separate).min() > 1e-3)
    np.testing.assert_allclose(values(model.expanded()), separate, rtol=1e-6, atol=1e-6)


@given(model=models(), u=INPUTS)
def test_eigenvalues_are_those_of_a_jacobian_by_differences(model, u):
    for point in fixed_points(model, [u]):
        assume(np.abs(point.y[0]) < 10.0)
        lags = 2
        past = np.tile(point.y, (model.max_lag + 1, 1))
        slopes = []
        for lag in range(1, lags + 1):
            values = []
            for step in (1e-5, -1e-5):
                moved = past.copy()
                moved[-1 - lag] += step
                values.append(predict_one_step(model, np.full((len(past), 1), u), moved)[-1, 0])
            slopes.append((values[0] - values[1]) / 2e-5)
        assert point.radius == pytest.approx(np.abs(np.roots([1.0, *np.negative(slopes)])).max(), abs=1e-3)


def test_phi_regressors_can_be_held_at_given_values():
    assert fixed_points(EXAMPLE_2_9, [0.0])[0].y[0] == 0.0
    assert fixed_points(EXAMPLE_2_9, [0.0], phi={"phi2": 1.0})[0].y[0] == pytest.approx(5.0)
    with pytest.raises(ValueError, match=r"phi names \['phi9'\]; the phi regressors of the model are"):
        fixed_points(EXAMPLE_2_9, [0.0], phi={"phi9": 1.0})


def test_a_continuum_is_said_and_has_no_isolated_points():
    found = fixed_points(EXAMPLE_4_1, [12.0])
    assert found.is_continuum
    assert len(found) == 0
    assert "a continuum" in str(found)


def test_a_model_without_fixed_points_says_none():
    assert "none found" in str(fixed_points(NARXModel.from_equations("y[k-1] + 1"), [0.0]))


def test_linear_equations_of_several_outputs_are_solved_exactly():
    model = NARXModel.from_equations(
        {"a": "0.5*a[k-1] + 0.1*b[k-1] + u[k-1]", "b": "0.2*a[k-2] + 0.4*b[k-1]"}, origin={"a": 300.0}
    )
    found = fixed_points(model, [1.4])
    # 0.5 a - 0.1 b = 1.4, -0.2 a + 0.6 b = 0: a = 3, b = 1
    np.testing.assert_allclose(found[0].y, [303.0, 1.0], rtol=1e-12)
    assert found.is_exhaustive
    np.testing.assert_allclose(one_step(model, [1.4], found[0].y), found[0].y, rtol=1e-12)


def test_several_outputs_that_can_rest_anywhere_are_a_continuum():
    model = NARXModel.from_equations({"a": "a[k-1]", "b": "0.5*a[k-1] + 0.5*b[k-1]"})
    assert fixed_points(model, [0.0]).is_continuum
    assert not fixed_points(NARXModel.from_equations({"a": "a[k-1] + 1", "b": "b[k-1]"}), [0.0]).is_continuum


def test_nonlinear_equations_of_several_outputs_are_searched():
    model = NARXModel.from_equations({"a": "b[k-1]^2", "b": "a[k-1]"})  # a = a^2: 0 and 1
    found = fixed_points(model, [0.0])
    np.testing.assert_allclose([point.y for point in found], [[0.0, 0.0], [1.0, 1.0]], atol=1e-9)
    assert [point.stability for point in found] == ["stable", "unstable"]
    assert not found.is_exhaustive


def test_a_function_of_the_output_is_searched_too():
    phi = [FunctionPhi(lambda y: np.tanh(3.0 * y), ["y[k]"], name="phi1")]
    model = NARXModel.from_equations("0.5*phi1[k-1]", phi=phi)
    found = fixed_points(model, [0.0])
    assert [point.stability for point in found] == ["stable", "unstable", "stable"]
    assert found[1].radius == pytest.approx(1.5, abs=1e-8)
    for point in found:
        assert point.y[0] == pytest.approx(0.5 * np.tanh(3.0 * point.y[0]), abs=1e-9)


def test_phi_regressors_of_outputs_enter_the_jacobian():
    phi = [SmoothSign("y", width=0.1, name="phi1")]
    point = fixed_points(NARXModel.from_equations("0.5*y[k-1] + 0.2*phi1[k-1]", phi=phi), [0.0])[0]
    # at rest phi1[k-1] = (y[k-1] - y[k-2]) / 0.1: z^2 - 2.5 z + 2 = 0
    assert point.radius == pytest.approx(np.sqrt(2.0), rel=1e-12)


def test_a_play_of_the_output_needs_its_value():
    model = NARXModel.from_equations("0.5*y[k-1] + phi1[k-1]", phi=[Play("y", radius=0.1)])
    with pytest.raises(ValueError, match=r"phi1 is a play of y .* pass that value as phi=\{'phi1': value\}"):
        fixed_points(model, [0.0])
    assert fixed_points(model, [0.0], phi={"phi1": 1.0})[0].y[0] == pytest.approx(2.0)


def test_tables_hold_what_is_printed():
    frame = fixed_points(MODEL_2_30, [1.0]).to_frame()
    assert list(frame.columns) == ["y", "radius", "stability"]
    assert "u = 1" in str(fixed_points(MODEL_2_30, [1.0]))


def test_inputs_that_do_not_fit_are_refused():
    with pytest.raises(ValueError, match=r"X has 2 columns, the model has the 1 inputs \['u'\]"):
        fixed_points(MODEL_2_30, [1.0, 2.0])
    with pytest.raises(ValueError, match="not finite"):
        fixed_points(MODEL_2_30, [np.nan])


BISTABLE = NARXModel.from_equations("1.3*y[k-1] - 0.3*y[k-1]^3 + 0.2*u[k-1]")


def test_the_static_curve_follows_branches_through_their_folds():
    levels = np.linspace(-1.0, 1.0, 201)
    curve = static_curve(BISTABLE, levels)
    # folds where u = 1.5 (y^3 - y) turns: y = 1/sqrt(3), u = -+1/sqrt(3)
    inside = np.abs(levels) < 1.0 / np.sqrt(3.0)
    np.testing.assert_array_equal(np.isfinite(curve.y).sum(axis=1), np.where(inside, 3, 1))
    jumps = np.abs(np.diff(curve.y, axis=0))
    assert np.nanmax(jumps) < 0.2  # columns are branches
    for column, stable in zip(curve.y.T, curve.is_stable.T, strict=True):
        exists = np.isfinite(column)
        np.testing.assert_array_equal(stable[exists], np.abs(column[exists]) > 1.0 / np.sqrt(3.0))
    assert len(curve.to_frame()) == np.isfinite(curve.y).sum()


def test_the_static_curve_is_that_of_the_fixed_points_level_by_level():
    levels = np.linspace(-1.0, 1.0, 7)
    curve = static_curve(BISTABLE, levels)
    for row, level in zip(curve.y, levels, strict=True):
        expected = [point.y[0] for point in fixed_points(BISTABLE, [level])]
        np.testing.assert_allclose(np.sort(row[np.isfinite(row)]), expected)


def test_the_static_curve_of_one_of_several_inputs():
    model = NARXModel.from_equations("0.5*y[k-1] + u1[k-1]*u2[k-1]", inputs=("u1", "u2"))
    X = np.column_stack([[0.0, 1.0, 2.0], [3.0, 3.0, 3.0]])
    np.testing.assert_allclose(static_curve(model, X, driver="u1").y[:, 0], [0.0, 6.0, 12.0])
    with pytest.raises(ValueError, match=r"driver=None, .* must be one of \['u1', 'u2'\]"):
        static_curve(model, X)


def test_the_search_finds_every_branch_that_elimination_gives():
    model = NARXModel.from_equations(
        {"a": "0.5*a[k-1] + 0.1*b[k-1]^2 + u[k-1]", "b": "0.3*b[k-1] - 0.2*a[k-1]*b[k-1] + 0.1"}
    )
    curve = static_curve(model, np.linspace(-3.0, 2.0, 51))
    for level, row in zip(curve.levels, curve.y, strict=True):
        # a = 0.2 b^2 + 2 u leaves a cubic in b
        roots = np.roots([0.04, 0.0, 0.7 + 0.4 * level, -0.1])
        b = roots[np.abs(roots.imag) < 1e-9].real
        expected = np.sort(0.2 * b**2 + 2.0 * level)
        np.testing.assert_allclose(np.sort(row[np.isfinite(row)]), expected, rtol=1e-7, atol=1e-9)
