"""Compensators as estimators: identification, limits, on-line steps, scoring, physics, errors."""

import pickle
import warnings

import numpy as np
import pandas as pd
import pytest
from scipy.signal import lfilter
from sklearn.base import clone
from sklearn.exceptions import NotFittedError
from sklearn.model_selection import GridSearchCV, TimeSeriesSplit
from thesis_models import M_I, M_INVERSE, M_R

from narx_sklearn import NARXRegressor
from narx_sklearn.compensation import (
    AmplificationWarning,
    BoucWenCompensator,
    InverseCompensator,
    IsolatedCompensator,
    PrandtlIshlinskiiCompensator,
    RootCompensator,
    UnreachableWarning,
    law_stability,
    run_plant,
    smooth_output,
    smooth_signs,
    tracking_error,
    tracking_scorer,
)
from narx_sklearn.datasets import make_piezo_bench
from narx_sklearn.discrepancy import DiscrepancyRegressor, ODESimulator
from narx_sklearn.exceptions import NarxWarning
from narx_sklearn.identification.structure.isolable import isolable_structure
from narx_sklearn.metrics import mape
from narx_sklearn.model import (
    Difference,
    DifferenceSign,
    FunctionPhi,
    NARXModel,
    SmoothSign,
    TermLibrary,
    free_run,
)
from narx_sklearn.physics import PIEZO_BENCH, BoucWen, BoucWenModel, PrandtlIshlinskiiOperator
from narx_sklearn.signals import prfs

SINE = 40.0 * np.sin(2.0 * np.pi * np.arange(2000) / 1000)
PIEZO_INPUT = prfs(8000, 1.0, 1e-3, amplitudes=80.0, random_state=0)
PIEZO_OUTPUT = PIEZO_BENCH.run(PIEZO_INPUT)
PLANT = NARXModel.from_equations("0.6*y[k-1] + u[k-1] + 0.2*u[k-1]^3")


def recorded(n=600, seed=0):
    u = np.random.default_rng(seed).uniform(-1, 1, n)
    return u.reshape(-1, 1), free_run(PLANT, u, y_init=[0.0]).y[:, 0]


@pytest.mark.parametrize(
    ("compensator", "worst"),
    [
        (RootCompensator(M_R), 0.30),
        (IsolatedCompensator(M_I), 0.30),
        (InverseCompensator(M_INVERSE), 0.80),
        (PrandtlIshlinskiiCompensator(), 3.0),
        (BoucWenCompensator(PIEZO_BENCH), 0.25),
    ],
)
def test_the_piezo_bench_follows_a_sine_many_times_better_than_without(compensator, worst):
    needs_data = compensator.model is None
    compensator.fit(PIEZO_INPUT.reshape(-1, 1), PIEZO_OUTPUT) if needs_data else compensator.fit()
    assert tracking_error(None, PIEZO_BENCH, SINE) > 6.0  # Table 5.3: 6.54
    m = compensator.predict(SINE, m_init=0.0)
    assert mape(SINE, PIEZO_BENCH.run(m)) < worst


@pytest.mark.parametrize("compensator", [RootCompensator(), IsolatedCompensator(), InverseCompensator()])
def test_the_defaults_identify_and_compensate_the_piezo_bench(compensator):
    X = pd.DataFrame({"voltage [V]": PIEZO_INPUT})
    y = pd.Series(PIEZO_OUTPUT, name="displacement [um]")
    compensator.fit(X, y)
    assert compensator.law_.keeps_rest
    assert tracking_error(compensator, PIEZO_BENCH, SINE, m_init=0.0) < 1.0  # 6.3 without


def heater(m):
    """Run a machine without hysteresis: a lag whose gain depends on the input and on the output."""
    y = np.zeros(len(m))
    for k in range(1, y.size):
        y[k] = 0.95 * y[k - 1] + 0.05 * m[k - 1] + 0.005 * m[k - 1] ** 2 - 0.002 * y[k - 1] ** 2
    return y


def lagging_piezo(m):
    """Run a machine with hysteresis whose output lags by five samples."""
    h, y = 0.0, np.zeros(len(m))
    for k in range(1, y.size):
        d = m[k] - m[k - 1]
        h += 0.036 * d - 0.018 * abs(d) * h - 0.0072 * d * abs(h)
        y[k] = y[k - 1] + 0.2 * (0.16 * m[k] - h - y[k - 1])
    return y


@pytest.mark.parametrize("compensator", [RootCompensator(), IsolatedCompensator(), InverseCompensator()])
@pytest.mark.parametrize(
    ("plant", "reach", "noise", "worst"),
    [
        (heater, 10.0, 0.02, 1.0),
        (lagging_piezo, 100.0, 0.02, 2.5),
    ],  # 3.7 and 5.7 by a line through the record
)
def test_the_defaults_know_machines_with_and_without_hysteresis(compensator, plant, reach, noise, worst):
    u = prfs(3000, 1.0, 0.01, amplitudes=reach / 2, random_state=1) + reach / 2
    y = plant(u)
    compensator.fit(u.reshape(-1, 1), y + noise * np.random.default_rng(0).normal(size=u.size))
    begin = np.exp(-np.arange(1500) / 100)  # from where the record left the machine
    reference = begin * y[-1] + (1 - begin) * (np.mean(y) + 0.5 * np.std(y) * np.sin(np.arange(1500) / 100))
    m = compensator.compensate(reference, m_init=u[-1]).m
    assert mape(reference, plant(np.concatenate([u, m]))[u.size :]) < worst


