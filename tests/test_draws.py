"""Beside a coarse sensor the cost has no slope, and parameters are found by draws."""

import numpy as np
import pytest
from small_machines import make_axis, make_oscillator

from narx_sklearn.discrepancy.fitting.problem import Model, Problem
from narx_sklearn.discrepancy.fitting.refit import fit, fit_states
from narx_sklearn.discrepancy.noise import Noise
from narx_sklearn.discrepancy.placed import PlacedEffect, Port
from narx_sklearn.discrepancy.search.draws import MOST_DRAWN, _Draws, nearer_by_draws
from narx_sklearn.discrepancy.simulators.windows import cut
from narx_sklearn.physics.effects import CATALOGUE

NOISE, STEP = 0.001, 0.002


def coarse(q=STEP):
    return PlacedEffect(CATALOGUE["quantisation"], Port("output", 0), theta=(q,))


def recorded(simulator, nominal, effects, *, n=1600, window=400, seed=0):
    """Return a problem of a record by a simulator with effects, and the nominal model of these windows."""
    rng = np.random.default_rng(seed)
    u = np.repeat(rng.uniform(-1, 1, n // 10), 10)[:, None]
    y = simulator.with_effects(effects).simulate(u) + NOISE * rng.normal(size=(n, 1))
    windows = cut([(slice(0, n), 0)], window, 8)
    problem = Problem(nominal, u, y, windows, Noise.white(np.array([NOISE])))
    return problem, Model(nominal.nominal, (), np.zeros((windows.count, 2)))


def as_a_fit_leaves_it(problem, model, effect):
    """Return the fit with an effect that begins where the smooth machine leads."""
    smooth = fit(problem, model)
    return fit(problem, smooth.model._replace(effects=(effect,)))


def test_draws_come_down_to_where_the_truth_is_and_a_fit_does_not():
    true = make_oscillator()
    problem, model = recorded(true, make_oscillator(gain=4.2, stiffness=21.0), [coarse()])
    found = as_a_fit_leaves_it(problem, model, coarse(1.001 * STEP))
    begun = fit_states(problem, model._replace(p=true.nominal)).model.x0
    truth = fit(problem, Model(true.nominal, (coarse(),), begun))
    nearer = nearer_by_draws(problem, found)
    assert found.cost > 1.03 * truth.cost
    assert nearer.cost < 1.005 * truth.cost
    np.testing.assert_allclose(nearer.model.p, true.nominal, rtol=2e-3)
    assert nearer.model.effects[0].theta[0] == pytest.approx(STEP, rel=1e-3)


def test_of_a_fine_sensor_no_draw_makes_a_coarse_one():
    true = make_oscillator()
    problem, model = recorded(true, make_oscillator(gain=4.2), [])
    smooth = fit(problem, model)
    nearer = nearer_by_draws(problem, as_a_fit_leaves_it(problem, model, coarse()))
    assert nearer.cost > smooth.cost


def test_initial_states_follow_what_parameters_do_to_the_run():
    problem, model = recorded(make_axis(), make_axis(gain=1.1), [coarse()], window=800)
    smooth = fit(problem, model)
    frame = _Draws.about(problem, smooth.model._replace(effects=(coarse(),)))
    np.testing.assert_allclose(frame.model_at(np.zeros(frame.size)).p, smooth.model.p, rtol=1e-3)
    values = np.zeros(frame.size)
    values[:2] = 3.0
    drawn = frame.model_at(values)
    rests = [
        problem.residual(problem.run(drawn._replace(effects=(), x0=x0))) for x0 in (drawn.x0, smooth.model.x0)
    ]
    followed, stayed = (float(np.sum(rest**2)) for rest in rests)
    assert followed - smooth.cost < 0.7 * (stayed - smooth.cost)


def test_many_initial_states_are_not_drawn():
    problem, model = recorded(make_axis(), make_axis(), [coarse()], window=100)
    frame = _Draws.about(problem, model._replace(effects=(coarse(),)))
    assert 2 * problem.windows.count + 3 > MOST_DRAWN
    assert frame.size == 3
    assert np.isfinite(frame.model_at(np.ones(3)).x0).all()
