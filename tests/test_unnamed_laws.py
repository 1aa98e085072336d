"""Laws without a name: polynomials of position, rate and input keep the terms that pay for themselves."""

import numpy as np
import pytest
from small_machines import diagnosed_oscillator, levels, make_oscillator

from narx_sklearn.discrepancy.findings import parameter_names, parameters_it_has
from narx_sklearn.discrepancy.fitting.problem import Model, Problem
from narx_sklearn.discrepancy.fitting.refit import fit
from narx_sklearn.discrepancy.noise import Noise
from narx_sklearn.discrepancy.search.candidate import Candidate
from narx_sklearn.discrepancy.search.unnamed.broken_line import KNOTS, with_knots
from narx_sklearn.discrepancy.search.unnamed.curves import curve_hypotheses
from narx_sklearn.discrepancy.search.unnamed.kinds import CURVE, DRIVEN, SURFACE
from narx_sklearn.discrepancy.search.unnamed.polynomials import MONOMIALS, TERMS, without_terms
from narx_sklearn.discrepancy.simulators.structure import find_structure
from narx_sklearn.discrepancy.simulators.windows import cut
from narx_sklearn.discrepancy.stages.unnamed import held_where_seen, simplified


def van_der_pol(x, u, p):
    return x[1], p[0] * u[0] - p[1] * x[1] - p[2] * x[0] - 5.0 * x[0] ** 2 * x[1]


def driven_less(x, u, p):
    return x[1], p[0] * u[0] * (1.0 - 0.3 * x[0]) - p[1] * x[1] - p[2] * x[0]


def polynomials(machine):
    """Return a problem, and what the polynomials in position, rate and input come to on it."""
    rng = np.random.default_rng(0)
    u = levels(rng, 1200)
    y = make_oscillator(machine).simulate(u)
    y = y + 0.002 * rng.normal(size=y.shape)
    simulator = make_oscillator()
    problem = Problem(simulator, u, y, cut([(slice(0, 1200), 0)], 300, 12), Noise.white(np.array([0.002])))
    base = fit(problem, Model(simulator.nominal, (), np.zeros((4, 2))))
    run = problem.run(base.model)
    found = {}
    for hypothesis in curve_hypotheses(simulator, find_structure(simulator, run.x, u), u, run.x, run.y):
        placed = hypothesis.placed
        if placed.effect.code in TERMS:
            law = fit(problem, base.model._replace(effects=(placed,)))
            found[placed.effect.code] = Candidate(law, problem.n_seen)
    return problem, found


@pytest.mark.parametrize(
    ("machine", "code", "left"),
    [
        (van_der_pol, SURFACE, "x2v x^2 v"),
        (van_der_pol, DRIVEN, "x2v x^2 v"),
        (driven_less, DRIVEN, "ux u x"),
    ],
)
def test_the_term_that_is_there_stays_alone(machine, code, left):
    problem, found = polynomials(machine)
    law = simplified(problem, found[code])
    (placed,) = law.effects
    assert placed.effect.equation.startswith(f"{left}, x")
    coefficients = np.array(placed.theta)[: len(TERMS[placed.effect.code])]
    assert np.count_nonzero(coefficients) == 1
    assert law.n_values == found[code].fit.model.p.size + 1
    assert law.fit.cost < found[code].fit.cost + 11 * np.log(problem.n_seen)
    assert law.fit.cost == pytest.approx(problem.n_seen, rel=0.1)


def test_where_no_term_with_the_input_is_left_it_is_a_law_of_position_and_rate():
    problem, found = polynomials(van_der_pol)
    (driven,) = found[DRIVEN].effects
    law = without_terms(driven, range(len(MONOMIALS), len(TERMS[DRIVEN])))
    assert (law.effect.code, law.second, law.port) == (SURFACE, (), driven.port)
    fixed = driven.theta[len(TERMS[DRIVEN]) :]
    without = driven.at([*driven.theta[: len(MONOMIALS)], 0.0, 0.0, 0.0, 0.0, *fixed])
    runs = [problem.run(found[DRIVEN].fit.model._replace(effects=(placed,))).y for placed in (law, without)]
    np.testing.assert_allclose(*runs, rtol=1e-9, atol=1e-12)