def test_the_range_and_the_score_are_those_of_the_input_that_compensates():
    X = np.random.default_rng(0).uniform(-1, 1, (600, 2)) * [10.0, 1.0]
    equation = "0.5*y[k-1] + 0.1*load[k-1] + drive[k-1] + 0.2*drive[k-1]^3"
    model = NARXModel.from_equations(equation, inputs=["load", "drive"])
    y = free_run(model, X, y_init=[0.0]).y[:, 0]
    frame = pd.DataFrame(X, columns=list(model.inputs))
    for given in (model, None):
        compensator = RootCompensator(given, input_name="drive").fit(frame, pd.Series(y, name="y"))
        assert max(np.abs(compensator.law_.limits)) < 1.0
        assert compensator.score(frame, y) > 0.99


def test_of_defaults_that_all_fail_the_last_one_says_why():
    with pytest.raises(ValueError, match="does not depend on the input 'u'"):
        RootCompensator().fit(np.zeros((200, 1)), np.sin(np.arange(200)))


@pytest.mark.parametrize("order", [slice(None), slice(None, None, -1)])
def test_of_several_estimators_the_one_whose_law_serves_is_taken(order):
    rng = np.random.default_rng(0)
    u = rng.normal(size=(800, 1))
    y = np.zeros(800)
    for k in range(2, 800):  # its exact law is m[k] = -2 m[k-1] + ..., which grows beyond all bounds
        y[k] = 0.5 * y[k - 1] + u[k - 1, 0] + 2.0 * u[k - 2, 0]
    asked = [NARXRegressor(1, 2, degree=1), NARXRegressor(1, 1, degree=1)][order]
    compensator = RootCompensator(asked).fit(u, y)
    assert compensator.regressor_.input_lags == 1
    assert compensator.model_ is compensator.regressor_.model_
    assert law_stability(compensator.law_, y[:100]).is_stable
    assert clone(compensator).model[0].get_params() == asked[0].get_params()


def test_a_fitted_estimator_without_a_record_is_told_to_hand_over_its_model():
    with pytest.raises(ValueError, match="pass model=model_ of the estimator"):
        RootCompensator(NARXRegressor(1, 1).fit(*recorded())).fit()


def test_an_identified_plant_is_inverted_exactly():
    X, y = recorded()
    r = 0.5 * np.sin(np.arange(300) / 15)
    for compensator in (
        RootCompensator(NARXRegressor(1, 1, degree=3)),
        RootCompensator(NARXRegressor(1, 1, degree=3), policy="nearest"),
    ):
        compensator.fit(X, y)
        assert compensator.model_.library.names == ["y[k-1]", "u[k-1]", "u[k-1]^3"]
        tracked = free_run(PLANT, compensator.predict(r)).y[:, 0]
        np.testing.assert_allclose(tracked[50:], r[50:], atol=1e-8)


def test_steps_on_line_equal_the_prediction_and_start_warm():
    compensator = RootCompensator(M_R).fit()
    m = compensator.predict(SINE, m_init=0.0)
    compensator.reset(SINE[0], m=0.0)
    np.testing.assert_array_equal([compensator.step(r) for r in SINE[1:101]], m[:100])
    assert compensator.counts.samples == 100
    compensator.reset(SINE[:501], m=m[:500])
    np.testing.assert_array_equal([compensator.step(r) for r in SINE[501:551]], m[500:550])


def test_a_record_that_begins_in_motion_does_not_offset_the_first_input():
    plant = make_piezo_bench(6000, random_state=1)
    assert abs(plant.X.iloc[0, 0]) > 60.0
    compensator = RootCompensator().fit(plant.X, plant.y)
    assert tracking_error(compensator, PIEZO_BENCH, SINE) < 2.0  # 6.3 without


def test_what_a_reference_asks_beyond_reach_is_said():
    square = NARXModel.from_equations("u[k-1]^2")
    with pytest.warns(
        UnreachableWarning, match=r"Of 4 samples 3 had no admissible input \(the last was kept\)"
    ):
        RootCompensator(square).fit().predict([1.0, 1.0, -1.0, -1.0], m_init=1.0)
    double = NARXModel.from_equations("0.5*u[k-1] + 0.1*u[k-2]")
    with pytest.warns(UnreachableWarning, match="at 2 the limits -1 to 1 cut it"):
        IsolatedCompensator(double, limits=(-1, 1)).fit().predict([0.0, 0.0, 1.0], m_init=0.0)


def test_a_change_that_the_rate_limit_cuts_is_said_alone_and_beside_the_limits():
    delayed = NARXModel.from_equations("0.5*u[k-1] + 0.1*u[k-2]")
    compensator = IsolatedCompensator(delayed, rate_limit=0.5).fit()
    with pytest.warns(UnreachableWarning) as told:
        m = compensator.predict([0.0, 0.0, 1.0, 1.0, 1.0, 1.0], m_init=0.0)
    assert compensator.compensate([0.0, 0.0, 1.0, 1.0, 1.0, 1.0], m_init=0.0).counts.at_rate_limit == 3
    np.testing.assert_allclose(np.diff(m)[:3], 0.5)
    assert len(told) == 1
    message = str(told[0].message)
    assert message.startswith("Of 6 samples at 3 rate_limit=0.5 cut its change. The machine cannot follow")
    assert "limits" not in message.replace("rate_limit", "")
    assert "no admissible" not in message
    assert message.endswith("raise rate_limit if the machine allows it, or slow the reference down.")
    both = IsolatedCompensator(delayed, limits=(-1, 1), rate_limit=0.5).fit()
    with pytest.warns(UnreachableWarning, match=r"at 5 the limits -1 to 1 cut it, at 1 rate_limit=0\.5 cut"):
        both.predict([0.0, 0.0, 1.0, 1.0, 1.0, 1.0], m_init=0.0)


