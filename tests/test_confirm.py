"""Could it all be noise: what is confirmed, drifts, and what is slow or comes late."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import chi2
from small_machines import axis_problem, friction, levels, make_circuit

from narx_sklearn.discrepancy import DiscrepancyRegressor, conclusion
from narx_sklearn.discrepancy.fitting.refit import fit
from narx_sklearn.discrepancy.noise import Noise, estimate_noise
from narx_sklearn.discrepancy.placed import PlacedEffect, Port
from narx_sklearn.discrepancy.search import bank as bank_module
from narx_sklearn.discrepancy.search import confirm
from narx_sklearn.discrepancy.search.bank import make_bank
from narx_sklearn.discrepancy.search.candidate import Candidate
from narx_sklearn.discrepancy.search.confirm import chance_of_noise, clearer_noise, deviance, noises_against
from narx_sklearn.discrepancy.search.detect import NONE_SILENT
from narx_sklearn.discrepancy.search.hypotheses import Hypothesis
from narx_sklearn.physics.effects import CATALOGUE


def gained(problem, without, with_effect):
    return deviance(problem, without.model) - deviance(problem, with_effect.model)


class TestChanceOfNoise:
    def test_friction_stays_when_both_sides_may_call_the_rest_coloured_noise(self):
        problem, start = axis_problem([friction(0.3)])
        without = fit(problem, start)
        named = fit(problem, without.model._replace(effects=(friction(0.1),)))
        assert chance_of_noise(gained(problem, without, named), 100, 1) < 1e-6

    def test_an_effect_that_is_not_there_is_noise(self):
        problem, start = axis_problem(drift=0.0005)
        without = fit(problem, start)
        named = fit(problem, without.model._replace(effects=(friction(0.1),)))
        assert chance_of_noise(gained(problem, without, named), 100, 1) > 0.05

    def test_colour_that_came_from_what_was_missing_gives_way_to_the_noise_that_an_effect_leaves(self):
        problem, start = axis_problem([friction(0.3)])
        without = fit(problem, start)
        coloured = problem.with_noise(estimate_noise(problem.left_over(without.model), problem.seen))
        assert coloured.noise.order > 0
        named = fit(problem, without.model._replace(effects=(friction(0.1),)))
        found = clearer_noise(coloured, fit(coloured, named.model))
        assert found is not None
        assert found.sigma[0] == pytest.approx(0.002, rel=0.05)
        net = np.sum(found.coefficients[0]) - sum(found.average)
        assert abs(net) < 0.1  # an autoregression that its moving average undoes is white
        assert found.sigma[0] < 0.99 * coloured.noise.sigma[0]
        settled = problem.with_noise(found)
        assert clearer_noise(settled, fit(settled, named.model)) is None

    def test_every_shape_and_every_hypothesis_has_its_price(self):
        plain = chance_of_noise(30.0, 1, 1)
        assert chance_of_noise(30.0, 10, 1) == pytest.approx(10 * plain, rel=1e-9)
        assert chance_of_noise(30.0, 1, 400) == pytest.approx(400 * plain, rel=1e-9)
        assert chance_of_noise(0.0, 1, 1) == 1.0
        assert chance_of_noise(30.0, 1, 1, 2) == pytest.approx(np.exp(-15.0), rel=1e-9)

    THREE = (
        PlacedEffect(CATALOGUE["cogging"], Port("state", 1), (1.0, 0.0), theta=(0.1, 1.0, 0.0, 0.0, 0.0)),
        PlacedEffect(CATALOGUE["quadratic_drag"], Port("state", 1), (0.0, 1.0), theta=(0.1,)),
        PlacedEffect(CATALOGUE["cubic_stiffness"], Port("state", 1), (1.0, 0.0), theta=(0.1,)),
    )

    def asked(self, monkeypatch, deviances, alpha=0.01, effects=THREE, adds_up=()):
        """Return the p-value and the codes that stay, of some effects in order of the criterion.

        Deviances are by code, or by code and whether the noise may drift.
        """
        problem, start = axis_problem([friction(0.3)], n=300)
        problem = replace(problem, adds_up=adds_up)
        base = Candidate(fit(problem, start), problem.n_seen)
        found = []
        for rank, effect in enumerate(effects):
            cost = base.fit.cost * np.exp(0.5 * rank - 2.0)
            model = base.fit.model._replace(effects=(effect,))
            jacobian = np.zeros((*base.fit.residual.shape, model.q.size))
            found.append(Candidate(base.fit._replace(cost=cost, model=model, jacobian=jacobian), 300))
        members = [c.effects[0] for c in found]
        hypotheses = [Hypothesis.untuned(e, np.array([e.theta])) for e in members]
        bank = make_bank(problem, base.fit, hypotheses)

        def given(problem, model, may_drift):
            if not model.effects:
                return 0.0
            code = model.effects[-1].effect.code
            return deviances[code] if code in deviances else deviances[code, may_drift]

        monkeypatch.setattr(confirm, "deviance", given)
        monkeypatch.setattr(confirm, "as_if_white", lambda problem, base, candidate, gained, seed: gained)
        found, stays = confirm.confirmed(confirm.Trial(problem, base, bank), found, NONE_SILENT, alpha)
        return found.p_value, [c.effects[0].effect.code for c in stays]

    def test_a_run_without_a_slope_is_no_column_and_no_warning(self, monkeypatch):
        problem, start = axis_problem([friction(0.3)], n=300)
        found = fit(problem, start)
        hypotheses = [Hypothesis.untuned(e, np.array([e.theta])) for e in self.THREE]
        true = bank_module.effect_column

        def endless(problem, fit, base, placed):
            column = true(problem, fit, base, placed)
            return column * 1e200 if placed.effect.code == "cubic_stiffness" else column

        monkeypatch.setattr(bank_module, "effect_column", endless)
        bank = make_bank(problem, found, hypotheses)
        assert bank.useful.tolist() == [True, True, False]
        assert np.isfinite(bank.gram).all()

    def test_where_the_best_may_be_noise_the_next_stands_for_what_is_before_it(self, monkeypatch):
        """A noise coloured by two effects prefers what is neither; under its own, one of them stands."""
        p, stays = self.asked(
            monkeypatch, {"cogging": -5.0, "quadratic_drag": -180.0, "cubic_stiffness": -3.0}
        )
        assert p < 1e-30
        assert stays == ["quadratic_drag"]

    def test_nobody_else_is_asked_where_the_best_stands(self, monkeypatch):
        p, stays = self.asked(monkeypatch, {"cogging": -80.0, "quadratic_drag": -180.0})
        assert 1e-30 < p < 1e-6
        assert stays == ["cogging", "quadratic_drag", "cubic_stiffness"]

    def test_what_may_all_be_noise_keeps_its_order(self, monkeypatch):
        p, stays = self.asked(monkeypatch, {"cogging": -5.0, "quadratic_drag": 0.0, "cubic_stiffness": -3.0})
        assert p > 0.05
        assert stays == ["cogging", "quadratic_drag", "cubic_stiffness"]

    def test_that_an_offset_is_no_drift_of_the_noise_is_asked_of_it_alone(self, monkeypatch):
        offset = PlacedEffect(CATALOGUE["sensor_bias"], Port("output", 0), theta=(0.1,))
        # beside it stand many hypotheses, which what says that anything is slowly off has paid
        asked = [offset, *self.THREE]
        rest = {e.effect.code: 10.0 for e in self.THREE}
        p, _ = self.asked(
            monkeypatch, rest | {("sensor_bias", False): -60.0, ("sensor_bias", True): -12.0}, effects=asked
        )
        assert p == pytest.approx(2 * chi2.sf(12.0, 1), rel=1e-9)
        p, _ = self.asked(
            monkeypatch, rest | {("sensor_bias", False): -12.0, ("sensor_bias", True): -60.0}, effects=asked
        )
        assert p > 1.2 * 2 * chi2.sf(12.0, 1)

    def test_a_drift_that_is_no_better_than_an_offset_is_held_against_drifting_noise_too(self):
        drift = PlacedEffect(CATALOGUE["additive_drift"], Port("output", 0), (), theta=(1.0, 0.0, 0.0, 0.0))
        assert noises_against(drift) == (False,)
        assert noises_against(drift, as_offset=True) == (False, True)
        assert noises_against(friction(0.1), as_offset=True) == (True,)

    @pytest.mark.parametrize("adds_up", [True, False])
    def test_of_what_an_integrator_adds_up_a_drift_is_an_effect_as_any_other(self, adds_up, monkeypatch):
        drift = PlacedEffect(CATALOGUE["additive_drift"], Port("output", 0), theta=(1.0, 0.0, 0.0, 0.0))
        assert noises_against(drift, as_offset=True, adds_up=adds_up) == (
            (True,) if adds_up else (False, True)
        )
        rest = {e.effect.code: 10.0 for e in self.THREE}
        for may_drift in (False, True):
            gained = {("additive_drift", may_drift): -120.0, ("additive_drift", not may_drift): -12.0}
            p, _ = self.asked(monkeypatch, gained | rest, effects=[drift, *self.THREE], adds_up=(adds_up,))
            assert (p < 1e-12) == (may_drift == adds_up)

    @pytest.mark.parametrize(("gained", "stays"), [(9.0, True), (1.0, False)])
    def test_where_only_a_drift_stands_what_is_hardly_noise_stays_beside_it(self, gained, stays, monkeypatch):
        drift = PlacedEffect(CATALOGUE["additive_drift"], Port("output", 0), theta=(1.0, 0.0, 0.0, 0.0))
        drag, spring = self.THREE[1:]
        deviances = {("additive_drift", False): -100.0, "quadratic_drag": -gained, "cubic_stiffness": -1.0}
        p, found = self.asked(monkeypatch, deviances, alpha=1e-3, effects=[drag, drift, spring])
        assert p < 1e-10
        assert found == (["quadratic_drag", "additive_drift"] if stays else ["additive_drift"])


class TestDrift:
    def test_a_random_walk_under_white_noise_is_found_whatever_its_level_at_the_start(self):
        rng = np.random.default_rng(3)
        n, ratio = 4000, 0.02
        walk = np.cumsum(ratio * rng.normal(size=(4, n)), axis=1)
        r = (walk + rng.normal(size=(4, n)) + np.array([[50.0], [-50.0], [0.0], [9.0]]))[:, :, None]
        noise = estimate_noise(r, np.ones(r.shape, dtype=bool))
        assert noise.coefficients[0].tolist() == pytest.approx([1.0], abs=2e-3)
        assert 1 - noise.average[0] == pytest.approx(ratio, abs=0.008)
        assert noise.sigma[0] == pytest.approx(1.0, rel=0.03)

    def test_innovations_hardly_feel_the_level_of_a_window(self):
        noise = Noise((np.array([1.0]),), np.array([2.0]), (0.95,))
        r = np.random.default_rng(0).normal(size=(2, 60, 1))
        felt = noise.innovations(r + np.array([7.0, -3.0])[:, None, None]) - noise.innovations(r)
        np.testing.assert_allclose(felt[:, 1:], 0.0, atol=1e-3)
        assert np.all(np.abs(felt[:, 0]) < 0.1)

    def test_whitening_is_linear(self):
        noise = Noise((np.array([0.99]),), np.array([0.5]), (0.9,))
        rng = np.random.default_rng(1)
        a, b = rng.normal(size=(2, 3, 40, 1))
        together = noise.innovations(2.0 * a - b)
        np.testing.assert_allclose(together, 2.0 * noise.innovations(a) - noise.innovations(b), atol=1e-12)


class TestSlowAndLate:
    LINE = PlacedEffect(
        CATALOGUE["periodic_disturbance"], Port("state", 1), (0.0, 1.0), theta=(1.0, 9.0, 0.5)
    )

    def recording(self, *effects, loud_from=0, n=1500, seed=3):
        u = levels(np.random.default_rng(seed), n)
        u[:loud_from] *= 0.3
        y = make_circuit().with_effects(effects).simulate(u)
        return u, y + 0.02 * np.std(y) * np.random.default_rng(seed + 1).normal(size=y.shape)

    @pytest.mark.long
    def test_a_limit_that_is_met_at_the_end_only_is_found(self):
        limit = PlacedEffect(CATALOGUE["sensor_clip"], Port("output", 0), theta=(-5.0, 5.0))
        u, y = self.recording(limit, loud_from=1230)
        effects = ["sensor_clip", "cubic_stiffness", "lag"]
        found = DiscrepancyRegressor(make_circuit(), effects=effects, random_state=0).fit(u, y)
        assert found.findings_[0].effect == "sensor_clip"
        assert "the beginning was held out instead" in found.report_
        assert found.scores_.loc["augmented", "nrmse"] < 1.05 * found.scores_.loc["refitted", "nrmse"]

    @pytest.mark.long
    def test_a_limit_that_is_met_at_the_end_only_is_found_beside_what_always_acts(self):
        limit = PlacedEffect(CATALOGUE["sensor_clip"], Port("output", 0), theta=(-4.0, 4.0))
        u, y = self.recording(self.LINE, limit, loud_from=1230)
        effects = ["sensor_clip", "periodic_disturbance", "cubic_stiffness"]
        found = DiscrepancyRegressor(make_circuit(), effects=effects, random_state=0).fit(u, y)
        assert {finding.effect for finding in found.findings_} == {"sensor_clip", "periodic_disturbance"}
        assert found.verdict_ == "explained"
        assert "the beginning was held out instead" in found.report_

    @pytest.mark.long
    def test_names_that_leave_much_of_either_end_are_no_explanation(self, monkeypatch):
        """Where a second look ends no better, the first one stands as it was."""
        u, y = self.recording(self.LINE)
        monkeypatch.setattr(conclusion, "_left_over_there", lambda diagnosis, held: 3.0)
        found = DiscrepancyRegressor(make_circuit(), effects=["periodic_disturbance"], random_state=0)
        found.fit(u, y)
        assert found.verdict_ == "unknown"
        assert "the beginning was held out" not in found.report_
        assert found.held_out_["stop"].tolist() == [len(u)]

    def test_an_offset_is_no_drifting_noise(self):
        bias = PlacedEffect(CATALOGUE["sensor_bias"], Port("output", 0), theta=(0.06,))
        u, y = self.recording(bias)
        effects = ["sensor_bias", "cubic_stiffness", "lag"]
        found = DiscrepancyRegressor(make_circuit(), effects=effects, random_state=0).fit(u, y)
        assert found.findings_[0].effect == "sensor_bias"

    @pytest.mark.parametrize(
        ("code", "port", "may_drift"),
        [
            ("cubic_stiffness", "state", (True,)),
            ("additive_drift", "output", (False,)),
            ("sensor_bias", "output", (False, True)),
            ("constant_load", "state", (True,)),
        ],
    )
    def test_a_drift_is_held_against_noise_that_does_not_drift_and_an_offset_against_both(
        self, code, port, may_drift
    ):
        assert noises_against(PlacedEffect(CATALOGUE[code], Port(port, 0))) == may_drift

    @pytest.mark.parametrize("drift", [0.0, pytest.param(0.004, marks=pytest.mark.long)])
    def test_noise_that_drifts_may_be_called_a_drift_and_nothing_else(self, drift):
        n = 1500
        u = levels(np.random.default_rng(5), n)
        rng = np.random.default_rng(6)
        y = make_circuit().simulate(u) + 0.05 * rng.normal(size=(n, 1))
        y += drift * np.cumsum(rng.normal(size=(n, 1)), axis=0)
        effects = ["additive_drift", "sensor_bias", "constant_load", "creep", "cubic_stiffness"]
        found = DiscrepancyRegressor(make_circuit(), effects=effects, random_state=0).fit(u, y)
        assert [f.effect for f in found.findings_] in ([], ["additive_drift"])
        if not drift:
            assert found.verdict_ in ("consistent", "refit")


def test_noise_that_drifts_has_slow_power_and_never_lacks_it():
    rng = np.random.default_rng(0)
    white = rng.normal(size=(4, 801, 1))
    lacking = np.diff(white, axis=1)  # no slow power at all
    noise = estimate_noise(lacking, np.ones(lacking.shape, dtype=bool))
    assert not (noise.average[0] > noise.coefficients[0].max(initial=0.0))