@pytest.mark.parametrize("code", [SURFACE, DRIVEN])
def test_beyond_the_motion_over_which_it_was_fitted_a_polynomial_stays_as_it_is(code):
    problem, found = polynomials(van_der_pol)
    law = found[code]
    held = held_where_seen(problem, law)
    before, after = (problem.run(c.fit.model) for c in (law, held))
    np.testing.assert_allclose(after.y, before.y, atol=1e-4 * np.ptp(before.y))
    (placed,) = held.effects
    low, high = before.x[:, 0].min(), before.x[:, 0].max()

    def force(x, v):
        theta, rest = np.array(placed.theta), np.zeros(1)
        return placed.effect.force(x, v, 0.0, 1.0, 0.0, 0.02, rest, theta, rest)

    np.testing.assert_allclose(
        [force(10 * low, 0.1), force(10 * high, 0.1)], [force(low, 0.1), force(high, 0.1)]
    )
    assert force(high, 0.1) != force(0.9 * high, 0.1)
    assert force(0.1, 1e6) == force(0.1, 1e9)
    assert np.all(np.ptp(placed.bounds[-4:], axis=1) == 0)  # no fit moves the ends


def test_a_law_that_was_simplified_is_held_too():
    problem, found = polynomials(van_der_pol)
    held = held_where_seen(problem, simplified(problem, found[DRIVEN]))
    (placed,) = held.effects
    assert placed.theta[-4] > -1e3
    assert held.fit.cost == pytest.approx(problem.n_seen, rel=0.1)


def test_what_is_no_polynomial_is_left_as_it_is():
    problem, found = polynomials(van_der_pol)
    nothing = Candidate(found[SURFACE].fit._replace(model=found[SURFACE].fit.model._replace(effects=())), 1)
    assert simplified(problem, nothing) is nothing
    assert held_where_seen(problem, nothing) is nothing


@pytest.mark.long
def test_a_diagnosis_tells_the_law_and_keeps_the_parameters_right():
    named = ["quadratic_drag", "cubic_stiffness", "coulomb_friction"]
    dx = diagnosed_oscillator(van_der_pol, named, noise=0.01, seed=1)
    assert dx.verdict_ == "unknown"
    (finding,) = dx.findings_
    assert "x2v x^2 v" in finding.equation
    assert len(finding.parameters) <= 4  # of seven coefficients and two sizes
    assert "It was seen for position from -" in finding.sentence
    strength, x, v = (finding.parameters[name] for name in ("x2v", "size of x", "size of v"))
    assert strength / (x * x * v) == pytest.approx(-5.0, rel=0.2)
    np.testing.assert_allclose(dx.parameters_["augmented"], [4.0, 1.0, 20.0], rtol=0.1)
    assert "depends on position and rate as none of the known" in dx.report_


def test_a_polynomial_has_the_terms_that_are_left_and_a_line_its_knot_at_zero_too():
    """The knot is there by the law; the terms were held at zero on a record."""
    simulator, u = make_oscillator(), levels(np.random.default_rng(0), 600)
    x = np.column_stack([np.sin(np.arange(600) / 9.0), np.cos(np.arange(600) / 9.0)])
    found = curve_hypotheses(simulator, find_structure(simulator, x, u), u, x, x[:, :1])
    surface = next(h.placed for h in found if h.placed.effect.code == SURFACE)
    alone = without_terms(surface, range(1, len(MONOMIALS)))
    told = [
        name
        for name, is_told in zip(parameter_names(alone), parameters_it_has(alone), strict=True)
        if is_told
    ]
    assert told == ["x2", "size of x", "size of v"]
    line = next(h.placed for h in found if h.placed.effect.code == CURVE)
    about_zero = with_knots(line, np.linspace(-1.0, 1.0, KNOTS))
    assert 0.0 in about_zero.theta[KNOTS:]
    assert parameters_it_has(about_zero).all()