@pytest.mark.parametrize("ask", [lambda c: c.step(0.1), lambda c: c.counts, lambda c: c.reset()])
def test_steps_before_fit_are_refused(ask):
    with pytest.raises(NotFittedError):
        ask(RootCompensator(PLANT))


def test_the_reference_is_held_after_its_end():
    compensator = RootCompensator(M_R).fit()
    longer = np.append(SINE[:300], SINE[299])
    np.testing.assert_array_equal(compensator.predict(SINE[:300]), compensator.predict(longer)[:300])


def test_without_a_continuum_the_first_input_holds_the_first_reference():
    compensator = RootCompensator(PLANT).fit()
    m = compensator.predict(np.full(5, 1.7))
    np.testing.assert_allclose(m, m[0], atol=1e-9)
    np.testing.assert_allclose(m[0] + 0.2 * m[0] ** 3, 0.4 * 1.7, atol=1e-8)


@pytest.mark.parametrize("kind", [RootCompensator, IsolatedCompensator])
@pytest.mark.parametrize("gain", [0.299, 0.301, 0.4, 0.9])  # a law that forgets slowly, and laws that amplify
@pytest.mark.filterwarnings("ignore::narx_sklearn.compensation.AmplificationWarning")
def test_the_first_input_holds_the_first_reference_however_the_law_behaves(kind, gain):
    compensator = kind(NARXModel.from_equations(f"0.5*y[k-1] + 0.3*u[k-1] + {gain}*u[k-2]")).fit()
    m = compensator.predict(np.full(5, 0.5))
    np.testing.assert_allclose(m, 0.25 / (0.3 + gain), rtol=1e-12)
    compensator.reset(reference=0.5)
    assert compensator.step(0.5) == pytest.approx(0.25 / (0.3 + gain), rel=1e-12)


def test_of_several_inputs_that_hold_the_first_reference_the_recorded_one_is_taken():
    square = {"y[k-1]": 0.5, "u[k-1]^2": 1.0, "u[k-1]*u[k-2]": 1.0}  # rests where 2 u^2 = y/2
    known = {"u": (-4.0, -1.8, 4.0), "y": (0.0, 16.0, 64.0)}

    def first(reference, recorded=None, **settings):
        model = NARXModel.from_equations(square, recorded=recorded or {})
        return RootCompensator(model, **settings).fit().compensate([reference] * 2).m[0]

    assert first(16.0) == pytest.approx(2.0)
    assert first(16.0, limits=(-9.0, -1.0)) == pytest.approx(-2.0)
    assert first(16.0, known) == pytest.approx(-2.0)
    assert first(16.0, known, branch="rising") == pytest.approx(2.0)  # too low at -1.8
    assert first(16.0, limits=(-1.5, 1.0)) == -1.5  # comes nearest
    assert first(-16.0) == 0.0
    u = -2.0 + 0.1 * np.random.default_rng(0).normal(size=200)
    model = NARXModel.from_equations(square)
    fitted = RootCompensator(model, limits=(-9, 9)).fit(u, free_run(model, u, y_init=[16.0, 16.0]).y)
    assert fitted.predict([16.0, 16.0])[0] == pytest.approx(-2.0)


def test_the_first_input_counts_other_inputs_and_an_operating_point():
    model = NARXModel.from_equations(
        "0.5*y[k-1] + 0.1*u[k-1] + 0.3*u[k-2]*w[k-1]^2 + 7*phi1[k-1]",
        inputs=["w", "u"],
        phi=[DifferenceSign("w")],
        origin={"y": 20.0, "u": 1.0},
    )
    compensator = RootCompensator(model, input_name="u").fit()
    m = compensator.predict(np.tile([30.0, 2.0], (4, 1)))
    np.testing.assert_allclose(m, 1.0 + 0.5 * 10.0 / (0.1 + 0.3 * 4.0))


def test_an_inverse_law_begins_at_its_own_rest():
    model = NARXModel.from_equations("0.9995*u[k-1] + y[k-1]", outputs=["u"], inputs=["y"])
    m = InverseCompensator(model).fit().predict(np.full(4, 0.25))
    np.testing.assert_allclose(m, 500.0, rtol=1e-9)


def test_columns_that_are_called_as_in_a_law_keep_their_names_outside_of_it():
    rng = np.random.default_rng(0)
    X = pd.DataFrame(rng.normal(size=(400, 3)), columns=["u [V]", "d", "m [kg]"])
    y = np.zeros(400)
    u, d, m = X.to_numpy().T
    for k in range(1, 400):
        y[k] = 0.5 * y[k - 1] + u[k - 1] + 0.3 * d[k - 1] + 0.2 * m[k - 1] * u[k - 1]
    compensator = RootCompensator(NARXRegressor(1, 1, degree=2), limits=(-9, 9)).fit(
        X, pd.Series(y, name="r")
    )
    assert compensator.law_.others == ("d", "m_")
    with pytest.raises(ValueError, match="the law needs 3: the reference, d, m\\."):
        compensator.predict(y)
    with pytest.warns(NarxWarning, match=r"'m \[s\]' states another unit than the model's input 'm \[kg\]'"):
        compensator.predict(pd.DataFrame(np.column_stack([y, d, m]), columns=["r", "d", "m [s]"]))
    np.testing.assert_allclose(compensator.predict(np.column_stack([y, d, m]), m_init=u[0])[:-1], u[:-1])


def test_compensators_survive_clone_and_pickle():
    compensator = RootCompensator(M_R, limits=(-80, 80), policy="nearest").fit()
    again = pickle.loads(pickle.dumps(compensator))
    np.testing.assert_array_equal(again.predict(SINE[:200]), compensator.predict(SINE[:200]))
    assert again.step(0.1) == compensator.reset().step(0.1)
    assert clone(compensator).get_params()["policy"] == "nearest"


