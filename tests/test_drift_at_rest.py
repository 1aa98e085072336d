"""A model that tells directions apart and leaves the place where its input stops is told of at fit."""

import warnings

import numpy as np
import pytest

from narx_sklearn import NARXRegressor
from narx_sklearn.exceptions import NarxWarning
from narx_sklearn.identification.validation.at_rest import drift_at_rest
from narx_sklearn.model import AbsoluteDifference, Difference, DifferenceSign, NARXModel, Play, free_run
from narx_sklearn.signals import prfs

PHI = [Difference("u"), DifferenceSign("u")]
RATES = [Difference("u"), AbsoluteDifference("u")]
CONTINUUM = {"constraints": "continuum", "fit_intercept": False, "origin": "zero"}


def staying(u):
    """A stage that stays where its input stops: Bouc-Wen hysteresis and a lag of one sample."""
    h, y = 0.0, np.zeros(u.size)
    for k in range(1, u.size):
        h += 0.3 * (u[k] - u[k - 1]) - 0.2 * abs(u[k] - u[k - 1]) * h
        y[k] = 0.5 * y[k - 1] + 0.5 * (u[k] - h)
    return y


def moving(n=1500):
    return prfs(n, 1.0, 0.01, amplitudes=5.0, random_state=0)


def with_rests(n=1500, every=300, length=150):
    u = moving(n)
    for k in range(every, n, every):
        u[k - length : k] = u[k - length]
    return u


def told(narx, u, y):
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        narx.fit(u[:, None], y)
    return [str(w.message) for w in caught if "does not stay" in str(w.message)]


def fitted_plainly(u, y):
    return NARXRegressor(2, 2, phi_lags=2, degree=2, phi=PHI), u, y


def test_the_fit_of_a_model_that_drifts_says_how_far_and_the_way_out():
    u = moving()
    narx, _, y = fitted_plainly(u, staying(u))
    with pytest.warns(NarxWarning, match=r"does not stay where its input stops.*structure='hysteresis'") as w:
        narx.fit(u[:, None], y)
    assert "rests for 1 sample at most" in str(w[0].message)
    drift = drift_at_rest(narx.model_, u[:, None], y[:, None])
    assert f"held at u = {drift.inputs['u']:.4g}, y goes from {drift.begin:.4g}" in str(w[0].message)
    # the same stop of the same free run, held by hand
    k = int(np.flatnonzero(u == drift.inputs["u"])[0])
    held = np.append(u[: k + 1], np.full(4 + 1500, u[k]))
    run = narx.predict(held[:, None], y_init=y)[k + 1 + narx.model_.max_lag :]
    n = drift.n_samples
    assert [drift.begin, drift.per_sample, drift.end] == pytest.approx([run[0], run[1] - run[0], run[n]])
    assert abs(drift.end - drift.begin) > 0.5


def test_a_model_that_stays_is_told_nothing_of():
    u = moving()
    narx = NARXRegressor(1, 1, degree=3, phi=PHI, structure="hysteresis", n_terms=6, **CONTINUUM)
    assert told(narx, u, staying(u)) == []
    assert narx.continuum_.holds


def test_the_structure_without_its_constraint_drifts_and_only_that_is_asked_for():
    u = moving()
    leaky = free_run(
        NARXModel.from_equations("0.995*y[k-1] + 0.5*phi1[k-1] - 0.1*phi2[k-1]*y[k-1]", phi=RATES), u, [0, 0]
    ).y[:, 0]
    narx = NARXRegressor(1, 1, degree=2, phi=RATES, structure="hysteresis", n_terms=3)
    (words,) = told(narx, u, leaky)
    assert "pass constraints='continuum'" in words
    assert "structure=" not in words


LEAKY = NARXModel.from_equations("0.99*y[k-1] + 0.3*phi1[k] - 0.1*phi2[k]*y[k-1]", phi=RATES)
FIRM = NARXModel.from_equations("y[k-1] + 0.3*phi1[k] - 0.1*phi2[k]*y[k-1]", phi=RATES)


@pytest.mark.parametrize("noise", [0.0, 0.05])
def test_a_record_that_rests_decides(noise):
    e = noise * np.random.default_rng(0).normal(size=(1500, 1))
    u = with_rests()[:, None]
    assert drift_at_rest(LEAKY, u, free_run(LEAKY, u, [0.0]).y + e) is None  # it does fall back
    assert drift_at_rest(FIRM, u, free_run(FIRM, u, [0.0]).y + e) is None
    drift = drift_at_rest(LEAKY, u, free_run(FIRM, u, [0.0]).y + e)
    assert drift.rests
    assert drift.longest_rest == 150
    u = moving()[:, None]
    assert not drift_at_rest(LEAKY, u, free_run(LEAKY, u, [0.0]).y + e).rests  # so nothing tells


def test_a_record_that_rests_otherwise_is_told():
    u = with_rests()
    y = free_run(FIRM, u, [0.0]).y[:, 0]
    narx = NARXRegressor(
        1, [0], phi_lags=[0], degree=2, phi=RATES, constraints=["y[k-1] = 0.99"], refine=False
    )
    narx.set_params(structure="hysteresis")
    (words,) = told(narx, u, y)
    assert "Where the record's input rests, for up to 150 samples, it does not move so." in words


def test_directions_that_do_not_count_and_models_that_remember_are_silent():
    u = moving()[:, None]
    y = free_run(NARXModel.from_equations("0.9*y[k-1] + 0.1*u[k-1]"), u, [0.0]).y
    for equation, phi in (
        ("0.9*y[k-1] + 0.1*u[k-1]", []),
        ("0.9*y[k-1] + 0.1*u[k-1] + 1e-6*phi2[k-1]", PHI),
        ("0.99*y[k-1] + 0.5*phi1[k-1]", PHI),  # no sign, a high pass
        (
            "0.9*y[k-1] + 0.1*play[k-1] + 0.01*turn[k-1]",
            [Play("u", 1.0, name="play"), DifferenceSign("u", name="turn")],
        ),
    ):
        model = NARXModel.from_equations(equation, phi=phi)
        assert drift_at_rest(model, u, y) is None


def test_gaps_and_short_sessions_offer_no_stop():
    u = moving(400)[:, None]
    y = free_run(FIRM, u, [0.0]).y
    assert drift_at_rest(LEAKY, u, y) is not None
    assert drift_at_rest(LEAKY, u, y, np.arange(400) // 2) is None
    u[::3] = np.nan
    assert drift_at_rest(LEAKY, u, y) is None
