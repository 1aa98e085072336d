"""Laws from models: the thesis's published compensators, roots of polynomials, kernels, C code."""

import pickle
import shutil
import subprocess

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st
from scipy.optimize import brentq
from thesis_models import EXAMPLE_4_1, M_I, M_INVERSE, M_R, THETA_I, THETA_R

from narx_sklearn.compensation import (
    BoucWenElement,
    CompensationLaw,
    RootCompensator,
    c_source,
    inverse_law,
    isolated_law,
    law_stability,
    root_law,
    root_polynomials,
    smooth_signs,
)
from narx_sklearn.compensation import _kernels as kernels
from narx_sklearn.compensation import _polynomial_roots as polynomial_roots
from narx_sklearn.compensation.law import LawState
from narx_sklearn.exceptions import NarxWarning
from narx_sklearn.model import (
    AbsoluteDifference,
    AsymmetricSign,
    Difference,
    DifferenceSign,
    FunctionPhi,
    HystereticOperator,
    NARXModel,
    Play,
    Polynomial,
    SmoothSign,
    Variable,
    free_run,
    predict_one_step,
)

PHI = (Difference("u", name="phi1"), DifferenceSign("u", name="phi2"))
VALVE_R = NARXModel.from_equations(
    "0.976*y[k-1] + 0.024*y[k-2] + 0.119*phi1[k-1] + 3.76*phi2[k-1]*phi1[k-1]*u[k-1]"
    " - 4.73*phi2[k-1]*phi1[k-1]*y[k-2]",
    phi=PHI,
)  # (5.16)
VALVE_I = NARXModel.from_equations(
    "y[k-1] - 19.76*phi1[k-2] + 19.32*phi1[k-1] + 9.44*phi2[k-2]*phi1[k-2]*u[k-2]"
    " - 12.61*phi2[k-2]*phi1[k-2]*y[k-1]",
    phi=PHI,
)  # (5.17)
VALVE_INVERSE = NARXModel.from_equations(
    "u[k-1] + 86.67*phi1[k-1] - 85.02*phi1[k-2] - 0.98*phi1[k-1]*y[k-2]"
    " + 1.72*phi2[k-2]*phi1[k-2]*y[k-2] - 1.13*phi2[k-2]*phi1[k-2]*u[k-1]",
    outputs=["u"],
    inputs=["y"],
    phi=[Difference("y", name="phi1"), DifferenceSign("y", name="phi2")],
)  # (5.18)


def assert_same(found: Polynomial, wanted: Polynomial):
    """Equal coefficient by coefficient, but for rounding."""
    assert found.library == wanted.library
    for term, value in wanted.items:
        assert found[term] == pytest.approx(value, rel=1e-12)


def in_signals(law: CompensationLaw) -> Polynomial:
    """Return an explicit law with differences written out, signs kept."""
    equation = law.equations[0]
    differences = {str(e.name): e.signal for e in law.elements if isinstance(e, Difference)}
    written = {}
    for v in equation.variables:
        if v.signal in differences:
            now = Variable(differences[v.signal], v.lag)
            written[v] = Polynomial({now: 1.0, now.shift(1): -1.0})
    return equation.substitute(written)


def test_example_4_2_gives_the_polynomial_4_11():
    theta = (0.9, 1.1, 0.3, -0.2, 0.05)
    names = ("y[k-1]", "u[k-1]", "u[k-1]*u[k-2]", "u[k-1]^2", "u[k-1]^3")
    (c,) = root_polynomials(NARXModel.from_equations(dict(zip(names, theta, strict=True))))
    assert_same(c[3], Polynomial.constant(theta[4]))
    assert_same(c[2], Polynomial.constant(theta[3]))
    assert_same(c[1], Polynomial({"1": theta[1], "m[k-1]": theta[2]}))
    assert_same(c[0], Polynomial({"r[k]": theta[0], "r[k+1]": -1.0}))


def test_example_4_3_gives_4_15_and_4_16():
    t1, t2, t3, t4, t5 = 1.0, 0.02, 0.3, -0.2, 0.7
    model = NARXModel.from_equations(
        {"y[k-1]": t1, "phi2[k-1]": t2, "phi1[k-1]*u[k-1]": t3, "phi2[k-1]*phi1[k-1]*y[k-1]": t4}
        | {"phi1[k-1]": t5},
        phi=PHI,
    )  # fmt: skip
    for s, c in zip((1, -1), root_polynomials(model), strict=True):
        assert_same(c[2], Polynomial.constant(t3))
        assert_same(c[1], Polynomial({"1": t5, "r[k]": s * t4, "m[k-1]": -t3}))
        assert_same(
            c[0],
            Polynomial({"r[k]": t1, "r[k+1]": -1, "1": s * t2, "r[k]*m[k-1]": -s * t4, "m[k-1]": -t5}),
        )


def test_example_4_4_gives_4_27_with_the_lag_of_the_sign_put_right():
    t1, t2, t3, t4, t5 = 1.0, 0.02, 0.3, -0.2, 0.7
    model = NARXModel.from_equations(
        {"y[k-1]": t1, "phi2[k-2]": t2, "phi1[k-2]*u[k-2]": t3, "phi2[k-2]*phi1[k-2]*y[k-1]": t4}
        | {"phi1[k-1]": t5},
        phi=PHI,
    )  # fmt: skip
    m1, m2, sign = (Polynomial.variable(v) for v in ("m[k-1]", "m[k-2]", "phi2[k-1]"))
    r0, r1 = Polynomial.variable("r[k]"), Polynomial.variable("r[k+1]")
    bracket = r1 - t1 * r0 + t5 * m1 - t2 * sign - t3 * (m1 - m2) * m1 - t4 * sign * (m1 - m2) * r0
    assert_same(in_signals(isolated_law(model)), (1 / t5) * bracket)