def test_grid_search_chooses_by_what_a_compensator_does_to_the_plant():
    X, y = recorded()
    r = 0.5 * np.sin(np.arange(200) / 15)
    search = GridSearchCV(
        RootCompensator(NARXRegressor(1, 1)),
        {"model__degree": [1, 3]},
        scoring=tracking_scorer(PLANT, r, n_settle=30),
        cv=TimeSeriesSplit(2),
    ).fit(X, y)
    assert search.best_params_ == {"model__degree": 3}
    assert search.best_score_ > -1e-6
    assert search.best_estimator_.score(X[:200], y[:200]) > 0.999


def test_the_structure_isolable_leaves_the_newest_input_alone_in_one_linear_term():
    phi = (Difference("u", name="phi1"), DifferenceSign("u", name="phi2"))
    names = [f"{s}[k-{lag}]" for s in ("u", "phi1", "phi2") for lag in (1, 2)] + ["y[k-1]"]
    library = TermLibrary.polynomial(names, 3).filter(isolable_structure(["y"], ["u"], phi))
    newest = [str(t) for t in library if any(v.lag == 1 and v.signal != "y" for v in t.variables)]
    assert newest == ["phi1[k-1]"]
    assert "1" not in library.names
    assert "u[k-2]*phi1[k-2]*phi2[k-2]" in library.names
    later = TermLibrary.polynomial(["y[k-1]", "u[k-2]", "u[k-3]"], 2)
    kept = later.filter(isolable_structure(["y"], ["u"], [], delay=2)).names
    assert "u[k-2]" in kept
    assert "y[k-1]*u[k-2]" not in kept
    assert "y[k-1]*u[k-3]" in kept


def test_isolable_is_a_structure_known_by_name():
    X, y = recorded()
    regressor = NARXRegressor(1, 2, degree=2, structure="isolable", n_terms=4).fit(X, y)
    law = IsolatedCompensator(regressor.model_).fit().law_
    assert law.method == "explicit"


# columns: y[k-1], u[k-1], u[k-2], y[k-1]^2, y[k-1]*u[k-2], u[k-2]^2
AS_MATRIX = (np.array([[1.0, 0, 0, 0, 0, 0], [0, 0, 0, 1, 0, 2]]), np.array([1.0, 0.0]))
IN_WORDS = ["y[k-1] = 1", "y[k-1]^2 + 2*u[k-2]^2 = 0"]


@pytest.mark.parametrize("constraints", [None, "y[k-1] = 1", IN_WORDS, {"y": IN_WORDS}, AS_MATRIX])
def test_the_newest_input_is_kept_where_selection_loses_it(constraints):
    # a machine that answers to its newest input far less than to the one before
    u = np.random.default_rng(0).normal(size=60)
    y = free_run(NARXModel.from_equations("y[k-1] + 0.05*u[k-1] + u[k-2]"), u, y_init=[0.0, 0.0]).y[:, 0]
    regressor = NARXRegressor(
        1, 2, degree=2, structure="isolable", n_terms=2, refine=False, origin="zero", constraints=constraints,
        fit_intercept=False,
    )  # fmt: skip
    lost = regressor.fit(u.reshape(-1, 1), y).terms_
    assert "u[k-1]" not in lost
    with pytest.warns(UnreachableWarning, match="runs away from"), pytest.warns(AmplificationWarning):
        compensator = IsolatedCompensator(regressor).fit(u.reshape(-1, 1), y)
    assert compensator.model_.library.names == TermLibrary([*lost, "u[k-1]"]).names
    assert compensator.law_.horizon == 1
    if constraints is not None:
        assert compensator.model_.equation()["y[k-1]"] == pytest.approx(1.0, abs=1e-12)
    assert compensator.model_.equation()["u[k-1]"] == pytest.approx(0.05, abs=1e-9)


def test_the_newest_difference_is_kept_in_a_continuum():
    phi = (Difference("u", name="phi1"), DifferenceSign("u", name="phi2"))
    u = np.random.default_rng(0).normal(size=60)
    plant = NARXModel.from_equations("y[k-1] + 0.05*phi1[k-1] + phi1[k-2]", phi=phi)
    y = free_run(plant, u, y_init=[0.0, 0.0, 0.0]).y[:, 0]
    regressor = NARXRegressor(
        1, 2, phi=phi, phi_lags=2, degree=2, structure="isolable", n_terms=2, refine=False, origin="zero",
        constraints="continuum", fit_intercept=False,
    )  # fmt: skip
    assert regressor.fit(u.reshape(-1, 1), y).terms_ == ["y[k-1]", "phi1[k-2]"]
    with pytest.warns(AmplificationWarning):
        model = IsolatedCompensator(regressor).fit(u.reshape(-1, 1), y).model_
    assert model.library == plant.library
    assert model.equation()["y[k-1]"] == pytest.approx(1.0, abs=1e-12)
    assert model.equation()["phi1[k-1]"] == pytest.approx(0.05, abs=1e-9)


def test_a_short_record_of_the_bench_still_gives_a_law():
    u, y = PIEZO_INPUT[:150], PIEZO_OUTPUT[:150]
    with pytest.warns(AmplificationWarning):
        law = IsolatedCompensator(limits=(-80, 80)).fit(u.reshape(-1, 1), y).law_
    assert law.method == "explicit"


