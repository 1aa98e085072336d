"""Random NARX systems: known exactly, bounded for every input in the unit box, forgetful of their start."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from narx_sklearn import NARXRegressor
from narx_sklearn.datasets import make_narx
from narx_sklearn.model import NARXModel, free_run, predict_one_step


def model_of(plant):
    return NARXModel.from_equations(plant.truth.equation, inputs=list(plant.X.columns))


@settings(max_examples=40, deadline=None)
@given(st.integers(2, 9), st.integers(1, 3), st.integers(1, 3), st.integers(1, 2), st.integers(0, 10**6))
def test_no_input_in_the_unit_box_leaves_it(n_terms, n_y, n_u, delay, seed):
    u = np.random.default_rng(seed).choice([-1.0, 1.0], (300, 2))
    options = {"n_inputs": 2, "n_terms": n_terms + 1, "output_lags": n_y, "input_lags": n_u + 1, "degree": 3}
    plant = make_narx(u=u, delay=delay, memory=0.95, random_state=seed, **options)
    assert np.abs(plant.y).max() <= 1.0
    assert len(plant.truth.parameters) == n_terms + 1
    model = model_of(plant)
    assert min(v.lag for v in model.library.variables if v.signal != "y") >= delay


@pytest.mark.parametrize("seed", range(3))
def test_initial_conditions_are_forgotten_at_the_rate_of_the_memory(seed):
    plant = make_narx(200, output_lags=2, degree=3, n_terms=8, memory=0.7, random_state=seed)
    low, high = (free_run(model_of(plant), plant.X, [start, start]).y[:, 0] for start in (-1.0, 1.0))
    bound = 2.0 * 0.7 ** (np.arange(200) // 2)
    assert (np.abs(high - low) <= bound + 1e-12).all()


@pytest.mark.parametrize("seed", range(5))
def test_the_system_is_identified_exactly_from_its_own_record(seed):
    plant = make_narx(600, n_terms=7, degree=3, random_state=seed)
    found = NARXRegressor(2, 2, degree=3, refine=False, origin="zero").fit(plant.X, plant.y)
    assert set(found.terms_) == set(plant.truth.parameters)
    expected = [plant.truth.parameters[term] for term in found.terms_]
    np.testing.assert_allclose(found.coef_, expected, rtol=1e-9)


def test_noise_has_the_size_and_the_colour_asked_for():
    plant = make_narx(20_000, noise=0.2, noise_kind="output", noise_pole=0.8, random_state=0)
    e = (plant.y - plant.truth.y).to_numpy()
    np.testing.assert_allclose(e, plant.truth.states["e"])
    # the deviation of a coloured noise is known to about 2 %
    assert e.std() / plant.truth.y.std() == pytest.approx(0.2, rel=0.06)
    assert np.corrcoef(e[1:], e[:-1])[0, 1] == pytest.approx(0.8, abs=0.02)


def test_equation_noise_is_what_the_equation_leaves():
    plant = make_narx(500, noise=0.1, random_state=3)
    left = plant.y.to_numpy() - predict_one_step(model_of(plant), plant.X, plant.y)[:, 0]
    np.testing.assert_allclose(left[2:], plant.truth.states["e"][2:], atol=1e-12)


def test_a_seed_is_a_system_and_the_current_input_may_act():
    first, again = (make_narx(50, delay=0, n_terms=5, random_state=7) for _ in range(2))
    assert first.truth.equation == again.truth.equation
    np.testing.assert_array_equal(first.y, again.y)
    equations = [make_narx(10, delay=0, n_terms=8, random_state=seed).truth.equation for seed in range(5)]
    assert any("u[k]" in equation for equation in equations)
    assert len(set(equations)) == 5


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"n_terms": 1}, "n_terms is 1, but must be an integer from 2"),
        ({"n_terms": 99}, "to 14, the number of candidates"),
        ({"memory": 1.0}, "never forgotten"),
        ({"noise_pole": -1.0}, "never forgotten"),
        ({"noise": -0.1}, "noise is -0.1"),
        ({"noise_kind": "pink"}, "choose one of 'equation', 'output'"),
        ({"output_lags": 0}, "output_lags is 0, but must be an integer of at least 1"),
        ({"input_lags": 1, "delay": 2}, "input_lags is 1, but must be an integer of at least 2"),
        ({"u": np.zeros((9, 2))}, r"u has shape \(9, 2\)"),
        ({"noise": 1e3, "memory": 0.99, "degree": 3, "n_terms": 30}, "out of the finite range"),
    ],
)
def test_wrong_arguments_are_named(options, message):
    with pytest.raises(ValueError, match=message):
        make_narx(**{"n_samples": 300, "random_state": 0} | options)