def test_the_piezo_compensators_are_5_11_to_5_14():
    t1, t2, t3, t4, t5, t6, t7, t8, t9 = THETA_R
    for s, c in zip((1, -1), root_polynomials(M_R), strict=True):
        assert_same(c[3], Polynomial.constant(t5))
        assert_same(c[2], Polynomial({"1": s * (t3 + t8), "m[k-1]": -t5, "r[k]": t6}))
        wanted = {"1": t2 + s * t9, "m[k-1]": -s * (t3 + 2 * t8), "r[k]": s * t4, "r[k]*m[k-1]": -t6}
        assert_same(c[1], Polynomial(wanted))
        wanted = {
            "r[k]": t1 + s * t7,
            "r[k+1]": -1,
            "m[k-1]": -t2,
            "r[k]*m[k-1]": -s * t4,
            "m[k-1]^2": s * t8,
        }
        assert_same(c[0], Polynomial(wanted))
    t1, t2, t3, t4, t5, t6, t7, t8, t9 = THETA_I
    m1, m2, sign = (Polynomial.variable(v) for v in ("m[k-1]", "m[k-2]", "phi2[k-1]"))
    r0, r1, move = Polynomial.variable("r[k]"), Polynomial.variable("r[k+1]"), m1 - m2
    bracket = (
        r1 - t1 * r0 + t8 * m1 - (t3 * m1 + t4 * r0 + t9 * move) * sign * move
        - (t2 + t5 * m1 * m1 + t6 * m1 * r0) * move - t7 * sign * r0
    )  # fmt: skip
    assert_same(in_signals(isolated_law(M_I)), (1 / t8) * bracket)
    t = M_INVERSE.equation()
    law = inverse_law(M_INVERSE, lead=2)
    change, sign = r1 - r0, Polynomial.variable("phi2[k+1]")
    wanted = (
        t["u[k-1]"] * m1 + t["phi1[k-1]"] * change
        + (t["phi2[k-1]*phi1[k-1]*u[k-1]"] * m1 + t["phi2[k-1]*phi1[k-1]*y[k-1]"] * r1) * sign * change
        + (t["phi2[k-1]*y[k-1]*u[k-1]"] * r1 * m1 + t["phi2[k-1]*y[k-1]^2"] * r1 * r1) * sign
        + (t["phi1[k-1]^2*u[k-1]"] * m1 + t["phi1[k-1]^2*y[k-1]"] * r1) * change * change
        + t["phi1[k-1]^3"] * change * change * change
    )  # fmt: skip
    assert_same(in_signals(law), wanted)


def test_the_valve_compensators_are_5_19_to_5_22():
    for s, c in zip((1, -1), root_polynomials(VALVE_R), strict=True):
        assert_same(c[2], Polynomial.constant(s * 3.76))
        assert_same(c[1], Polynomial({"1": 0.119, "m[k-1]": -s * 3.76, "r[k-1]": -s * 4.73}))
        wanted = {"r[k]": 0.976, "r[k-1]": 0.024, "r[k+1]": -1, "r[k-1]*m[k-1]": s * 4.73, "m[k-1]": -0.119}
        assert_same(c[0], Polynomial(wanted))
    m1, m2, sign = (Polynomial.variable(v) for v in ("m[k-1]", "m[k-2]", "phi2[k-1]"))
    r0, r1, rb = (Polynomial.variable(v) for v in ("r[k]", "r[k+1]", "r[k-1]"))
    move = m1 - m2
    bracket = r1 - r0 + 19.32 * m1 + 19.76 * move - 9.44 * sign * move * m1 + 12.61 * sign * move * r0
    assert_same(in_signals(isolated_law(VALVE_I)), (1 / 19.32) * bracket)
    sign = Polynomial.variable("phi2[k]")
    wanted = (
        m1 + 86.67 * (r1 - r0) - 85.02 * (r0 - rb) - 0.98 * (r1 - r0) * r0
        + 1.72 * sign * (r0 - rb) * r0 - 1.13 * sign * (r0 - rb) * m1
    )  # fmt: skip
    assert_same(in_signals(inverse_law(VALVE_INVERSE, lead=2)), wanted)


# -- the roots ----------------------------------------------------------------------------------------------


def first_root(c, start=0.0, end=np.inf, *, find=polynomial_roots.first_root):
    c = np.array(c, dtype=float)
    degree = max(np.flatnonzero(c), default=0)
    chain, work = np.zeros((c.size, c.size)), np.zeros((2, c.size + 2))
    end = polynomial_roots.root_bound(c, degree) if np.isinf(end) else end
    return find(c, degree, start, end, chain, work)


@pytest.mark.parametrize("find", [polynomial_roots.first_root, polynomial_roots.first_root.py_func])
@pytest.mark.parametrize(
    ("c", "wanted"),
    [
        ([-2, 1], 2.0),
        ([2, 1], np.nan),
        ([6, -5, 1], 2.0),
        ([1, -2, 1], 1.0),  # grazes zero
        ([1.01, -2, 1], np.nan),  # just misses
        ([-6, 11, -6, 1], 1.0),
        ([-4, 8, -5, 1], 1.0),  # (x - 1) (x - 2)^2
        ([-2, 5, -4, 1], 1.0),  # (x - 1)^2 (x - 2): the double root comes first
        ([-1, 1, 0, 1e-18], 1.0),  # a leading coefficient that nearly vanishes
        ([-1, 1, 1e-30], 1.0),
        ([24, -50, 35, -10, 1], 1.0),
        ([-120, 274, -225, 85, -15, 1], 1.0),
        ([1, 0, 0, 0, 1], np.nan),
        ([5, 0, 0], np.nan),
    ],
)
def test_the_first_positive_root_is_found(c, wanted, find):
    np.testing.assert_allclose(first_root(c, find=find), wanted, rtol=1e-7, equal_nan=True)


@given(
    st.lists(st.integers(-60, 60), min_size=1, max_size=5, unique=True),
    st.sampled_from([1e-6, 1.0, 1e6]),
    st.floats(0.1, 10.0),
)
@example([1, 2, 3, 4, 5], 1.0, 1.0)
def test_separate_roots_are_found_at_any_scale(roots, scale, gain):
    roots = np.array(roots, dtype=float) * scale / 7.0
    c = gain * np.polynomial.polynomial.polyfromroots(roots)
    ahead = roots[roots > 0]
    wanted = ahead.min() if ahead.size else np.nan
    np.testing.assert_allclose(first_root(c), wanted, rtol=1e-6, equal_nan=True)