def test_a_user_function_is_compensated_from_data():
    plant = NARXModel.from_equations(
        "0.6*y[k-1] + u[k-1] + 0.5*f[k-2]", phi=[FunctionPhi(np.arctan, ["u[k]"], name="f")]
    )
    u = np.random.default_rng(0).uniform(-1, 1, 400)
    y = free_run(plant, u, y_init=[0.0, 0.0]).y[:, 0]
    regressor = NARXRegressor(1, 1, phi=plant.phi, phi_lags=2, degree=1, n_terms=3, refine=False)
    compensator = RootCompensator(regressor).fit(u.reshape(-1, 1), y)
    r = 0.5 * np.sin(np.arange(300) / 15)
    tracked = free_run(plant, compensator.predict(r)).y[:, 0]
    np.testing.assert_allclose(tracked[50:], r[50:], atol=1e-8)
    assert clone(compensator).fit(u.reshape(-1, 1), y).reset().step(0.1) == pytest.approx(
        compensator.step(0.1)
    )


def test_a_denoised_output_takes_the_bias_from_the_inverse():
    rng = np.random.default_rng(0)
    n = 4000
    u = np.convolve(rng.normal(size=n), np.ones(20) / 20, mode="same")
    y = free_run(NARXModel.from_equations("0.8*y[k-1] + u[k-1]"), u, y_init=[0.0]).y[:, 0]
    measured = y + 0.05 * y.std() * rng.normal(size=n)
    inverse = NARXRegressor([], 2, n_terms=2, fit_intercept=False, refine=False, origin="zero")
    direct = NARXRegressor(1, 1, degree=1, refine=True, fit_intercept=False, origin="zero")

    def wrong(denoise):
        compensator = InverseCompensator(inverse, denoise=denoise).fit(u.reshape(-1, 1), measured)
        equation = compensator.law_.equations[0]
        return abs(equation["r[k+1]"] - 1.0) + abs(equation["r[k]"] + 0.8)

    biased = wrong(None)
    assert wrong(9) < 0.7 * biased
    assert wrong(direct) < 0.1 * biased


def test_the_amplifying_law_is_announced_when_it_is_fitted():
    unstable = NARXModel.from_equations("0.5*y[k-1] + u[k-1] + 1.2*u[k-2]")
    u = np.random.default_rng(0).normal(size=300)
    with pytest.warns(AmplificationWarning, match=r"1\.2-fold a sample"):
        IsolatedCompensator(unstable, limits=(-9, 9)).fit(u.reshape(-1, 1), u)


OUTWEIGHED = "0.5*y[k-1] + 0.3*u[k-1] + 0.4*u[k-2]"  # by the input before the newest


@pytest.mark.parametrize("kind", [RootCompensator, IsolatedCompensator])
def test_a_model_whose_law_amplifies_is_announced_at_its_own_operating_point(kind):
    with pytest.warns(AmplificationWarning, match=r"where 0 holds the output at 0 .* grow 1\.333-fold"):
        kind(NARXModel.from_equations(OUTWEIGHED)).fit()
    # the older input weighs 0.2 y: less than the newest one below y = 1.5, more above
    bilinear = "0.5*y[k-1] + 0.3*u[k-1] + 0.2*u[k-2]*y[k-1]"
    for mean, grows in ((1.0, False), (3.0, True)):
        recorded = {"y": (0.0, mean, 4.0), "u": (-9.0, 1.0, 9.0)}
        with warnings.catch_warnings(record=True) as told:
            warnings.simplefilter("always")
            kind(NARXModel.from_equations(bilinear, recorded=recorded)).fit()
        assert [w.category for w in told] == [AmplificationWarning] * grows
    beside = NARXModel.from_equations("0.5*y[k-1] + u[k-1] + 1.5*u[k-2] + w[k-1]", inputs=["u", "w"])
    with pytest.warns(AmplificationWarning, match=r"1\.5-fold"):
        kind(beside).fit()


def test_a_law_whose_input_turns_signs_is_not_judged_at_rest():
    signs = NARXModel.from_equations("0.5*y[k-1] + u[k-1] + 0.1*phi1[k-2]", phi=[DifferenceSign("u")])
    RootCompensator(signs).fit()


@pytest.mark.filterwarnings("ignore::narx_sklearn.compensation.AmplificationWarning")
@pytest.mark.parametrize("kind", [RootCompensator, IsolatedCompensator])
@pytest.mark.parametrize("n_samples", [300, 5000])
def test_an_input_that_ran_away_is_told_as_such_whether_or_not_it_left_the_finite_range(kind, n_samples):
    compensator = kind(NARXModel.from_equations(OUTWEIGHED)).fit()
    r = 0.5 + 0.4 * np.sin(np.arange(n_samples) / 15)
    with pytest.warns(UnreachableWarning) as told:
        m = compensator.predict(r)
    assert len(told) == 1
    message = str(told[0].message)
    low, high = r.min() * 0.5 / 0.7, r.max() * 0.5 / 0.7  # hold the reference's ends
    first = int(np.argmax(np.maximum(m - high, low - m) > 1e3 * (high - low)))
    wanted = f"usual inputs are {low:.4g} to {high:.4g}, but from sample {first} of {n_samples} on"
    assert wanted in message
    assert f"goes as far as {np.abs(m).max():.3g}" in message
    assert "1.333-fold" in message
    assert "no admissible" not in message


def test_a_slow_machine_may_want_thousandfold_inputs():
    slow = RootCompensator(NARXModel.from_equations("0.9999*y[k-1] + 0.0001*u[k-1]")).fit()
    assert slow.predict([0.0, 0.0, 1.0, 1.0]).max() == pytest.approx(1e4)


def test_smooth_signs_soften_the_input_at_reversals():
    sharp = RootCompensator(M_R, limits=(-80, 80)).fit().predict(SINE)
    smooth = RootCompensator(M_R, limits=(-80, 80), smooth_width=0.05).fit()
    m = smooth.predict(SINE)
    assert isinstance(smooth.law_.elements[-1], SmoothSign)
    assert np.abs(np.diff(m[:-2], 2)).max() < np.abs(np.diff(sharp[:-2], 2)).max()
    assert mape(SINE, PIEZO_BENCH.run(m)) < 0.5


