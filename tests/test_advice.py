"""Advice names what is missing from a model, and is silent where nothing is."""

import numpy as np
import pytest
from scipy.signal import lfilter
from scipy.stats import binom

from narx_sklearn import NARXRegressor
from narx_sklearn.analysis import advise
from narx_sklearn.datasets import make_narx
from narx_sklearn.model import NARXModel


def oscillator(rng, n_samples, noise=0.003):
    """Return input and output of a hardening oscillator whose output follows the input at once.

    y[k] = 1.45 y[k-1] - 0.85 y[k-2] - 0.1 y[k-1]^3 + 0.2 u[k] + 0.2 u[k-1] + e[k]: an electronic circuit
    sampled so that half of the response falls into the sample of the input.
    """
    u = 0.5 * lfilter([0.5, 0.3], [1.0, -0.2], rng.normal(size=n_samples))
    e = noise * rng.normal(size=n_samples)
    y = np.zeros(n_samples)
    for k in range(2, n_samples):
        past = 1.45 * y[k - 1] - 0.85 * y[k - 2] - 0.1 * y[k - 1] ** 3
        y[k] = past + 0.2 * u[k] + 0.2 * u[k - 1] + e[k]
    return u[:, None], y


def subjects(advice):
    return [finding.subject for finding in advice.findings]


def test_a_missing_current_input_is_named_first_and_following_the_advice_ends_it():
    u, y = oscillator(np.random.default_rng(0), 4000)
    without = NARXRegressor(2, 2, degree=3, refine=False).fit(u, y)
    advice = advise(without.model_, u, y)
    assert subjects(advice)[0] == "current input"
    assert "pass delay=0 for u" in str(advice)
    assert advice.findings[0].gain > 0.5
    found = NARXRegressor(2, 2, degree=3, delay=0, refine=False).fit(u, y)
    assert "u[k]" in found.terms_
    assert found.sigma_[0] < 0.1 * without.sigma_[0]
    assert advise(found.model_, u, y).findings == ()
    assert "Nothing to advise" in str(advise(found.model_, u, y))


def response(rng, n_samples, lags, poles=(0.5,), noise=0.05):
    """Return input and output of y = sum of poles on its own past and inputs at ``lags``."""
    u, e = rng.uniform(-1, 1, n_samples), noise * rng.normal(size=n_samples)
    y = np.zeros(n_samples)
    for k in range(max(*lags, len(poles)), n_samples):
        past = sum(pole * y[k - 1 - i] for i, pole in enumerate(poles))
        y[k] = past + sum(u[k - lag] for lag in lags) + e[k]
    return u[:, None], y


@pytest.mark.parametrize(
    ("lags", "poles", "options", "subject", "words"),
    [
        ((1, 4), (0.5,), {"input_lags": 2}, "input lags", "input_lags="),
        ((1,), (0.3, 0.0, 0.4), {"output_lags": 1}, "output lags", "output_lags="),
        ((2, 3), (0.5,), {"input_lags": [3]}, "earlier input", "acts before lag 3"),
        ((3, 4), (0.5,), {"input_lags": 4}, "dead time", "a dead time of 3 samples: with delay=3"),
    ],
)
def test_lags_that_are_missing_or_needless_are_named(lags, poles, options, subject, words):
    u, y = response(np.random.default_rng(1), 3000, lags, poles)
    model = NARXRegressor(**{"output_lags": 1, "degree": 1, "refine": False} | options).fit(u, y).model_
    advice = advise(model, u, y)
    assert subject in subjects(advice)[:2]
    assert words in str(advice)


def test_samples_too_dense_are_told_with_and_without_a_period():
    rng = np.random.default_rng(0)
    smooth = lfilter([1.0], np.poly([0.99, 0.99, 0.98]), rng.normal(size=20_000))
    y = smooth / smooth.std()
    u = np.append(y[1:], 0.0)[:, None]
    for period, words in ((None, "times denser"), (0.01, "is short for it")):
        model = NARXModel.from_equations("0.5*y[k-1] + 0.5*u[k-1]", sampling_period=period)
        advice = advise(model, u, y)
        assert subjects(advice)[-1] == "sampling"
        assert words in str(advice)


@pytest.mark.parametrize("pole", [0.0, 0.7])
def test_false_advice_is_as_rare_as_promised_whatever_the_colour(pole):
    """The model is the true one; its residual is the noise, white or coloured. Five trials in each of 200."""
    model = NARXModel.from_equations("u[k-1] - 0.3*u[k-1]^2")
    rng = np.random.default_rng(0)
    wrong = 0
    for _ in range(200):
        u = rng.uniform(-1, 1, (1500, 1))
        e = 0.3 * lfilter([1.0], [1.0, -pole], rng.normal(size=1500))
        y = e.copy()
        y[1:] += u[:-1, 0] - 0.3 * u[:-1, 0] ** 2
        advice = advise(model, u, y, level=0.05, smallest_gain=0.0)
        wrong += any(finding.subject in ("current input", "input lags") for finding in advice.findings)
        if pole > 0.0:  # coloured noise is an output's own past: to find it is right
            assert "output lags" in subjects(advice)
    assert wrong <= binom.ppf(0.999, 200, 0.05)


def test_every_equation_and_input_is_looked_at_and_sessions_hold():
    rng = np.random.default_rng(2)
    X, e = rng.uniform(-1, 1, (2400, 2)), 0.05 * rng.normal(size=(2400, 2))
    y = np.zeros((2400, 2))
    for k in range(2, 2400):
        y[k] = 0.4 * y[k - 1] + X[k - 1] + e[k]
        y[k, 1] += 0.8 * X[k, 0]
    model = NARXModel.from_equations(
        {"a": "0.4*a[k-1] + p[k-1]", "b": "0.4*b[k-1] + q[k-1]"}, inputs=("p", "q")
    )
    sessions = np.repeat([0, 1, 2], 800)
    found = advise(model, X, y, sessions=sessions).findings
    assert [(f.output, f.subject, f.terms) for f in found] == [("b", "current input", ("p[k]",))]


def test_a_model_of_everything_in_the_record_gets_no_advice():
    plant = make_narx(3000, n_terms=6, noise=0.05, random_state=0)
    narx = NARXRegressor(2, 2, refine=False).fit(plant.X, plant.y)
    assert advise(narx.model_, plant.X, plant.y).findings == ()


MODEL = NARXModel.from_equations("0.5*y[k-1] + u[k-1]")


@pytest.mark.parametrize(
    ("n_samples", "columns", "options", "message"),
    [
        (100, 1, {}, "at least 120. Pass a longer record"),
        (500, 2, {}, "X has 2 columns, the model has 1"),
        (500, 1, {"level": 1.5}, "level=1.5 must lie between 0 and 1"),
        (500, 1, {"smallest_gain": -0.1}, "smallest_gain=-0.1"),
    ],
)
def test_wrong_arguments_are_named(n_samples, columns, options, message):
    rng = np.random.default_rng(0)
    with pytest.raises(ValueError, match=message):
        advise(MODEL, rng.normal(size=(n_samples, columns)), rng.normal(size=n_samples), **options)
