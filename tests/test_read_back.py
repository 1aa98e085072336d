"""States that an output function only converts, subtracts or adds up are as good as measured."""

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from narx_sklearn import DiscrepancyRegressor, ODESimulator
from narx_sklearn.discrepancy.simulators.read_back import _solved

DT = 0.01


def two_bodies(x, u, p):
    return x[1], p[0] * u[0] - x[0], x[3], x[0] - x[2]


def of(output, n_outputs, **more):
    return ODESimulator(
        two_bodies,
        dt=DT,
        parameters={"gain": 2.0},
        states=["a [m]", "va [m/s]", "b [m]", "vb [m/s]"],
        inputs=["u [V]"],
        outputs=[f"y{i}" for i in range(n_outputs)],
        output=output,
        **more,
    )


X = np.array([[0.01, -0.2, 0.03, 5.0], [0.5, 0.1, -0.7, 0.0], [2.0, 3.0, 4.0, -5.0]])
U = np.array([[1.0], [-3.0], [0.2]])


def read(simulator, x=X, u=U, y=None):
    if y is None:
        rates = [np.zeros(4)] * simulator.sees_rates
        y = np.array([simulator.output(a, b, simulator.nominal, *rates) for a, b in zip(x, u, strict=True)])
    return simulator.known_states(u, y, np.arange(len(u)))


@pytest.mark.parametrize(
    ("output", "n_outputs", "told"),
    [
        (lambda x, u, p: (1000.0 * x[0] + 4.0,), 1, [0]),  # another unit, another zero
        (lambda x, u, p: (x[0] - x[2], 1e6 * x[2]), 2, [0, 2]),  # one of them against the other
        (lambda x, u, p: (x[0] - x[2],), 1, []),  # a difference alone tells neither
        (lambda x, u, p: (x[0] - x[2], x[0] + x[2], x[0]), 3, [0, 2]),  # one too many
        (lambda x, u, p: (x[0] + 3.0 * u[0], u[0] * x[2]), 2, [0, 2]),  # beside an input, and times one
        (lambda x, u, p: (x[0] ** 2, np.sin(x[1]), abs(x[2]), -x[3]), 4, [3]),  # those with two answers
        (lambda x, u, p: (p[0] * x[0], x[2]), 2, [2]),  # a scale that is fitted
        (lambda x, u, p, rates: (rates[1], 2.0 * x[0]), 2, [0]),  # an acceleration is of what is missing too
    ],
)
def test_states_are_told_by_outputs_that_are_sums_of_them(output, n_outputs, told):
    known = read(of(output, n_outputs))
    np.testing.assert_allclose(known[:, told], X[:, told], rtol=1e-9, atol=1e-12)
    others = np.setdiff1d(np.arange(4), told)
    assert np.isnan(known[:, others]).all()


def test_a_missing_value_hides_the_states_it_would_tell_and_no_others():
    simulator = of(lambda x, u, p: (x[0] - x[2], x[2], x[3]), 3)
    y = np.array([[1.0, 2.0, 3.0], [np.nan, 2.0, 3.0], [1.0, np.nan, 3.0]])
    expected = [[3.0, np.nan, 2.0, 3.0], [np.nan, np.nan, 2.0, 3.0], [np.nan, np.nan, np.nan, 3.0]]
    np.testing.assert_allclose(read(simulator, y=y), expected)


def test_a_function_that_raises_far_away_tells_nothing():
    def output(x, u, p):
        if x[0] > 1.2:
            raise ValueError("off the table")
        return (x[0],)

    assert np.isnan(read(of(output, 1), y=np.ones((3, 1)))).all()


@given(
    st.lists(st.floats(-3, 3), min_size=16, max_size=16),
    st.lists(st.floats(-6, 6), min_size=4, max_size=4),
)
def test_any_square_set_of_sums_is_solved(values, exponents):
    mixed = np.array(values).reshape(4, 4) + 8.0 * np.eye(4)
    assume(np.linalg.cond(mixed) < 1e3)
    scales = 10.0 ** np.array(exponents)
    told = _solved(np.tile(mixed / scales, (len(X), 1, 1)), X @ mixed.T)
    np.testing.assert_allclose(told / scales, X, rtol=1e-6, atol=1e-6)


# magnetic levitation: a gap, in millimetres, in a denominator ------------------------------------------


def levitated(x, u, p):
    gap, speed, current = x[0], x[1], x[2]
    pushed = 600.0 * (gap - 1e-3 * u[0]) + 22.0 * speed - 3.0 * (current - 1.0)
    return speed, 9.81 - p[0] * (current / gap) ** 2, (pushed + p[1] - p[1] * current) / 0.05


def ball(**more):
    return ODESimulator(
        levitated,
        dt=0.001,
        parameters={"pull [N m^2/A^2/kg]": 9.81 * 25e-6, "resistance [Ohm]": 4.0},
        states=["gap [m]", "speed [m/s]", "current [A]"],
        inputs=["wanted [mm]"],
        outputs=["gap [mm]", "current [A]"],
        output=lambda x, u, p: (1000.0 * x[0], x[2]),
        **more,
    )


def test_a_machine_that_has_no_zero_is_followed_from_where_its_outputs_begin():
    rng = np.random.default_rng(0)
    wanted = 5.0 + np.repeat(rng.uniform(-0.5, 0.5, 40), 50)
    at_rest = [5e-3, 0.0, 1.0]
    y = ball().simulate(wanted, x0=at_rest) + rng.normal(0.0, [0.01, 0.002], (2000, 2))
    off = ball().with_parameters({"pull": 8.5 * 25e-6})
    found = DiscrepancyRegressor(off, effects=["coulomb_friction", "constant_load"]).fit(wanted, y)
    assert found.verdict_ == "refit"
    assert found.simulator_.parameters[0].value == pytest.approx(9.81 * 25e-6, rel=0.02)


def test_runs_begin_at_x0_where_nothing_else_is_given():
    begun = ball(x0={"gap [m]": 5e-3, "current": 1.0})
    assert begun.x0.tolist() == [5e-3, 0.0, 1.0]
    at_rest = begun.simulate(np.full(50, 5.0))
    np.testing.assert_allclose(at_rest, np.tile([5.0, 1.0], (50, 1)), rtol=1e-6)
    other = begun.simulate(np.full(50, 5.0), x0=[5.1e-3, 0.0, 1.0])
    assert other[0, 0] == pytest.approx(5.1)
    np.testing.assert_allclose(begun.steady_state([5.0]), [5e-3, 0.0, 1.0], atol=1e-9)


@pytest.mark.parametrize(
    ("x0", "message"),
    [
        ([1.0, 2.0], "x0 is .* a finite value for each of the states"),
        ({"gap": 1.0, "mass": 2.0}, r"x0 names \['mass'\]; the states are"),
        ([np.nan, 0.0, 0.0], "finite value"),
        ("far", "finite value"),
    ],
)
def test_wrong_starts_are_told(x0, message):
    with pytest.raises(ValueError, match=message):
        ball(x0=x0)