def test_a_prandtl_ishlinskii_plant_is_compensated_to_rounding_from_any_state():
    operator = PrandtlIshlinskiiOperator((0, 0.5, 1.0), (1.0, 0.4, 0.2), (0.3, 0.1, 0.0), 0.2, -0.1)
    r = np.random.default_rng(0).normal(size=200)
    compensator = PrandtlIshlinskiiCompensator(operator).fit()
    np.testing.assert_allclose(operator.run(compensator.predict(r)), r, atol=1e-12)
    np.testing.assert_allclose(compensator.predict(r), operator.inverse().run(r), atol=1e-12)


def test_the_bouc_wen_law_uses_the_hysteresis_of_the_sample_before():
    m = BoucWenCompensator(PIEZO_BENCH).fit().predict(SINE[:100])
    h = 1.6 * m - PIEZO_BENCH.run(np.append(0.0, m))[1:]
    np.testing.assert_allclose(m[1:], (SINE[1:100] + h[:-1]) / 1.6, atol=1e-9)


def test_a_bouc_wen_estimator_can_be_given():
    compensator = BoucWenCompensator(BoucWen(n_starts=1, exponent_bounds=(1, 1), random_state=0))
    compensator.fit(PIEZO_INPUT[:3000].reshape(-1, 1), PIEZO_OUTPUT[:3000])
    assert pytest.approx(0.9, rel=1e-3) == compensator.model_.A


def test_plants_of_every_kind_can_be_run():
    u = np.array([1.0, 2.0, 3.0])
    model = NARXModel.from_equations("2*u[k]")
    estimator = PrandtlIshlinskiiCompensator(PrandtlIshlinskiiOperator((0,), (0.5,))).fit()
    for plant in (lambda u: 2 * u, model, PrandtlIshlinskiiOperator((0,), (2.0,)), estimator):
        np.testing.assert_allclose(run_plant(plant, u), 2 * u)


TWO_INPUTS = NARXModel.from_equations("u[k-1] + y[k-1] + d[k-1]", outputs=["u"], inputs=["y", "d"])


@pytest.mark.parametrize(
    ("fit", "error", "message"),
    [
        (lambda: RootCompensator().fit(), ValueError, "needs the record"),
        (lambda: RootCompensator("model").fit([[1.0]], [1.0]), TypeError, "NARXModel or an estimator"),
        (lambda: RootCompensator(PLANT, limits=(1, 0)).fit(), ValueError, "low < high"),
        (lambda: RootCompensator(PLANT, limits=5).fit(), ValueError, "limits must be a pair"),
        (lambda: RootCompensator(PLANT, limits=("a", "b")).fit(), ValueError, "limits must be a pair"),
        (lambda: RootCompensator(PLANT, rate_limit=0).fit(), ValueError, "rate_limit must be positive"),
        (lambda: RootCompensator(PLANT, rate_limit=True).fit(), ValueError, "rate_limit must be positive"),
        (
            lambda: RootCompensator(PLANT).fit().predict([1.0], m_init=np.nan),
            ValueError,
            "m_init must be finite",
        ),
        (lambda: RootCompensator(PLANT).fit().reset(np.nan), ValueError, "reference must be finite"),
        (lambda: RootCompensator(PLANT).fit().reset(0.0, m=np.inf), ValueError, "m must be finite"),
        (lambda: RootCompensator(PLANT).fit().step([1.0, 2.0]), ValueError, "A step takes 1 numbers"),
        (lambda: RootCompensator(PLANT).fit().step("up"), ValueError, "A step takes 1 numbers"),
        (lambda: RootCompensator(PLANT, policy="jump").fit(), ValueError, "policy='jump'"),
        (lambda: RootCompensator(M_R, smooth_width=0.1).fit(), ValueError, "needs limits"),
        (
            lambda: RootCompensator(PLANT, smooth_width=-1).fit(),
            ValueError,
            "smooth_width must be a positive",
        ),
        (lambda: InverseCompensator(M_INVERSE, smooth_width="wide").fit(), ValueError, "smooth_width must"),
        (lambda: smooth_signs(PLANT, 0.0), ValueError, "width must be a positive number"),
        (lambda: RootCompensator(PLANT, branch="up").fit(), ValueError, "branch='up'"),
        (
            lambda: RootCompensator(M_R, smooth_width=0.1, limits=(-80, 80), branch="rising").fit(),
            ValueError,
            "is searched",
        ),
        (lambda: RootCompensator(PLANT).fit().predict([1.0, np.nan]), ValueError, "sample 1"),
        (lambda: RootCompensator(PLANT).fit().predict([[1.0, 2.0]]), ValueError, "the law needs 1"),
        (lambda: RootCompensator(PLANT).fit().explain("matlab"), ValueError, "form='matlab'"),
        (lambda: InverseCompensator(M_INVERSE, lead=0).fit(), ValueError, "lead must be"),
        (lambda: InverseCompensator(denoise="magic").fit([[1.0]] * 9, [1.0] * 9), ValueError, "denoise must"),
        (
            lambda: InverseCompensator().fit(np.ones((9, 2)), np.ones(9)),
            ValueError,
            r"X has 2 columns, but the inverse model .* gives one input.*RootCompensator\(input_name=",
        ),
        (
            lambda: InverseCompensator(TWO_INPUTS).fit(),
            ValueError,
            r"has the inputs \['y', 'd'\], but an inverse model has one",
        ),
        (lambda: smooth_output(np.ones(9), 4), ValueError, "odd integer"),
        (lambda: smooth_output(np.ones(9), 11), ValueError, "shorter than the window"),
        (lambda: BoucWenCompensator(BoucWenModel(1, 1, 1)).fit(), ValueError, "input_gain 0"),
        (lambda: run_plant(3, [1.0]), TypeError, "A plant is"),
        (lambda: run_plant(lambda u: u[:1], [1.0, 2.0]), ValueError, "returned 1 samples"),
    ],
)
def test_what_cannot_be_is_said(fit, error, message):
    with pytest.raises(error, match=message):
        fit()


