"""Explanations that an experiment is asked to separate: any effects, whether they were looked for or not."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from small_machines import axis_problem, friction

from narx_sklearn.discrepancy.fitting.refit import fit
from narx_sklearn.discrepancy.nested import ALLOWED
from narx_sklearn.discrepancy.rivals import as_simulators, find_rivals, nested_pairs
from narx_sklearn.discrepancy.search.candidate import Candidate
from narx_sklearn.discrepancy.simulators.structure import find_structure
from narx_sklearn.physics.effects import CATALOGUE

pytestmark = pytest.mark.filterwarnings("ignore:.*compile")


def diagnosed(effects=(), found=()):
    """Return a diagnosis of an axis with some effects, of which some were found."""
    problem, model = axis_problem(effects)
    refitted = fit(problem, model)
    run = problem.run(refitted.model)
    best = fit(problem, refitted.model._replace(effects=tuple(found))) if found else refitted
    return SimpleNamespace(
        problem=problem,
        structure=find_structure(problem.simulator, run.x, problem.u),
        refitted=refitted,
        best=Candidate(best, problem.n_seen),
        alternatives=(),
        steps=(),
    )


@pytest.fixture(scope="module")
def nothing_missing():
    return diagnosed()


def test_what_nobody_looked_for_is_fitted_where_it_acts():
    diagnosis = diagnosed([friction(0.3)])
    rivals = find_rivals(diagnosis, ["coulomb_friction", "quadratic_drag"])
    assert list(rivals) == ["coulomb_friction at state:1", "quadratic_drag at state:1"]
    (rubs,) = rivals["coulomb_friction at state:1"].effects
    assert rubs.theta[0] == pytest.approx(0.3, rel=0.02)


@pytest.mark.parametrize("codes", [("coulomb_friction", "quadratic_drag"), ("backlash", "delay")])
def test_what_is_not_there_is_as_large_as_the_data_allow(nothing_missing, codes):
    """Also a play, which at no width has no tangent."""
    without = nothing_missing.refitted.cost
    rivals = find_rivals(nothing_missing, codes)
    assert [name.split()[0] for name in rivals] == list(codes)
    for rival in rivals.values():
        assert without + 0.5 * ALLOWED**2 < rival.fit.cost <= without + ALLOWED**2
    simulators = as_simulators(rivals, nested_pairs(rivals), nothing_missing.problem)
    assert all(len(simulator.effects) == 1 for simulator in simulators.values())


def test_effects_are_compared_beside_what_else_was_found():
    diagnosis = diagnosed([friction(0.3)], [friction(0.2)])
    rivals = find_rivals(diagnosis, ["dead_zone", "quadratic_drag"])
    for rival in rivals.values():
        assert diagnosis.best.places < rival.places


def test_of_a_pair_that_was_found_each_is_fitted_without_the_other():
    drag = replace(friction(0.1), effect=CATALOGUE["quadratic_drag"])
    diagnosis = diagnosed([friction(0.3)], [friction(0.2), drag])
    rivals = find_rivals(diagnosis, ["coulomb_friction", "quadratic_drag"])
    assert list(rivals) == ["coulomb_friction at state:1", "quadratic_drag at state:1"]


def test_nothing_is_a_special_case_of_everything(nothing_missing):
    rivals = {"nothing": nothing_missing.best, **find_rivals(nothing_missing, ["backlash", "delay"])}
    names = list(rivals)[1:]
    assert nested_pairs(rivals) == {(name, "nothing") for name in names}


def test_effects_of_ones_own_are_known_and_effects_themselves_are_taken(nothing_missing):
    mine = replace(CATALOGUE["coulomb_friction"], code="rubber")
    by_code = find_rivals(nothing_missing, ["rubber", "quadratic_drag"], own=[mine])
    assert next(iter(by_code)) == "rubber at state:1"
    assert list(find_rivals(nothing_missing, [mine, CATALOGUE["quadratic_drag"]])) == list(by_code)


@pytest.mark.parametrize(
    ("between", "error", "words"),
    [
        ("delay", TypeError, "between is 'delay'; wanted is a list of the codes of at least two"),
        (3, TypeError, "between is 3; wanted is a list"),
        (["delay"], ValueError, r"between names \['delay'\]; wanted are .* two effects"),
        (["delay", "delay"], ValueError, r"between names \['delay'\]"),
        (["delay", "rubber"], ValueError, r"between holds 'rubber', .* known: \['additive_drift'"),
        (["delay", "viscous_damping"], ValueError, "'viscous_damping', which does not show in these data"),
        (["delay", "sensor_bias"], ValueError, "'sensor_bias', which does not show in these data"),
        (None, ValueError, r"only one explanation.* pass between=\[...\]"),
    ],
)
def test_what_cannot_be_separated_is_said(nothing_missing, between, error, words):
    """Damping is a parameter of the axis, and where an integrator begins nobody knows."""
    with pytest.raises(error, match=words):
        find_rivals(nothing_missing, between)


def test_every_effect_asked_for_takes_part(nothing_missing):
    codes = ["coulomb_friction", "quadratic_drag", "delay", "dead_zone", "constant_load"]
    assert [name.split()[0] for name in find_rivals(nothing_missing, codes)] == codes
    assert np.isfinite([r.fit.cost for r in find_rivals(nothing_missing, codes).values()]).all()