def cut_root(c, start, end):
    """The slow form of `first_root`: all intervals between turning points, with numpy's roots."""
    derivative = np.polynomial.polynomial.polyder(c)
    turns = np.roots(derivative[::-1])
    cuts = [
        start,
        *np.sort(turns.real[(abs(turns.imag) < 1e-9) & (turns.real > start) & (turns.real < end)]),
        end,
    ]
    values = np.polynomial.polynomial.polyval(np.array(cuts), c)
    for a, b, before, after in zip(cuts, cuts[1:], values, values[1:], strict=False):
        if before * after < 0.0:
            return brentq(lambda x: np.polynomial.polynomial.polyval(x, c), a, b, xtol=1e-14)
    return np.nan


@pytest.mark.parametrize("start", [0.0, 0.25])
def test_the_short_ways_to_the_first_root_agree_with_the_cuts(start):
    rng = np.random.default_rng(0)
    shortened = 0
    for _ in range(300):
        degree = rng.integers(3, 7)
        c = rng.normal(size=degree + 1) * 10.0 ** rng.uniform(-3, 0, degree + 1)
        end = start + rng.exponential(2.0)
        wanted = cut_root(c, start, end)
        slopes = np.zeros(degree + 1)
        near = polynomial_roots.near_root(c, degree, start, end, slopes)
        if near == near:
            shortened += 1
            np.testing.assert_allclose(near, wanted, rtol=1e-9)
        if polynomial_roots._has_no_zero(c, degree, start, end):
            shortened += 1
            assert np.isnan(wanted)
        np.testing.assert_allclose(first_root(c, start, end), wanted, rtol=1e-9, equal_nan=True)
    assert shortened > 100


@pytest.mark.parametrize("find", [polynomial_roots.near_root, polynomial_roots.near_root.py_func])
def test_newton_that_jumps_over_a_root_proves_nothing(find):
    # (x - 0.1) (x - 1.2) (x - 6): the slope is small at 0.66, and the steps from there end at 6
    c = np.polynomial.polynomial.polyfromroots([0.1, 1.2, 6.0])
    assert find(c, 3, 0.0, 20.0, np.zeros(4)) == pytest.approx(0.1, rel=1e-12)
    assert np.isnan(find(c, 3, 0.66, 20.0, np.zeros(4)))
    assert first_root(c, 0.66, 20.0) == pytest.approx(1.2, rel=1e-12)


@given(st.lists(st.floats(-5, 5), min_size=4, max_size=6), st.floats(0.1, 3.0))
def test_the_best_point_is_no_worse_than_a_fine_grid(c, end):
    c = np.array(c)
    degree = max(np.flatnonzero(c), default=0)
    chain, work = np.zeros((c.size, c.size)), np.zeros((2, c.size + 2))
    if np.isfinite(polynomial_roots.first_root(c, degree, 0.0, end, chain, work)):
        return
    x, size = polynomial_roots.smallest_value(c, degree, 0.0, end, chain, work)
    grid = np.abs(np.polynomial.polynomial.polyval(np.linspace(0, end, 400), c))
    assert 0.0 <= x <= end
    assert size <= grid.min() + 1e-9


# -- the laws at work ---------------------------------------------------------------------------------------


def smooth_reference(n=400, size=1.0, seed=0):
    rng = np.random.default_rng(seed)
    k = np.arange(n)
    return size * sum(rng.uniform(0.2, 1) * np.sin(k * f + rng.uniform(0, 6)) for f in (0.02, 0.033, 0.05))


def flattened(u, y):
    """A user's function that no polynomial equals."""
    return np.tanh(u) / (1.0 + y * y)