def tank(x, u, p):
    return u - p[0] * x


@pytest.mark.parametrize("kind", [RootCompensator, InverseCompensator, PrandtlIshlinskiiCompensator])
def test_a_diagnosis_or_a_simulator_is_told_how_it_becomes_a_model(kind):
    simulator = ODESimulator(tank, dt=0.1, parameters={"leak": 1.0}, inputs=["u"], states=["h"])
    record = np.ones((50, 1)), np.ones(50)
    for data in ((), record):
        with pytest.raises(TypeError, match=r"is a simulator \(ODESimulator\).*dx\.to_narx\(X\)"):
            kind(simulator).fit(*data)
        with pytest.raises(TypeError, match=r"is a DiscrepancyRegressor.*pass model=dx\.to_narx\(X\)"):
            kind(DiscrepancyRegressor(simulator)).fit(*data)


def test_a_law_that_runs_away_on_a_slower_reference_is_not_taken():
    """Of slip elements behind a lag the best isolable model gives the recorded input back."""
    rng = np.random.default_rng(10)
    window = np.hanning(61) / np.hanning(61).sum()
    u = np.convolve(rng.normal(size=3120), window, "valid")[:3000]
    u *= 1.5 / np.abs(u).max()
    stiffness, slip = np.array([0.3, 0.2, 0.15, 0.1, 0.05]), np.array([0.05, 0.12, 0.25, 0.5, 1.0])
    z, y, now = np.zeros(5), np.zeros(u.size), 0.0
    for k, move in enumerate(np.diff(u, prepend=u[0])):
        z = np.clip(z + stiffness * move, -slip * stiffness, slip * stiffness)
        y[k] = now = now + 0.5 * (0.6 * u[k] + z.sum() - now)
    y += 0.002 * y.std() * np.random.default_rng(0).normal(size=y.size)
    compensator = IsolatedCompensator().fit(u[:, None], y)
    slower = np.interp(np.arange(0, 2999, 0.5), np.arange(3000), y)
    counts = compensator.compensate(slower, u[0]).counts
    assert counts.at_limit < 0.1 * counts.samples


