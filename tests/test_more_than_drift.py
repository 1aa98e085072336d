"""What noise that drifts may be: nothing else is named for it, and an offset that did not stay is a drift."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from small_machines import make_axis

from narx_sklearn.discrepancy import DiscrepancyRegressor, conclusion
from narx_sklearn.discrepancy.fitting.problem import Model, Problem
from narx_sklearn.discrepancy.fitting.refit import fit
from narx_sklearn.discrepancy.noise import Noise
from narx_sklearn.discrepancy.placed import PlacedEffect, Port
from narx_sklearn.discrepancy.search import confirm
from narx_sklearn.discrepancy.search.candidate import Candidate
from narx_sklearn.discrepancy.search.confirm import Trial, more_than_drift
from narx_sklearn.discrepancy.simulators.structure import find_structure
from narx_sklearn.discrepancy.simulators.windows import cut
from narx_sklearn.discrepancy.stages.diagnosis import Diagnosis
from narx_sklearn.discrepancy.stages.refuted import left_that_follows
from narx_sklearn.physics.effects import CATALOGUE
from narx_sklearn.report import render_report

RAMP = PlacedEffect(CATALOGUE["additive_drift"], Port("output", 0), theta=(0.02, 100.0, 0.0, 0.0))
OFFSET = PlacedEffect(CATALOGUE["sensor_bias"], Port("output", 0), theta=(0.01,))
DAMPING = PlacedEffect(CATALOGUE["gain_drift"], Port("state", 1), (0.0, 1.0), theta=(0.01, 10.0, 0.0))
DRAG = PlacedEffect(CATALOGUE["quadratic_drag"], Port("state", 1), (0.0, 1.0), theta=(0.1,))
SETTINGS = SimpleNamespace(alpha=0.005, n_jobs=None, random_state=0, effects=tuple(CATALOGUE.values()))


def stage(x, u, p):
    return x[1], p[0] * u[0] - p[1] * x[1] - 10.0 * x[0]


def make_stage(gain=1.0, damping=0.8):
    """Return a stage on a spring, of which an offset is no initial state."""
    return make_axis(gain, damping, stage)


@pytest.fixture(scope="module")
def axis():
    """Return a problem in which nothing is missing, and its fit."""
    rng = np.random.default_rng(0)
    u = np.repeat(rng.normal(0.0, 3.0, 30), 10)[:, None]
    y = make_axis().simulate(u) + 0.002 * rng.normal(size=(300, 1))
    windows = cut([(slice(0, 300), 0)], 75, 12)
    problem = Problem(make_axis(), u, y, windows, Noise.white(np.array([0.002])))
    return problem, fit(problem, Model(problem.simulator.nominal, (), np.zeros((windows.count, 2))))


def leaving(base, share, *effects):
    """Return a candidate of some effects that leaves a share of the cost."""
    model = base.model._replace(effects=effects)
    jacobian = np.zeros((*base.residual.shape, model.q.size))
    return Candidate(base._replace(cost=share * base.cost, model=model, jacobian=jacobian), 300)


def codes(candidate):
    return [effect.effect.code for effect in candidate.effects]


class TestMoreThanDrift:
    def chosen(self, axis, monkeypatch, pool, chances, settings=SETTINGS):
        """Return what is chosen and the sets that were asked, with what each was held against."""
        problem, base = axis
        asked = []

        def given(trial, some):
            (candidate,) = some
            asked.append((codes(trial.base), codes(candidate)))
            return [chances[tuple(codes(candidate))]]

        monkeypatch.setattr(confirm, "chances", given)
        best = min(pool, key=lambda c: c.criterion)
        return codes(more_than_drift(problem, base, best, pool, None, settings)), asked

    def test_a_name_that_stands_stays(self, axis, monkeypatch):
        pool = [leaving(axis[1], 0.8, DAMPING), leaving(axis[1], 0.85, RAMP)]
        found = self.chosen(axis, monkeypatch, pool, {("gain_drift",): 0.001})
        assert found == (["gain_drift"], [([], ["gain_drift"])])

    def test_one_that_may_be_noise_gives_way_to_the_next(self, axis, monkeypatch):
        pool = [
            leaving(axis[1], share, effect) for share, effect in ((0.8, DAMPING), (0.82, DRAG), (0.85, RAMP))
        ]
        chances = {("gain_drift",): 0.2, ("quadratic_drag",): 0.001}
        found, asked = self.chosen(axis, monkeypatch, pool, chances)
        assert found == ["quadratic_drag"]
        assert len(asked) == 2
        chances["quadratic_drag",] = 0.2
        assert self.chosen(axis, monkeypatch, pool, chances)[0] == ["additive_drift"]

    def test_what_is_beside_a_drift_is_held_against_one_that_began_before(self, axis, monkeypatch):
        pool = [leaving(axis[1], 0.7, DAMPING, RAMP), leaving(axis[1], 0.75, RAMP)]
        named = ("gain_drift", "additive_drift")
        drifting = ["additive_drift", "sensor_bias"]
        found, asked = self.chosen(axis, monkeypatch, pool, {(*named, "sensor_bias"): 0.2})
        assert found[0] == "additive_drift"
        assert "gain_drift" not in found
        assert asked == [(drifting, [*named, "sensor_bias"])]
        chances = {(*named, "sensor_bias"): 0.001, ("gain_drift",): 0.001}
        found, asked = self.chosen(axis, monkeypatch, pool, chances)
        assert found == [*named]
        assert asked[1] == ([], ["gain_drift"])  # where noise that drifts stands for the drift
        chances["gain_drift",] = 0.2
        assert "gain_drift" not in self.chosen(axis, monkeypatch, pool, chances)[0]
        # where offsets are not asked for, against the drift alone
        without = SimpleNamespace(**{**vars(SETTINGS), "effects": (CATALOGUE["additive_drift"],)})
        found = self.chosen(axis, monkeypatch, pool, {named: 0.2}, without)
        assert found == (["additive_drift"], [(["additive_drift"], [*named])])

    def test_a_drift_with_its_beginning_is_asked_no_more(self, axis, monkeypatch):
        pool = [leaving(axis[1], 0.7, OFFSET, RAMP), leaving(axis[1], 0.75, RAMP)]
        assert self.chosen(axis, monkeypatch, pool, {}) == (["sensor_bias", "additive_drift"], [])

    def test_an_offset_must_be_more_too(self, axis, monkeypatch):
        pool = [leaving(axis[1], 0.8, OFFSET), leaving(axis[1], 0.8, RAMP)]
        found = self.chosen(axis, monkeypatch, pool, {("sensor_bias",): 0.02})
        assert found == (["additive_drift"], [([], ["sensor_bias"])])

    @pytest.mark.parametrize("far", [True, False])
    def test_nobody_is_asked_where_no_drift_is_nearly_as_likely(self, far, axis, monkeypatch):
        rest = [leaving(axis[1], 0.7, RAMP)] if far else []
        found = self.chosen(axis, monkeypatch, [leaving(axis[1], 0.5, DRAG), *rest], {})
        assert found == (["quadratic_drag"], [])

    def test_what_a_set_adds_is_what_its_base_lacks_in_any_order(self, axis):
        base, both = leaving(axis[1], 0.8, RAMP), leaving(axis[1], 0.7, DAMPING, RAMP)
        assert Trial(axis[0], base, None).added(both) == (DAMPING,)


class TestOffsetThatDidNotStay:
    def diagnosis(self, axis, best, *rivals, verdict="ambiguous"):
        found = Diagnosis(
            verdict=verdict,
            problem=axis[0],
            structure=None,
            nominal=axis[1],
            refitted=axis[1],
            best=best,
            order=(0,),
            alternatives=(rivals,),
            p_missing=0.0,
            steps=(),
            followed_for=np.inf,
            forgets=True,
            stretches=None,
        )
        return found.as_drift

    def test_is_a_drift(self, axis):
        offset, ramp, drag = (leaving(axis[1], 0.8, effect) for effect in (OFFSET, RAMP, DRAG))
        found = self.diagnosis(axis, offset, ramp)
        assert (found.verdict, found.best, found.alternatives) == ("explained", ramp, ((),))
        found = self.diagnosis(axis, offset, drag, ramp)
        assert (found.verdict, codes(found.best), found.alternatives) == (
            "ambiguous",
            ["additive_drift"],
            ((drag,),),
        )

    def test_what_is_none_has_nothing_to_give(self, axis):
        offset, ramp, drag = (leaving(axis[1], 0.8, effect) for effect in (OFFSET, RAMP, DRAG))
        at_state = leaving(axis[1], 0.8, replace(RAMP, port=Port("state", 1)))
        assert self.diagnosis(axis, ramp, offset) is None
        assert self.diagnosis(axis, drag, ramp) is None
        assert self.diagnosis(axis, offset, at_state) is None
        assert self.diagnosis(axis, leaving(axis[1], 0.8, OFFSET, DRAG), ramp) is None

    @pytest.mark.long
    def test_it_is_told_as_a_drift_where_held_out_samples_refute_it(self, monkeypatch):
        rng = np.random.default_rng(3)
        n = 1200
        u = np.repeat(rng.normal(0.0, 3.0, n // 15), 15)[:, None]
        y = make_stage(1.1, 0.7).simulate(u) + 0.01 * rng.normal(size=(n, 1)) + 0.01
        asked = {"effects": ["sensor_bias", "additive_drift"], "random_state": 0}
        dx = DiscrepancyRegressor(make_stage(), **asked).fit(u, y)
        assert dx.findings_[0].effect == "sensor_bias"
        assert "additive_drift" in dx.findings_[0].lookalikes
        monkeypatch.setattr(conclusion, "_harms", lambda found, held: True)
        dx = DiscrepancyRegressor(make_stage(), **asked).fit(u, y)
        assert dx.verdict_ in ("explained", "ambiguous")
        assert dx.findings_[0].effect == "additive_drift"
        assert "sensor_bias" not in dx.findings_[0].lookalikes


def hardening(x, u, p):
    return x[1], p[0] * u[0] - p[1] * x[1] - 10.0 * x[0] - x[0] ** 3


def wandering(equations, walk, seed=0, n=1500):
    """Return an input, and what a stage with such equations makes of it beside a random walk of a share."""
    rng = np.random.default_rng(seed)
    u = np.repeat(rng.normal(0.0, 3.0, n // 15), 15)[:, None]
    y = make_axis(1.1, 0.7, equations).simulate(u)
    course = np.cumsum(rng.normal(size=n)) / np.sqrt(n / 2)
    return u, y + np.std(y) * (0.02 * rng.normal(size=n) + walk * course)[:, None]


class TestLeftBesideADrift:
    """A course in time excuses itself; what follows a signal is no course, however much larger that is."""

    def left(self, equations):
        settings = SimpleNamespace(alpha_nameless=0.000625, random_state=0)  # of a second look
        u, y = wandering(equations, walk=0.0)
        y += np.linspace(0.0, 3.0 * np.std(y), len(y))[:, None]
        windows = cut([(slice(0, len(u)), 0)], 300, 12)
        problem = Problem(make_stage(), u, y, windows, Noise.white(np.array([0.02 * np.std(y)])))
        start = Model(problem.simulator.nominal, (RAMP,), np.zeros((windows.count, 2)))
        drift = Candidate(fit(problem, start), problem.n_seen)
        run = problem.run(drift.fit.model)
        structure = find_structure(problem.simulator, run.x, u)
        return left_that_follows(problem, drift, structure, settings)

    def test_a_ramp_leaves_nothing_that_follows(self):
        assert self.left(stage) == ()

    def test_a_spring_that_hardens_is_no_ramp(self):
        (sign,) = self.left(hardening)
        assert sign.kind == "follows"
        assert "position" in sign.words or "velocity" in sign.words


@pytest.mark.long
@pytest.mark.parametrize(("equations", "told"), [(stage, "additive_drift"), (hardening, "unknown")])
def test_noise_that_wanders_excuses_no_spring_that_hardens(equations, told):
    u, y = wandering(equations, walk=0.1)
    asked = {"effects": ["additive_drift", "sensor_bias"], "random_state": 0}
    dx = DiscrepancyRegressor(make_stage(), **asked).fit(u, y)
    assert (dx.verdict_ == "unknown") == (told == "unknown")
    assert dx.findings_[0].effect == told


@pytest.mark.long
def test_a_drift_that_turns_takes_nothing_back_of_what_is_beside_it():
    def hardening(x, u, p):
        return x[1], p[0] * u[0] - p[1] * x[1] - 10.0 * x[0] - 2.0 * x[0] ** 3

    rng, n = np.random.default_rng(3), 1500
    u = np.repeat(rng.normal(0.0, 3.0, n // 15), 15)[:, None]
    y = make_axis(1.1, 0.7, hardening).simulate(u) + 0.01 * rng.normal(size=(n, 1))
    t = np.arange(n) / n
    y += 0.3 * np.where(t < 0.8, t, 0.8 - 6.0 * (t - 0.8))[:, None]
    asked = {"effects": ["cubic_stiffness", "additive_drift"], "random_state": 0}
    dx = DiscrepancyRegressor(make_stage(), **asked).fit(u, y)
    assert dx.verdict_ in ("explained", "ambiguous")
    assert {finding.effect for finding in dx.findings_} == {"cubic_stiffness", "additive_drift"}
    assert [effect.effect.code for effect in dx.simulator_.effects] == ["cubic_stiffness"]
    assert dx.scores_["nrmse"]["augmented"] < dx.scores_["nrmse"]["refitted"]
    told = "course of a drift: the corrected simulation leaves it out"
    assert told in dx.report_
    assert told in render_report(dx, u, y)