MODELS = {
    "linear": NARXModel.from_equations("0.6*y[k-1] + u[k-1] + 0.3*u[k-2]"),
    "cubic": NARXModel.from_equations("0.6*y[k-1] + u[k-1] + 0.2*u[k-1]^3 + 0.1*u[k-1]*u[k-2]"),
    "delay 0": NARXModel.from_equations("0.6*y[k-1] + u[k] + 0.2*u[k]^3"),
    "delay 3": NARXModel.from_equations("0.6*y[k-1] + u[k-3] + 0.2*u[k-3]^3 + 0.1*u[k-4]*y[k-2]"),
    "degree 5": NARXModel.from_equations("0.6*y[k-1] + u[k-1] + 0.05*u[k-1]^5"),
    "origin": NARXModel.from_equations("0.6*y[k-1] + u[k-1] + 0.2*u[k-1]^3", origin={"y": 0.4, "u": -0.2}),
    "two inputs": NARXModel.from_equations("0.6*y[k-1] + u[k-1] + 0.3*w[k-1]*u[k-1]^2", inputs=["u", "w"]),
    "hysteresis": NARXModel.from_equations(
        "y[k-1] + 0.8*phi1[k-1] + 0.2*phi1[k-1]*phi2[k-1]*u[k-1]", phi=PHI
    ),
    "absolute": NARXModel.from_equations(
        "0.6*y[k-1] + u[k-1] + 0.3*phi1[k-1]*u[k-2]", phi=[AbsoluteDifference("u", name="phi1")]
    ),
    "asymmetric": NARXModel.from_equations(
        "0.6*y[k-1] + u[k-1] + phi1[k-1]*phi2[k-1]",
        phi=[Difference("u"), AsymmetricSign("u", rising=(0.5, 0.1), falling=(-0.4, 0.2))],
    ),
    "smooth": NARXModel.from_equations(
        "0.6*y[k-1] + u[k-1] + 0.05*phi1[k-1]", phi=[SmoothSign("u", width=0.02, name="phi1")]
    ),
    "play": NARXModel.from_equations("0.5*u[k-1] + phi1[k-1]", phi=[Play("u", radius=0.3, name="phi1")]),
    "operator": NARXModel.from_equations(
        "0.4*y[k-1] + u[k-1] + 0.3*phi1[k-1]", phi=[HystereticOperator("u", name="phi1")]
    ),
    "function of the past": NARXModel.from_equations(
        "0.5*y[k-1] + u[k-1] + 0.3*f[k-1] + 0.1*f[k-2]*u[k-1]^3",
        phi=[FunctionPhi(flattened, ["u[k-1]", "y[k]"], name="f")],
    ),
    "function of the newest input": NARXModel.from_equations(
        "0.5*y[k-1] + u[k-1] + 0.3*f[k-1] + 0.1*f[k-3]",
        phi=[FunctionPhi(flattened, ["u[k]", "y[k]"], name="f")],
    ),
    "function with a long delay": NARXModel.from_equations(
        "0.5*y[k-1] + u[k-3] + 0.2*f[k-1]", phi=[FunctionPhi(flattened, ["u[k-3]", "y[k]"], name="f")]
    ),
    "function of another input": NARXModel.from_equations(
        "0.5*y[k-1] + u[k-1] + 0.2*f[k]",
        inputs=["u", "w"],
        phi=[FunctionPhi(flattened, ["u[k-2]", "w[k]"], name="f")],
    ),
    "output phi": NARXModel.from_equations(
        "0.6*y[k-1] + u[k-1] + 0.2*phi1[k-1]", phi=[DifferenceSign("y", name="phi1")]
    ),
}
# Functions that have no values, or a pole, within the limits of the input.
OF_ITS_OWN = {
    "root": NARXModel.from_equations("root[k-1]", phi=[FunctionPhi(np.sqrt, ["u[k]"], name="root")]),
    "pole": NARXModel.from_equations(
        "pole[k-1]", phi=[FunctionPhi(lambda u: 1.0 / u, ["u[k]"], name="pole")]
    ),
}
# A machine that can rest anywhere, and is moved by another input too.
BESIDE_A_LOAD = NARXModel.from_equations(
    "y[k-1] + du[k-1] + 0.5*dw[k-2]",
    inputs=["u", "w"],
    phi=[Difference("u", name="du"), Difference("w", name="dw")],
)
# A valve as identified: slope -0.4 - 0.9 sign d + 22 d^2 with d = u - y, negative for small d.
RISES_AND_FALLS = NARXModel.from_equations(
    "y[k-1] - 0.4*phi1[k-1] + 0.9*y[k-1]*phi1[k-1]*phi2[k-1] - 0.9*u[k-1]*phi1[k-1]*phi2[k-1]"
    " + 22*u[k-1]^2*phi1[k-1] - 44*u[k-1]*y[k-1]*phi1[k-1] + 22*y[k-1]^2*phi1[k-1]",
    phi=PHI,
)


def interpreted(u, y):
    """`flattened` in a form that numba cannot compile: it fills masks of arrays."""
    value = np.tanh(u)
    value[y != 0.0] /= (1.0 + y * y)[y != 0.0]
    return value


def signals_for(model, n=400):
    r = smooth_reference(n, 1.0)
    return r if len(model.inputs) == 1 else np.column_stack([r, 0.3 * smooth_reference(n, 1.0, seed=1)])


def limited(law, **kwargs):
    from dataclasses import replace

    return replace(law, **{"limits": (-9.0, 9.0), **kwargs})


@pytest.mark.parametrize("name", MODELS)
def test_the_model_driven_by_its_root_law_follows_the_reference(name):
    model = MODELS[name]
    known = signals_for(model)
    law = limited(root_law(model))
    start = 0.3
    run = law.run(known, m=start)
    reference = known if known.ndim == 1 else known[:, 0]
    first = max(model.max_lag, 1)
    held = np.concatenate([np.full(first, start), run.m])
    target = np.concatenate([np.full(first, reference[0]), reference])
    others = () if known.ndim == 1 else (np.concatenate([np.full(first, known[0, 1]), known[:, 1]]),)
    y = predict_one_step(model, np.column_stack([held, *others]), target)[:, 0]
    assert run.counts.no_solution == 0
    np.testing.assert_allclose(y[first + law.horizon :], target[first + law.horizon :], atol=1e-12)


@pytest.mark.parametrize("name", MODELS)
def test_a_step_at_a_time_gives_the_same_numbers_as_the_whole_reference(name):
    law = limited(root_law(MODELS[name]))
    known = signals_for(MODELS[name], 60).reshape(60, -1)
    whole = law.run(known, m=0.3).m
    state = law.start(0.3, known[0])
    state.settle(known[1 : law.horizon], np.full(max(law.horizon - 1, 0), 0.3))
    steps = [state.step(known[k + law.horizon]) for k in range(60 - law.horizon)]
    np.testing.assert_array_equal(steps, whole[: len(steps)])


@pytest.mark.parametrize("name", ["cubic", "hysteresis", "play"])
def test_compiled_and_interpreted_kernels_agree(name, monkeypatch):
    law = limited(root_law(MODELS[name]), policy="nearest")
    known = signals_for(MODELS[name], 25).reshape(25, -1)
    whole = law.run(known, m=0.3).m
    for module in (kernels, polynomial_roots):
        for key, value in list(vars(module).items()):
            if hasattr(value, "py_func") and value.py_func.__module__.startswith("narx_sklearn.compensation"):
                monkeypatch.setattr(module, key, value.py_func)
    for key in ("first_root", "is_better", "smallest_value"):
        monkeypatch.setattr(kernels, key, getattr(polynomial_roots, key))
    np.testing.assert_allclose(law.run(known, m=0.3).m, whole, rtol=1e-12, atol=1e-14)


def test_the_root_law_agrees_with_a_plain_search_over_numpy_roots():
    # Definition 4.2, slowly: all roots of (5.11) and (5.12), the nearest of those in the right direction
    loading, unloading = root_polynomials(M_R)
    r = 40.0 * np.sin(2 * np.pi * np.arange(300) / 300)
    fast = root_law(M_R).run(r).m
    m = [0.0]
    for k in range(299):
        found = []
        for direction, side in ((1, loading), (-1, unloading)):
            values = {"m[k-1]": m[-1], "r[k]": r[k], "r[k+1]": r[k + 1]}
            roots = np.roots([c(values) for c in side[::-1]])
            real = roots[np.abs(roots.imag) < 1e-9].real
            found += [x for x in real if direction * (x - m[-1]) > 0]
        m.append(min(found, key=lambda x: abs(x - m[-1])) if found else m[-1])
    np.testing.assert_allclose(fast[:299], m[1:], atol=1e-8)