def lag_behind_a_cubic(n=2000):
    rng = np.random.default_rng(0)
    u = np.repeat(rng.uniform(-2.0, 2.0, n // 20), 20)
    y = cubic_then_lag(u)
    return u.reshape(-1, 1), y + 0.01 * np.std(y) * rng.normal(size=n)


def cubic_then_lag(u):
    return lfilter([0.0, 0.1], [1.0, -0.9], u + 0.3 * u**3)


def left(reference, output):
    return np.sqrt(np.mean((output - reference) ** 2)) / np.std(reference)


def test_an_inverse_model_is_chosen_by_what_its_law_does_to_the_machine():
    X, y = lag_behind_a_cubic()
    reference = 0.5 * np.abs(y).max() * np.sin(2.0 * np.pi * np.arange(3000) / 1000)
    chosen = InverseCompensator().fit(X, y)
    error = tracking_error(chosen, cubic_then_lag, reference, metric=left, n_settle=300)
    assert error < 0.1  # 0.18 by the free run on the record's own output


def test_an_inverse_law_worse_than_a_straight_line_is_told():
    """A machine that doubles: of the law 5 r the output is 10 r, of the line 0.5 r it is r."""
    u = 1.5 * np.sin(2.0 * np.pi * np.arange(1001) / 100)
    y = np.append(0.0, 2.0 * u[:-1])
    five = NARXModel.from_equations("5*y[k-1]", outputs=["u"], inputs=["y"])
    compensator = InverseCompensator(five, limits=(-99, 99), lead=2)
    with pytest.warns(
        UnreachableWarning, match=r"no better than a straight line.* leaves 900% .*longer lead than 2"
    ):
        compensator.fit(u[:, None], y)
    for trial in compensator.rehearsal_.trials:
        assert (trial.law, trial.line, trial.doubt) == pytest.approx((9.0, 0.0, 0.0), abs=0.02)
    assert "leaves 900% of a reference's deviation, a straight line of it 0%" in compensator.explain()
    with pytest.warns(
        UnreachableWarning, match="leaves 900% of the deviation of this reference; the straight line"
    ):
        compensator.predict(y[:500])


# -- units of a reference --------------------------------------------------------------------------------


def labelled_record(n_samples=400):
    """A record of ``y[k] = 0.5 y[k-1] + u[k-1]`` with names and units."""
    k = np.arange(n_samples)
    u = (np.sin(k / 20) + 0.3 * np.sin(k / 7))[:, None]
    y = lfilter([0.0, 1.0], [1.0, -0.5], u[:, 0])
    return pd.DataFrame(u, columns=["drive [V]"]), pd.Series(y, name="gap [um]")


@pytest.mark.parametrize(
    "compensator",
    [
        RootCompensator(NARXRegressor(1, 1, degree=1)),
        InverseCompensator(NARXRegressor(0, 2, degree=1)),
        # the record is of a machine that lags, which hysteresis alone does not follow
        BoucWenCompensator(BoucWenModel(A=0.1, beta=0.1, gamma=0.1, input_gain=1.0), rehearsed=False),
        PrandtlIshlinskiiCompensator(rehearsed=False),
    ],
    ids=lambda c: type(c).__name__,
)
def test_a_reference_in_another_unit_than_the_output_of_the_record_is_refused(compensator):
    fitted = clone(compensator).fit(*labelled_record())
    r = np.full(5, 0.5)
    with pytest.raises(
        ValueError,
        match=r"column 'wanted \[mm\]' is in another unit than the model's output 'gap \[um\]': its values "
        r"are to be taken times 1000\. Convert the column",
    ):
        fitted.predict(pd.DataFrame({"wanted [mm]": r}))
    with pytest.warns(NarxWarning, match=r"'wanted \[V\]' states another unit than the model's output"):
        fitted.predict(pd.Series(r, name="wanted [V]"))
    for label in ("wanted [um]", "wanted"):
        np.testing.assert_array_equal(fitted.predict(pd.Series(r, name=label)), fitted.predict(r))


def test_a_reference_and_what_stands_beside_it_are_in_the_units_of_a_model():
    model = NARXModel.from_equations(
        "0.5*y[k-1] + u[k-1] + v[k-1]", inputs=["u", "v"], units={"y": "K", "v": "degC"}
    )
    law = RootCompensator(model).fit()
    known = pd.DataFrame({"y [K]": np.ones(3), "v [degC]": np.ones(3)})
    np.testing.assert_array_equal(law.predict(known), law.predict(known.to_numpy()))
    with pytest.raises(ValueError, match=r"'y \[degC\]' .* output 'y \[K\]': .* plus 273.15"):
        law.predict(known.set_axis(["y [degC]", "v [degC]"], axis=1))
    with pytest.raises(ValueError, match=r"'v \[K\]' .* the model's input 'v \[degC\]': .* minus 273.15"):
        law.predict(known.set_axis(["y [K]", "v [K]"], axis=1))
    inverse = NARXModel.from_equations("r[k]", outputs=["u"], inputs=["r"], units={"r": "um", "u": "V"})
    with pytest.raises(ValueError, match=r"the model's output 'r \[um\]'"):
        InverseCompensator(inverse).fit().predict(pd.Series(np.ones(3), name="r [mm]"))


# -- what a model keeps of its record --------------------------------------------------------------------


def resting_model(slope, recorded):
    """A model that can rest anywhere, its output ``slope`` times the input but for a constant."""
    return NARXModel.from_equations(
        {"y[k-1]": 1.0, "phi1[k-1]": slope}, phi=[Difference("u")], recorded=recorded
    )


def test_where_a_model_that_rests_anywhere_begins_is_asked_where_no_record_tells():
    compensator = RootCompensator(resting_model(0.5, {})).fit()
    with pytest.warns(UnreachableWarning, match="rest anywhere and keeps no record .*which input holds 3,"):
        compensator.predict(3.0 + np.sin(np.arange(50) / 9))
    compensator.predict(3.0 + np.sin(np.arange(50) / 9), m_init=1.0)


@pytest.mark.parametrize(("slope", "first"), [(0.1, 25.0), (-0.1, 75.0)])
def test_a_model_that_rests_anywhere_begins_with_an_input_recorded_near_the_first_reference(slope, first):
    model = resting_model(slope, {"u": (0.0, 50.0, 100.0), "y": (0.0, 6.0, 10.0)})
    fitted = RootCompensator(model).fit()
    assert fitted.predict(np.full(4, 3.0)).tolist() == [first] * 4  # half way from the least to the mean
    inverse = NARXModel.from_equations(
        {"u[k-1]": 1.0, "phi1[k]": 1 / slope},
        outputs=["u"],
        inputs=["y"],
        phi=[Difference("y")],
        recorded=model.recorded,
    )
    assert InverseCompensator(inverse).fit().predict(np.full(4, 3.0)).tolist() == [first] * 4


def test_a_model_keeps_the_law_within_the_input_that_was_recorded():
    model = resting_model(0.1, {"u": (0.0, 50.0, 100.0), "y": (0.0, 6.0, 10.0)})
    r = np.r_[np.full(5, 6.0), np.linspace(6.0, 13.0, 50)]
    fitted = RootCompensator(model).fit()
    assert fitted.law_.limits == (0.0, 100.0)
    with pytest.warns(UnreachableWarning, match="Of 55 samples 14 had no admissible input"):
        assert fitted.predict(r).max() <= 100.0
    assert RootCompensator(model, limits=(-5.0, 500.0)).fit().law_.limits == (-5.0, 500.0)
    unknown = resting_model(0.1, {})
    assert RootCompensator(unknown).fit().law_.limits == (-np.inf, np.inf)


def test_a_reference_that_begins_beyond_what_was_recorded_is_told():
    model = resting_model(0.1, {"u": (0.0, 50.0, 100.0), "y": (0.0, 6.0, 10.0)})
    fitted = RootCompensator(model).fit()
    with pytest.warns(UnreachableWarning, match="begins at 97, beyond the recorded output, 0 to 10"):
        assert fitted.predict(np.full(4, 97.0)).tolist() == [100.0] * 4
    assert fitted.predict(np.full(4, 97.0), m_init=40.0).tolist() == [40.0] * 4


def test_a_searched_law_takes_its_range_from_the_model():
    given = {"u": (-1.0, 0.0, 2.0)}
    model = NARXModel.from_equations(
        "0.5*y[k-1] + u[k-1] + 0.1*phi1[k-1]", phi=[SmoothSign("u", width=0.1)], recorded=given
    )
    law = RootCompensator(model).fit().law_
    assert law.method == "search"
    assert law.limits == (-1.0, 2.0)
