"""Simulators as engineers write them: methods, objects and tables are compiled, and say the same."""

import math
from dataclasses import dataclass
from functools import partial
from types import SimpleNamespace

import numpy as np
import pytest
from numba import njit
from scipy import interpolate

from narx_sklearn import ODESimulator
from narx_sklearn.discrepancy.simulators.callables import identity
from narx_sklearn.discrepancy.simulators.tables import compiled_table
from narx_sklearn.exceptions import NarxWarning

X = np.linspace(-3.0, 3.0, 9)
Y = np.tanh(X)
WHAT = {
    "dt": 0.02,
    "states": ["x [m]", "v [m/s]"],
    "inputs": ["u [N]"],
    "parameters": {"k [1/s^2]": 4.0, "d [1/s]": 0.5},
}


@dataclass
class Motor:
    gain: float = 2.0
    poles: tuple = (0.5, 1.5)
    offsets: object = None

    @property
    def doubled(self):
        return 2 * self.gain

    def torque(self, u):
        return self.gain * self.limited(u)

    def limited(self, u, most=1.5):
        return min(max(u, -most), most)

    def rhs(self, x, u, p):
        return x[1], self.torque(u[0]) - p[0] * x[0] - p[1] * x[1]


class Called:
    width = 0.7

    def __call__(self, x, u, p):
        return x[1], self.width * u[0] - p[0] * x[0] - p[1] * x[1]


MOTOR, SPACE = Motor(), SimpleNamespace(mass=1.3, inner=SimpleNamespace(gain=0.4))
CONSTANTS = {"mass": 1.3, "drive": {"gain": 0.4, "table": Y}}
KNOTS, LEVELS = [-3.0, 0.0, 3.0], [-1.0, 0.2, 1.0]
SPLINE = interpolate.CubicSpline(X, Y)
LINEAR = interpolate.interp1d(X, Y, bounds_error=False, fill_value=(Y[0], Y[-1]))
MAP = interpolate.RegularGridInterpolator((X, X), np.add.outer(Y, X), bounds_error=False, fill_value=None)
CURVE = np.polynomial.Polynomial([0.1, 0.9, -0.05])


def with_gain(x, u, p, gain, bias=0.0):
    return x[1], gain * u[0] + bias - p[0] * x[0] - p[1] * x[1]


def by_keyword(x, u, p, *, gain=0.6, bias=0.1):
    return with_gain(x, u, p, gain, bias)


def enclosed(table):
    return lambda x, u, p: (x[1], float(table(u[0])) - p[0] * x[0] - p[1] * x[1])


def rhs(force):
    return lambda x, u, p: (x[1], force(x, u) - p[0] * x[0] - p[1] * x[1])