def test_hold_keeps_the_last_input_and_nearest_goes_as_far_as_it_helps():
    law = limited(root_law(NARXModel.from_equations("u[k-1]^2")))
    r = np.array([1.0, 4.0, -1.0, -1.0, 9.0])
    hold = law.run(r, m=1.0)
    np.testing.assert_allclose(hold.m, [2.0, 2.0, 2.0, 3.0, 3.0])
    assert hold.counts.no_solution == 2
    nearest = limited(law, policy="nearest").run(r, m=1.0)
    np.testing.assert_allclose(nearest.m[:3], [2.0, 0.0, 0.0], atol=1e-12)
    assert nearest.counts.no_solution == 2
    saturated = limited(law, policy="nearest", limits=(0.5, 1.5)).run(r, m=1.0).m
    np.testing.assert_allclose(saturated[:3], [1.5, 0.5, 0.5])


def even(u):
    """An even function, which the law of a model searches."""
    return 0.3 * u**4


EVEN = {
    "roots": NARXModel.from_equations("0.5*y[k-1] + 0.3*u[k-1]^4 - 0.2*u[k-1]^2*u[k-2]"),
    "search": NARXModel.from_equations(
        "0.5*y[k-1] + even[k-1]", phi=[FunctionPhi(even, ["u[k]"], name="even")]
    ),
}
TIES = {name: limited(root_law(EVEN[name]), limits=(-1.0, 1.0), policy="nearest") for name in EVEN}


@pytest.mark.parametrize("name", EVEN)
@pytest.mark.parametrize("held", [-0.3, 0.3, -1e-17, 0.0, 1e-17])
@pytest.mark.parametrize("shift", [-1e-15, 0.0, 1e-15])
def test_of_inputs_that_come_as_near_the_one_nearest_to_the_last_is_taken(name, held, shift):
    # 0.3 u^4 - 0.2 u^2 m is even in u: both ends of the limits give the same, far from the reference
    run = TIES[name].run([9.0 + shift, 9.0 + shift], m=held)
    assert run.m[0] == (1.0 if held > -1e-9 else -1.0)  # of two as near the one up
    assert run.counts.no_solution == 2


def test_of_roots_as_near_the_one_up_is_taken_whatever_rounding_says():
    law = limited(root_law(NARXModel.from_equations("u[k-1]^2")))
    for held in (-1e-17, 0.0, 1e-17):
        assert law.run([0.49, 0.49], m=held).m[0] == pytest.approx(0.7, rel=1e-12)
    assert law.run([0.49, 0.49], m=-1e-3).m[0] == pytest.approx(-0.7, rel=1e-12)


def test_the_branch_is_the_side_that_corrects_the_output():
    # u^3 - 3u falls between -1 and 1; it is 1 at 2 cos of 20, 100 and 140 degrees
    law = limited(root_law(NARXModel.from_equations("u[k-1]^3 - 3*u[k-1]")))
    wanted = {"nearest": 5 * np.pi / 9, "rising": np.pi / 9, "falling": 5 * np.pi / 9}
    for branch, angle in wanted.items():
        for sign in (1.0, -1.0):
            run = limited(law, branch=branch).run([0.0, sign, sign], m=0.0)
            assert run.m[0] == pytest.approx(sign * 2.0 * np.cos(angle), abs=1e-9), branch
    square = limited(root_law(NARXModel.from_equations("u[k-1]^2")), branch="rising")
    assert square.run([1.0, 4.0], m=-1.0).m[0] == pytest.approx(2.0)
    assert limited(square, limits=(-3.0, 1.0)).run([1.0, 4.0], m=-1.0).m[0] == pytest.approx(-2.0)


def test_the_branch_keeps_the_input_of_a_model_that_rises_and_falls_from_chattering():
    law = limited(root_law(RISES_AND_FALLS), rate_limit=0.05)
    r = 0.34 * np.sin(2 * np.pi * np.arange(3000) / 1000)

    def turns(branch):
        m = limited(law, branch=branch).run(r, m=0.0).m[1000:]
        steps = np.diff(m)
        return np.count_nonzero(np.diff(np.sign(steps[steps != 0.0])))

    assert turns("nearest") > 100
    assert turns("rising") == 4  # as the reference


def test_limits_and_rate_limits_are_kept_and_counted():
    law = limited(isolated_law(MODELS["linear"]), limits=(-0.2, 0.2), rate_limit=0.01)
    run = law.run(smooth_reference(), m=0.0)
    assert np.abs(run.m).max() <= 0.2
    assert np.abs(np.diff(run.m, prepend=0.0)).max() <= 0.01 + 1e-12
    assert run.counts.at_limit > 0
    assert run.counts.at_rate_limit > 0
    assert run.counts.samples == 400


@pytest.mark.parametrize("law", [root_law(M_R), isolated_law(M_I), inverse_law(M_INVERSE, 2)])
def test_the_input_rests_while_the_reference_rests(law):
    r = 40.0 * np.sin(2 * np.pi * np.arange(1600) / 1000)
    r[1300:] = r[1300]
    m = law.run(r).m
    assert law.keeps_rest
    assert np.ptp(m[1303:]) == 0.0
    drifting = limited(law, limits=(-99.0, 99.0), keeps_rest=False).run(r).m
    assert np.isfinite(drifting).all()


def test_a_law_of_a_model_that_forgets_does_not_claim_to_rest():
    assert not root_law(MODELS["cubic"]).keeps_rest
    assert not root_law(MODELS["play"]).keeps_rest


def test_values_that_are_not_finite_leave_the_last_input():
    state = isolated_law(NARXModel.from_equations("u[k-1] + y[k-1]^2")).start(0.25, 1e200)
    assert state.step(0.0) == 0.25  # the reference squared overflows
    assert state.counts.no_solution == 1
    assert state.step(0.5) == 0.5


def test_a_lost_sample_of_the_reference_is_made_up_for():
    law = root_law(M_R)
    lost, whole = law.start(0.0, 0.0), law.start(0.0, 0.0)
    for r in (1.0, 2.0, np.nan, 4.0):
        m = lost.step(r)
    for r in (1.0, 2.0, 2.0, 4.0):
        wanted = whole.step(r)
    assert m == wanted
    assert (lost.counts.no_solution, whole.counts.no_solution) == (1, 0)


def test_a_copy_of_the_state_goes_its_own_way():
    law = root_law(M_R)
    state = law.start(0.0, 0.0)
    state.step(0.5)
    twin = state.copy()
    assert isinstance(twin, LawState)
    assert twin.step(1.0) == state.step(1.0)
    state.step(2.0)
    assert twin.counts.samples == 2


def test_the_jacobian_of_a_linear_law_is_its_own_recursion():
    # m[k] = (r[k+1] - 0.6 r[k] - 0.3 m[k-1]): errors shrink by 0.3 a sample
    found = law_stability(isolated_law(MODELS["linear"]), smooth_reference())
    assert found.is_stable
    assert found.growth == pytest.approx(0.3, rel=1e-6)
    assert found.share_growing == 0.0


@pytest.mark.parametrize("n_samples", [100, 3999, 4000, 4001])
def test_the_jacobian_is_looked_at_over_all_of_a_reference(n_samples):
    # m[k] = r[k+1] + 0.5 r[k] m[k-1]: errors shrink by 0.1 a sample in the first half, by 0.9 in the other
    law = isolated_law(NARXModel.from_equations("u[k-1] - 0.5*y[k-1]*u[k-2]"))
    found = law_stability(law, np.where(np.arange(n_samples) < n_samples // 2, 0.2, 1.8))
    assert n_samples - found.samples[-1] <= -(-n_samples // 2000)
    assert found.samples.size == found.radius.size <= 2000
    assert found.growth == pytest.approx(0.3, rel=0.02)


@pytest.mark.parametrize("n_samples", [1, 2, 3])
def test_a_reference_shorter_than_a_law_looks_ahead_is_held(n_samples):
    # the Jacobian read past the end of such a reference
    law = isolated_law(NARXModel.from_equations("u[k-5] - 0.5*y[k-1]*u[k-6]"))
    r = np.full(n_samples, 0.6)
    held = law.run(np.full(9, 0.6), m=0.1)
    np.testing.assert_array_equal(law.run(r, m=0.1).m, held.m[:n_samples])
    assert law_stability(law, r, m=0.1).radius.tolist() == pytest.approx([0.3] * n_samples)


def test_the_published_isolated_valve_law_amplifies_and_the_piezo_laws_do_not():
    seconds = np.arange(2000) * 0.01
    valve = law_stability(isolated_law(VALVE_I), 3.08 + 0.34 * np.sin(0.2 * np.pi * seconds), m=3.0)
    assert valve.share_growing > 0.1
    assert valve.radius.max() > 1.5
    assert "grow at" in str(valve)
    r = 40.0 * np.sin(2 * np.pi * np.arange(1000) / 1000)
    for law in (root_law(M_R), isolated_law(M_I), inverse_law(M_INVERSE, 2)):
        assert law_stability(law, r).is_stable


def test_smooth_signs_replace_every_sign_and_nothing_else():
    smooth = smooth_signs(M_R, 0.1)
    assert [type(p) for p in smooth.phi] == [Difference, SmoothSign]
    assert smooth.equation() == M_R.equation()
    assert smooth_signs(M_R, None) is M_R
    assert root_law(smooth).method == "search"


@pytest.mark.parametrize(
    ("model", "derive", "message"),
    [
        (EXAMPLE_4_1, isolated_law, 'structure="isolable"'),
        (NARXModel.from_equations("0.5*y[k-1]"), root_law, "does not depend on the input"),
        (MODELS["function of the newest input"], isolated_law, r"f\[k\]"),
        (
            MODELS["function of the newest input"],
            root_polynomials,
            r"flattened\(m\[k\], r\[k\]\).* no polynomial",
        ),
        (
            NARXModel.from_equations({"y1": "u[k-1]", "y2": "u[k-1]"}, outputs=["y1", "y2"]),
            root_law,
            "one output",
        ),
        (NARXModel.from_equations("0.5*y[k-1]", inputs=[]), root_law, "no input"),
        (MODELS["smooth"], root_polynomials, "no polynomial"),
    ],
)
def test_models_that_allow_no_law_are_refused(model, derive, message):
    with pytest.raises(ValueError, match=message):
        derive(model)


NAMED = {
    "plain": ("s", "a", "b", "c", "f"),
    "as the law's": ("y", "u", "m", "r", "d"),
    "the other way round": ("m", "r", "d", "u", "r_"),
    "with underscores": ("y", "u", "r", "m_", "m"),
}


def named(y, u, v, w, f):
    """The same model in other names: an output, three inputs and a phi regressor."""
    return NARXModel.from_equations(
        f"0.5*{y}[k-1] + {u}[k-1] + 0.2*{u}[k-1]^3 + 0.3*{v}[k-1] + 0.1*{w}[k-2]*{y}[k-1]"
        f" + 0.2*{f}[k-1] + 0.1*{f}[k-2]",
        outputs=[y],
        inputs=[u, v, w],
        phi=[DifferenceSign(u, name=f)],
    )


@pytest.mark.parametrize("names", NAMED.values(), ids=NAMED)
def test_a_law_is_the_same_whatever_the_model_calls_its_signals(names):
    known = np.column_stack([smooth_reference(60), *(0.3 * smooth_reference(60, seed=i) for i in (1, 2))])
    law = root_law(named(*names))
    plain = root_law(named(*NAMED["plain"])).run(known).m
    np.testing.assert_allclose(law.run(known).m, plain, rtol=1e-12)  # sums are in the order of names
    assert len(set(law.channels)) == 5
    text = str(law)
    assert f"m[k] = m[k-1] + {law.move}, the root nearest" in text
    assert f"loading, {law.move} > 0" in text
    assert law.move not in law.channels
    assert "law_step(law_state *s, double known0, double known1, double known2)" in c_source(law, "law")


def test_an_inverse_law_makes_way_for_its_letters():
    text = "0.5*u[k-1] + y[k-1] + 0.2*{0}[k-1]*y[k-2]"
    laws = [
        inverse_law(
            NARXModel.from_equations(
                text.format(f), outputs=["u"], inputs=["y"], phi=[FunctionPhi(np.tanh, ["u[k]"], name=f)]
            ),
            2,
        )
        for f in ("f", "m", "r", "d")
    ]
    found = [law.run(smooth_reference(40)).m for law in laws]
    for m in found[1:]:
        np.testing.assert_allclose(m, found[0], rtol=1e-12)


# -- functions of the user's --------------------------------------------------------------------------------


def test_a_function_waits_for_the_input_only_where_it_reads_the_newest():
    past = root_law(MODELS["function of the past"])
    assert past.method == "roots"
    assert past.elements[0].describe() == "flattened(m[k-1], r[k])"
    assert "0.3*f[k] - r[k+1] + 0.5*r[k] + m[k-1] + 0.1*f[k-1]*m[k-1]^3" in str(past)
    assert root_law(MODELS["function of the newest input"]).method == "search"
    assert (
        root_law(MODELS["function with a long delay"]).elements[0].describe() == "flattened(m[k-1], r[k+2])"
    )


@pytest.mark.parametrize("name", ["function of the past", "function of the newest input"])
def test_a_function_that_does_not_compile_is_called_as_python_and_gives_the_same_numbers(name):
    model = MODELS[name]
    plain = NARXModel.from_equations(
        model.equation(), phi=[FunctionPhi(interpreted, model.phi[0].of, name="f")]
    )
    r = signals_for(model, 60)
    with pytest.warns(NarxWarning, match="interpreted could not be compiled"):
        slow = limited(root_law(plain)).run(r, m=0.3).m
    np.testing.assert_allclose(slow, limited(root_law(model)).run(r, m=0.3).m, rtol=1e-13, atol=1e-15)


def test_a_law_does_not_rest_while_another_input_moves():
    law = root_law(BESIDE_A_LOAD)
    assert law.keeps_rest
    assert str(law).endswith("while r, w rest")
    w = np.repeat([0.0, 1.0, 0.3], [5, 10, 10])
    m = law.run(np.column_stack([np.zeros(25), w])).m
    y = free_run(BESIDE_A_LOAD, np.column_stack([m, w]), np.zeros((3, 1))).y
    np.testing.assert_allclose(y, 0.0, atol=1e-12)
    assert np.ptp(m[-5:]) == 0.0


def test_where_a_function_ends_there_is_no_input_but_one_near_the_end_is_found():
    law = limited(root_law(OF_ITS_OWN["root"]), limits=(-1.0, 4.0))
    run = law.run([0.0, 1.5, -0.5, 1e-3, 1.0, 1.0], m=0.5)
    np.testing.assert_allclose(run.m, [2.25, 2.25, 1e-6, 1.0, 1.0, 1.0], rtol=1e-12)
    assert run.counts.no_solution == 1
    np.testing.assert_allclose(law.run([0.0, 0.3], m=-0.5).m, 0.09, rtol=1e-12)


def test_a_pole_is_no_root():
    law = limited(root_law(OF_ITS_OWN["pole"]), limits=(-2.0, 2.0))
    run = law.run([0.0, -1.0, 0.2, 0.8], m=1.0)
    np.testing.assert_allclose(run.m, [-1.0, -1.0, 1.25, 1.25], rtol=1e-12)
    assert run.counts.no_solution == 1  # 1 / 0.2 lies beyond the limits


def test_a_copy_of_a_state_calls_no_function():
    def of_positive_inputs(u):
        if np.any(u <= 0.0):
            raise KeyError("no table for this input")
        return np.log(u)

    model = NARXModel.from_equations(
        "u[k-1] + f[k-2]", phi=[FunctionPhi(of_positive_inputs, ["u[k]"], name="f")]
    )
    state = limited(root_law(model)).start(1.0, 1.0)
    twin = state.copy()
    assert twin.step(2.0) == state.step(2.0)


def test_an_error_in_a_function_reaches_the_caller():
    def broken(u):
        raise KeyError("no table for this input")

    model = NARXModel.from_equations("u[k-1] + f[k-2]", phi=[FunctionPhi(broken, ["u[k]"], name="f")])
    with pytest.raises(KeyError, match="no table"), pytest.warns(NarxWarning):
        root_law(model).run([0.0, 1.0])


def test_a_difference_as_a_function_gives_the_law_of_the_built_in_one():
    equation = "0.8*y[k-1] + 0.3*y[k-2] + f[k-1] + 0.4*f[k-2]*y[k-1] + 0.2*u[k-1]"
    built_in = NARXModel.from_equations(equation, phi=[Difference("u", name="f")])
    users = NARXModel.from_equations(
        equation, phi=[FunctionPhi(lambda now, before: now - before, ["u[k]", "u[k-1]"], name="f")]
    )
    r = smooth_reference(200, 1.0)
    laws = [limited(root_law(model)) for model in (built_in, users)]
    assert [law.method for law in laws] == ["roots", "search"]
    fast, slow = (law.run(r, m=0.1).m for law in laws)
    np.testing.assert_allclose(slow, fast, atol=1e-12)
    growth = [law_stability(law, r, m=0.1).growth for law in laws]
    assert growth[1] == pytest.approx(growth[0], rel=1e-6)


def test_an_inverse_law_calls_functions_of_both_signals():
    model = NARXModel.from_equations(
        "0.5*u[k-1] + y[k-1] + 0.3*f[k-1]",
        outputs=["u"],
        inputs=["y"],
        phi=[FunctionPhi(flattened, ["y[k]", "u[k]"], name="f")],
    )
    law = inverse_law(model, lead=2)
    assert str(law) == "m[k] = 0.3*f[k] + r[k+1] + 0.5*m[k-1]\n  f[k] = flattened(r[k+1], m[k-1])"
    r = smooth_reference(50, 1.0)
    m, expected = law.run(r).m, [0.0]
    for k in range(49):
        expected.append(0.3 * flattened(r[k + 1], expected[-1]) + r[k + 1] + 0.5 * expected[-1])
    np.testing.assert_allclose(m[:49], expected[1:], atol=1e-14)


def test_a_law_with_a_function_can_be_pickled_after_it_ran():
    law = limited(root_law(MODELS["function of the past"]))
    r = smooth_reference(20, 1.0)
    first = law.run(r).m
    np.testing.assert_array_equal(pickle.loads(pickle.dumps(law)).run(r).m, first)


def test_an_inverse_model_must_read_the_output():
    model = NARXModel.from_equations("u[k-1]", outputs=["u"], inputs=["y"])
    with pytest.raises(ValueError, match=r"Assumption 4\.5"):
        inverse_law(model, 2)


# -- C ------------------------------------------------------------------------------------------------------

USERS = {
    "f": "double law_user_f(double u, double y) { return tanh(u) / (1.0 + y * y); }\n",
    "root": "double law_user_root(double u) { return sqrt(u); }\n",
    "even": "double law_user_even(double u) { return 0.3 * pow(u, 4.0); }\n",
    "pole": "double law_user_pole(double u) { return 1.0 / u; }\n",
}

DRIVER = """
#include <stdio.h>
int main(void)
{
    law_state s;
    double m0, r0, w0 = 0.0, r, w = 0.0;
    if (scanf("%lf %lf", &m0, &r0) != 2) return 1;
    INIT
    while (scanf("%lf", &r) == 1) { READ printf("%.17g\\n", STEP); }
    return 0;
}
"""

C_LAWS = {name: limited(root_law(model)) for name, model in MODELS.items()} | {
    "piezo roots": root_law(M_R),
    "piezo isolated": isolated_law(M_I),
    "piezo inverse": inverse_law(M_INVERSE, 2),
    "nearest": limited(root_law(MODELS["cubic"]), policy="nearest", limits=(-0.4, 0.3), rate_limit=0.02),
    "rising": limited(root_law(RISES_AND_FALLS), branch="rising", rate_limit=0.05),
    "falling": limited(root_law(NARXModel.from_equations("u[k-1]^3 - 3*u[k-1]")), branch="falling"),
    "five powers": limited(root_law(NARXModel.from_equations("u[k-1] + 0.3*u[k-1]^5 - 0.8*u[k-1]^4"))),
    "function that ends": limited(root_law(OF_ITS_OWN["root"])),
    "function with a pole": limited(root_law(OF_ITS_OWN["pole"])),
    "bouc-wen": CompensationLaw(
        "explicit", (Polynomial({"r[k]": 0.6, "h[k-1]": 0.6}),), (BoucWenElement("m", 0.9, 0.8, 0.5, 1.5),)
    ),
}


C_LAWS["rests beside a load"] = limited(root_law(BESIDE_A_LOAD))
C_LAWS |= {f"ties of {name}": law for name, law in TIES.items()}


@pytest.mark.skipif(shutil.which("gcc") is None, reason="no C compiler")
def test_the_c_code_computes_the_same_numbers(tmp_path):
    for number, (name, law) in enumerate(C_LAWS.items()):
        known = np.column_stack([smooth_reference(80, 1.0, seed=2)] * len(law.known))
        known[40] = np.nan
        two = len(law.known) == 2
        fill = {
            "INIT": "w0 = r0; law_reset(&s, m0, r0, w0);"
            if two
            else "(void)w0; (void)w; law_reset(&s, m0, r0);",
            "READ": "w = r;" if two else "",
            "STEP": "law_step(&s, r, w)" if two else "law_step(&s, r)",
        }
        driver = DRIVER
        for key, text in fill.items():
            driver = driver.replace(key, text)
        source, program = tmp_path / f"law{number}.c", tmp_path / f"law{number}"
        written = c_source(law, "law")
        users = [text for user, text in USERS.items() if f"law_user_{user}" in written]
        source.write_text(written + "".join(users) + driver)
        flags = [
            "-std=c99",
            "-O0",
            "-ffp-contract=off",
            "-Wall",
            "-Wextra",
            "-Werror",
            "-Wno-unused-function",
        ]
        built = subprocess.run(
            ["gcc", *flags, str(source), "-o", str(program), "-lm"],
            capture_output=True,
            text=True,
            check=False,
        )
        assert built.returncode == 0, f"{name}: {built.stderr}"
        text = "\n".join(repr(float(x)) for x in (0.1, known[0, 0], *known[:, 0]))
        done = subprocess.run([str(program)], input=text, capture_output=True, text=True, check=True)
        state = law.start(0.1, known[0])
        wanted = [state.step(row) for row in known]
        np.testing.assert_allclose(
            np.array(done.stdout.split(), dtype=float), wanted, rtol=1e-9, atol=1e-11, err_msg=name
        )


def test_names_that_are_not_c_are_refused():
    with pytest.raises(ValueError, match="identifier"):
        c_source(root_law(M_R), "2fast")


def test_the_stability_of_a_compensator_is_asked_of_its_law():
    compensator = RootCompensator(NARXModel.from_equations("0.5*y[k-1] + u[k-1]")).fit()
    with pytest.raises(TypeError, match=r"got RootCompensator\. .* pass compensator\.law_"):
        law_stability(compensator, np.ones(9))
    assert law_stability(compensator.law_, np.ones(9)).is_stable


def test_an_input_that_also_multiplies_an_output_is_not_isolated():
    # to the first power everywhere, and yet what it is multiplied by changes from sample to sample
    model = NARXModel.from_equations("0.8*y[k-1] + u[k-1] + 0.1*y[k-1]*u[k-1]")
    with pytest.raises(ValueError, match=r"cannot be isolated.*may occur only in a linear term"):
        isolated_law(model)