WAYS = {
    "method": MOTOR.rhs,
    "callable object": Called(),
    "partial": partial(with_gain, gain=0.6),
    "partial of two": partial(with_gain, bias=0.3, gain=0.6),
    "by keyword": by_keyword,
    "method called": lambda x, u, p: (x[1], MOTOR.torque(u[0]) - p[0] * x[0]),
    "attribute": lambda x, u, p: (x[1], MOTOR.gain * u[0] - p[0] * x[0]),
    "property and tuple": lambda x, u, p: (x[1], MOTOR.doubled * u[0] - MOTOR.poles[1] * x[0]),
    "class": lambda x, u, p: (x[1], Called.width * u[0] - p[0] * x[0]),
    "space in space": lambda x, u, p: (x[1], SPACE.inner.gain * u[0] / SPACE.mass - p[0] * x[0]),
    "mapping": lambda x, u, p: (x[1], u[0] / CONSTANTS["mass"] - p[0] * x[0]),
    "mapping in mapping": lambda x, u, p: (x[1], CONSTANTS["drive"]["gain"] * u[0] - p[0] * x[0]),
    "array in mapping": lambda x, u, p: (x[1], u[0] * CONSTANTS["drive"]["table"][7] - p[0] * x[0]),
    "list": lambda x, u, p: (x[1], u[0] * KNOTS[2] - p[0] * x[0]),
    "interp of lists": lambda x, u, p: (x[1], np.interp(u[0], KNOTS, LEVELS) - p[0] * x[0]),
    "clip": lambda x, u, p: (x[1], np.clip(u[0], -1, 1.0) - p[0] * x[0]),
    "clip below": lambda x, u, p: (x[1], np.clip(u[0], 0.1, None) - p[0] * np.clip(x[0], None, 1.0)),
    "heaviside": lambda x, u, p: (x[1], np.heaviside(u[0], 0.5) - p[0] * x[0]),
    "polyval": lambda x, u, p: (x[1], np.polyval([0.1, -0.2, 0.3], u[0]) - p[0] * x[0]),
    "spline": lambda x, u, p: (x[1], SPLINE(u[0]) - p[0] * x[0]),
    "spline enclosed": enclosed(SPLINE),
    "line enclosed": enclosed(LINEAR),
    "map": lambda x, u, p: (x[1], float(MAP((u[0], x[0]))) - p[0] * x[0]),
    "curve": lambda x, u, p: (x[1], CURVE(u[0]) - p[0] * x[0]),
    "poly1d": enclosed(np.poly1d([0.1, -0.2, 0.3])),
}


def runs(function, n=60):
    u = np.random.default_rng(3).uniform(-4.0, 4.0, size=n)
    simulator = ODESimulator(function, **WHAT)
    assert simulator.compiled
    return simulator.simulate(u), by_hand(function, u)


def by_hand(function, u):
    """Return the classical Runge-Kutta run of a function as it stands."""
    p, h = np.array([4.0, 0.5]), WHAT["dt"]

    def f(x, v):
        return np.array([float(one) for one in function(x, np.array([v]), p)])

    x, found = np.zeros(2), []
    for v in u:
        found.append(x)
        k1 = f(x, v)
        k2 = f(x + h / 2 * k1, v)
        k3 = f(x + h / 2 * k2, v)
        x = x + h / 6 * (k1 + 2 * k2 + 2 * k3 + f(x + h * k3, v))
    return np.array(found)


@pytest.mark.parametrize("way", WAYS)
def test_it_is_compiled_and_runs_as_it_stands(way):
    found, wanted = runs(WAYS[way])
    np.testing.assert_allclose(found, wanted[:, : found.shape[1]], rtol=1e-9, atol=1e-12)


def test_an_attribute_that_has_changed_is_read_anew():
    motor = Motor()
    u = np.ones(40)
    simulator = ODESimulator(motor.rhs, **WHAT)
    before = simulator.simulate(u)
    motor.gain = 4.0
    after = simulator.simulate(u)
    np.testing.assert_allclose(after, 2.0 * before, rtol=1e-12)
    assert identity(motor.rhs) == identity(Motor(gain=4.0).rhs) != identity(Motor().rhs)


def test_an_item_that_has_changed_is_read_anew():
    held = {"gain": 1.0}
    simulator = ODESimulator(lambda x, u, p: (x[1], held["gain"] * u[0] - p[0] * x[0]), **WHAT)
    before = simulator.simulate(np.ones(40))
    held["gain"] = 2.0
    np.testing.assert_allclose(simulator.simulate(np.ones(40)), 2.0 * before, rtol=1e-12)


class Counter:
    def __init__(self):
        self.calls = 0

    def rhs(self, x, u, p):
        self.calls += 1
        return x[1], u[0] - p[0] * x[0]


class Looping:
    def rhs(self, x, u, p):
        return self.again(x, u, p)

    def again(self, x, u, p):
        return (x[1], u[0] - p[0] * x[0]) if x[0] > -9 else self.rhs(x, u, p)


def squares(x, u, p):
    return x[1], u[0] + float(interpolate.interp1d(X, Y, kind="nearest")(0.1)) - p[0] * x[0]


@pytest.mark.parametrize(
    "function", [Counter().rhs, Looping().rhs, squares], ids=["writes", "loops", "makes"]
)
def test_what_does_more_than_read_runs_as_python(function):
    simulator = ODESimulator(function, **WHAT)
    with pytest.warns(NarxWarning, match="could not be compiled"):
        assert not simulator.compiled
    u = np.ones(20)
    np.testing.assert_allclose(simulator.simulate(u)[:, 0], by_hand(function, u)[:, 0], rtol=1e-9)


ONE_SIGNAL = {
    "cubic": SPLINE,
    "cubic without beyond": interpolate.CubicSpline(X, Y, extrapolate=False),
    "pchip": interpolate.PchipInterpolator(X, Y),
    "akima": interpolate.Akima1DInterpolator(X, Y),
    "lines": interpolate.interp1d(X, Y),
    "lines beyond": interpolate.interp1d(X, Y, fill_value="extrapolate"),
    "lines held": LINEAR,
    "quadratic": interpolate.interp1d(X, Y, kind="quadratic", bounds_error=False),
    "b-spline": interpolate.make_interp_spline(X, Y, k=2),
    "smoothing": interpolate.UnivariateSpline(X, Y, s=0.01, ext=3),
    "interpolating": interpolate.InterpolatedUnivariateSpline(X, Y, ext=1),
    "polynomial": np.polynomial.Chebyshev([1.0, 2.0, 3.0], domain=[0.0, 2.0]),
    "old polynomial": np.poly1d([1.0, 2.0, 3.0]),
}


@pytest.mark.parametrize("table", ONE_SIGNAL.values(), ids=ONE_SIGNAL)
def test_a_table_says_the_same_within_and_beyond(table):
    function = compiled_table(table)
    for x in (*np.random.default_rng(0).uniform(-3, 3, 50), *X, -3.5, 4.2, 20.0):
        try:
            wanted = float(table(x))
        except ValueError:
            with pytest.raises(ValueError, match="range of a table"):
                function(x)
            continue
        assert function(x) == pytest.approx(wanted, rel=1e-9, abs=1e-12, nan_ok=True)
    assert math.isnan(function(np.nan))


@pytest.mark.parametrize("beyond", [{}, {"bounds_error": False}, {"bounds_error": False, "fill_value": None}])
def test_a_map_says_the_same_within_and_beyond(beyond):
    rng = np.random.default_rng(1)
    axes = X, np.array([0.0, 1.0, 5.0]), np.array([-1.0, 0.5])
    table = interpolate.RegularGridInterpolator(axes, rng.normal(size=(9, 3, 2)), **beyond)
    function = compiled_table(table)
    inside = rng.uniform([-3, 0, -1], [3, 5, 0.5], size=(40, 3))
    for point in map(tuple, (*inside, (3.0, 5.0, 0.5), (-3.0, 0.0, -1.0))):
        assert function(point) == pytest.approx(np.ravel(table(point))[0], abs=1e-12)
    outside = (0.0, 6.0, 0.0)
    if not beyond:
        with pytest.raises(ValueError, match="range of a table"):
            function(outside)
    else:
        assert function(outside) == pytest.approx(np.ravel(table(outside))[0], nan_ok=True)


@pytest.mark.parametrize(
    "value",
    [
        interpolate.interp1d(X, Y, kind="nearest"),
        interpolate.CubicSpline(X, np.column_stack([Y, X])),
        interpolate.CubicSpline(X, np.append(Y[:-1], Y[0]), bc_type="periodic"),
        interpolate.RegularGridInterpolator((X, X), np.add.outer(Y, Y), method="cubic"),
        njit(lambda x: x),
        3.0,
        None,
    ],
    ids=["nearest", "two values", "periodic", "cubic map", "compiled", "number", "none"],
)
def test_what_is_no_such_table_is_left_as_it_is(value):
    assert compiled_table(value) is None
