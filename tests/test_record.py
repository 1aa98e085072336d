"""A record against its simulator: which column is which, in which unit, at what times; whether it will do."""

from contextlib import redirect_stderr
from io import StringIO

import numpy as np
import pandas as pd
import pytest

from narx_sklearn import DiscrepancyRegressor, ODESimulator
from narx_sklearn.discrepancy.records.record import label_findings, read_inputs, read_outputs, read_record
from narx_sklearn.exceptions import NarxWarning
from narx_sklearn.model.units import conversion

N = 200
LABELS = ["position [m]", "current [A]"]


def motor(x, u, p):
    return x[1], p[0] * x[2] - p[1] * x[1] - 4.0 * x[0], p[2] * (u[0] - x[2]) - x[1]


SIM = ODESimulator(
    motor,
    dt=0.05,
    parameters={"force [m/s^2/A]": 2.0, "damping [1/s]": 0.8, "pace [1/s]": 6.0},
    states=["position [m]", "velocity [m/s]", "current [A]"],
    inputs=["drive [V]"],
    outputs=LABELS,
)
RNG = np.random.default_rng(0)
U = np.repeat(RNG.normal(size=N // 5), 5)[:, None]
Y = SIM.simulate(U) + 1e-3 * RNG.normal(size=(N, 2))
X_FRAME = pd.DataFrame(U, columns=["drive [V]"])
Y_FRAME = pd.DataFrame(Y, columns=LABELS)


def fit(X, y, simulator=SIM, **settings):
    return DiscrepancyRegressor(simulator, effects=["cubic_stiffness"], **settings).fit(X, y)


@pytest.fixture(scope="module")
def fitted():
    """A diagnosis of the frames, and what it wrote on the way."""
    return told_while(X_FRAME, Y_FRAME)


@pytest.fixture(scope="module")
def swapped():
    """The same of outputs in another order, which was asked to tell its stages, and that frame."""
    frame = Y_FRAME.iloc[:, ::-1].assign(temperature=20.0)
    return *told_while(X_FRAME, frame, verbose=True), frame


def told_while(X, y, **settings):
    with redirect_stderr(StringIO()) as told:
        dx = fit(X, y, **settings)
    return dx, told.getvalue()


# -- which column is which ---------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "labels", [["current [A]", "position [m]"], ["current", "position"], ["current [A]", "position"]]
)
def test_outputs_are_found_by_name_in_any_order_among_others(labels):
    frame = pd.DataFrame(Y[:, ::-1], columns=labels).assign(temperature=20.0)
    assert np.array_equal(read_outputs(frame, SIM), Y)
    assert np.array_equal(read_record(X_FRAME, frame, SIM)[1], Y)


def test_a_frame_with_none_of_the_names_is_taken_in_order():
    assert np.array_equal(read_outputs(Y_FRAME.set_axis(["a", "b"], axis=1), SIM), Y)
    assert np.array_equal(read_inputs(X_FRAME.set_axis([7], axis=1), SIM), U)


def test_a_frame_with_some_of_the_names_is_refused():
    with pytest.raises(ValueError, match=r"y lacks the columns \['current \[A\]'\]; it has .*Rename"):
        read_outputs(Y_FRAME.rename(columns={"current [A]": "i [A]"}), SIM)


def test_a_signal_of_a_twin_is_found_under_the_name_that_it_was_made_from():
    y_sim = pd.DataFrame(Y, columns=["motor angle [rad]", "motor current [A]"])
    sim = SIM.with_parameters(SIM.nominal)
    sim.outputs = tuple(type(s)(s.name.replace(" ", "_"), s.unit) for s in sim.outputs)
    sim.outputs = (
        sim.outputs[0]._replace(name="motor_angle", unit="rad"),
        sim.outputs[1]._replace(name="motor_current"),
    )
    assert np.array_equal(read_outputs(y_sim.iloc[:, ::-1], sim), Y)


def test_columns_of_one_name_are_refused_unless_one_has_the_unit():
    twice = pd.concat([Y_FRAME, Y_FRAME[["position [m]"]]], axis=1)
    with pytest.raises(ValueError, match=r"y has 2 columns for the output 'position \[m\]'.*all but one"):
        read_outputs(twice, SIM)
    with_mm = pd.concat([Y_FRAME[["position [m]"]].set_axis(["position [mm]"], axis=1), Y_FRAME], axis=1)
    assert np.array_equal(read_outputs(with_mm, SIM), Y)
    with pytest.raises(ValueError, match="X has 2 columns for the input"):
        SIM.simulate(pd.concat([X_FRAME, X_FRAME], axis=1))


def test_a_diagnosis_of_outputs_in_another_order_is_the_same(fitted, swapped):
    dx, _ = fitted
    again, _, frame = swapped
    assert again.verdict_ == dx.verdict_
    assert again.parameters_.equals(dx.parameters_)
    assert dx.score(X_FRAME, frame) == dx.score(U, Y)
    assert np.array_equal(dx.predict(X_FRAME, y_init=frame[:20]), dx.predict(U, y_init=Y[:20]))


# -- units -------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("label", "words"),
    [("drive [mV]", "times 0.001"), ("drive [kV]", "times 1000"), ("voltage [mV]", "times 0.001")],
)
def test_a_label_in_another_unit_is_refused_with_the_factor(label, words):
    with pytest.raises(ValueError, match=rf"X's column .* is in another unit .*{words}\. Convert"):
        read_inputs(X_FRAME.set_axis([label], axis=1), SIM)


def test_a_series_in_another_unit_is_refused_too():
    sim = ODESimulator(
        motor,
        dt=0.05,
        parameters={"a": 1.0, "b": 1.0, "c": 1.0},
        states=[s.name for s in SIM.states],
        inputs=["drive"],
        outputs=["position [m]"],
    )
    with pytest.raises(ValueError, match=r"times 0\.001"):
        read_outputs(pd.Series(Y[:, 0], name="position [mm]"), sim)
    assert read_outputs(pd.Series(Y[:, 0], name="position"), sim).shape == (N, 1)


def test_units_that_are_not_known_to_be_the_same_are_told():
    (found,) = label_findings(X_FRAME.set_axis(["drive [A]"], axis=1), Y_FRAME, SIM)
    assert found.code == "units"
    assert "'drive [A]' states another unit than the simulator's input 'drive [V]'" in found.sentence
    assert label_findings(X_FRAME, Y_FRAME, SIM) == []


@pytest.mark.parametrize(
    ("given", "wanted", "factor", "offset"),
    [
        ("mm", "m", 1e-3, 0.0),
        ("m/s2", "m/s^2", 1.0, 0.0),
        ("m/s²", "m/s/s", 1.0, 0.0),
        ("rpm", "rad/s", np.pi / 30, 0.0),
        ("deg", "rad", np.pi / 180, 0.0),
        ("1/s", "rad/s", 1.0, 0.0),
        ("1/min", "rpm", 1.0, 0.0),
        ("N m", "Nm", 1.0, 0.0),
        ("l/min", "m^3/s", 1e-3 / 60, 0.0),
        ("bar", "Pa", 1e5, 0.0),
        ("%", "-", 0.01, 0.0),
        ("degC", "K", 1.0, 273.15),
        ("degF", "degC", 5 / 9, -160 / 9),
    ],
)
def test_what_a_unit_is_worth_in_another(given, wanted, factor, offset):
    there, back = conversion(given, wanted), conversion(wanted, given)
    assert np.allclose(there, (factor, offset), rtol=1e-9)
    assert np.isclose(there.factor * back.factor, 1.0)


@pytest.mark.parametrize(
    ("given", "wanted"), [("A", "V"), ("rpm", "Hz"), ("counts", "m"), ("m", "min"), ("Volt", "V")]
)
def test_units_that_have_nothing_to_do_with_each_other_have_no_factor(given, wanted):
    assert conversion(given, wanted) is None


# -- times -------------------------------------------------------------------------------------------------


def timed(frame, step="50ms", **to):
    return frame.set_axis(pd.date_range("2024-01-01", periods=len(frame), freq=step, **to))


@pytest.mark.parametrize(
    "index",
    [
        pd.date_range("2024-01-01", periods=N, freq="10ms", tz="UTC"),
        pd.timedelta_range("0s", periods=N, freq="10ms"),
        pd.Index(0.01 * np.arange(N), name="time [s]"),
    ],
)
def test_a_step_of_the_index_that_is_not_dt_is_told_with_both(index):
    (found,) = label_findings(X_FRAME.set_axis(index), Y_FRAME.set_axis(index), SIM)
    assert found.code == "time_scale"
    assert found.evidence == {"step": pytest.approx(0.01), "dt": 0.05}
    assert "0.01 s from row to row" in found.sentence
    assert "dt=0.05 s" in found.sentence


def test_an_index_with_the_simulators_step_or_without_times_says_nothing():
    assert label_findings(timed(X_FRAME), timed(Y_FRAME), SIM) == []
    assert label_findings(X_FRAME.set_axis(3.0 * np.arange(N)), Y, SIM) == []


def test_a_step_that_is_not_dt_is_told_of_new_inputs_too(fitted):
    dx, _ = fitted
    with pytest.warns(NarxWarning, match=r"advances by 0\.01 s from row to row"):
        dx.predict(timed(X_FRAME, "10ms"))
    with pytest.warns(NarxWarning, match=r"Pass dt=0\.01"):
        dx.score(timed(X_FRAME, "10ms"), Y)


def test_time_that_goes_back_is_refused_but_between_sessions():
    again = X_FRAME.set_axis(timed(X_FRAME[: N // 2]).index.append(timed(X_FRAME[N // 2 :]).index))
    with pytest.raises(ValueError, match=rf"time index of X goes back at row {N // 2}.*sessions"):
        label_findings(again, Y, SIM)
    assert label_findings(again, Y, SIM, np.repeat([0, 1], N // 2)) == []
    with pytest.raises(ValueError, match="goes back at row 1"):
        label_findings(timed(X_FRAME)[::-1], Y, SIM)


def test_rows_with_the_same_labels_in_another_order_are_refused():
    with pytest.raises(ValueError, match=r"same row labels in another order \(row 0 is 0 in X.*y\.loc"):
        read_record(X_FRAME, Y_FRAME[::-1], SIM)


def test_rows_of_other_times_are_refused():
    late = Y_FRAME.set_axis(timed(Y_FRAME).index + pd.Timedelta("1s"))
    with pytest.raises(ValueError, match=r"different row labels \(row 0 is 2024-01-01 00:00:00 in X"):
        read_record(timed(X_FRAME), late, SIM)


def test_labels_of_several_kinds_are_compared_too():
    mixed = ["first", *range(1, N)]
    read_record(X_FRAME.set_axis(mixed), Y_FRAME.set_axis(pd.Index(mixed, dtype=object)), SIM)
    with pytest.raises(ValueError, match="another order"):
        read_record(X_FRAME.set_axis(mixed), Y_FRAME.set_axis(mixed[::-1]), SIM)


def test_rows_that_are_only_numbered_are_paired_by_position():
    for X, y in ((timed(X_FRAME), Y_FRAME), (X_FRAME, timed(Y_FRAME)), (timed(X_FRAME), Y)):
        read_record(X, y, SIM)
    seconds = np.arange(N) * 0.1
    read_record(X_FRAME.set_axis(seconds), Y_FRAME.set_axis(np.cumsum(np.full(N, 0.1)) - 0.1), SIM)


# -- whether it will do ------------------------------------------------------------------------------------


def test_inputs_that_are_missing_throughout_are_named():
    with pytest.raises(ValueError, match=r"X is NaN at every sample of \['drive \[V\]'\]"):
        fit(np.full((N, 1), np.nan), Y)


@pytest.mark.parametrize("n", [1, 16, 19])
def test_a_record_too_short_is_refused_with_the_samples_wanted(n):
    with pytest.raises(ValueError, match=rf"has {n} samples, and .* takes at least 20\."):
        fit(U[:n], Y[:n])


@pytest.mark.filterwarnings("ignore")
def test_a_record_with_the_samples_wanted_is_diagnosed():
    assert fit(U[:20], Y[:20]).verdict_


def test_gaps_and_missing_values_count_in_what_is_wanted():
    u, y = U[:120].copy(), Y[:120].copy()
    u[10::12] = np.nan
    with pytest.raises(ValueError, match="longest stretch without gaps in X has 11 samples"):
        fit(u, y)
    y[5:] = np.nan
    with pytest.raises(
        ValueError, match=r"y has 10 measured values .*takes at least 20\. The others are NaN"
    ):
        fit(U[:120], y)


@pytest.mark.parametrize(("size", "word"), [(1e-200, "small"), (1e200, "large")])
def test_values_whose_squares_are_no_numbers_are_refused(size, word):
    with pytest.raises(ValueError, match=rf"y's column for 'position \[m\]' .* too {word} to square"):
        fit(U, size * Y)
    with pytest.raises(ValueError, match=rf"X's column .* too {word} to square"):
        fit(size * U, Y)
    read_record(1e-70 * U, 1e70 * Y, SIM)


def test_first_outputs_of_which_none_is_measured_are_refused(fitted):
    dx, _ = fitted
    with pytest.raises(ValueError, match=r"y_init is NaN in all of its 9 samples.* Pass measured outputs"):
        dx.predict(U, y_init=np.full((9, 2), np.nan))
    with pytest.raises(ValueError, match="y_init has 1 columns"):
        dx.predict(U, y_init=np.zeros(9))


def test_a_simulation_in_steps_too_long_for_it_is_told_how_many_it_takes():
    def stiff(x, u, p):
        return p[1] * (u[0] - x[0]), p[0] * (x[0] - x[1])

    about = {"dt": 0.05, "states": ["i [A]", "w [rad/s]"], "inputs": ["u [V]"], "outputs": ["w [rad/s]"]}
    sim = ODESimulator(stiff, parameters={"slow": 2.0, "fast": 200.0}, **about)
    y = ODESimulator(stiff, parameters={"slow": 2.0, "fast": 200.0}, substeps=8, **about).simulate(U)
    with pytest.raises(ValueError, match=r"diverges.*equations are stiff.*Pass substeps=7 to"):
        fit(U, y, sim)
    with pytest.raises(ValueError, match=r"grows e-fold .* dt=0\.05\.$"):  # finer steps are no help there
        fit(U, y, sim.with_parameters([2.0, -200.0]))


def test_a_function_that_is_not_finite_anywhere_is_told():
    about = {"dt": 0.05, "states": ["i [A]", "w [rad/s]"], "inputs": ["u [V]"], "outputs": ["w [rad/s]"]}
    sim = ODESimulator(lambda x, u, p: (p[0] * (u[0] - x[0]), np.nan * x[1]), parameters={"a": 2.0}, **about)
    with pytest.raises(ValueError, match="Wherever it begins, its function returns NaN or inf at once"):
        fit(U, Y[:, 1], sim)


def test_a_simulation_that_depends_on_nothing_given_is_refused():
    about = {"dt": 0.05, "states": ["i [A]", "w [rad/s]"], "inputs": ["u [V]"], "outputs": ["w [rad/s]"]}
    sim = ODESimulator(lambda x, u, p: (-x[0], x[0] - x[1]), parameters={"a": 2.0}, **about)
    with pytest.raises(ValueError, match=r"inputs \['u \[V\]'\] and none of the parameters \['a'\] changes"):
        fit(U, Y[:, 1], sim)
    taken = ODESimulator(lambda x, u, p: (p[0] * u[0] - x[0], x[0] - x[1]), parameters={"a": 0.0}, **about)
    y = taken.with_parameters([0.5]).simulate(U)[:, 0] + Y[:, 1] - SIM.simulate(U)[:, 1]
    fit(U, y, taken)  # with a gain of zero the input does nothing yet


# -- settings and progress ---------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("settings", "error", "words"),
    [
        ({"effects": None}, TypeError, "effects must be 'catalogue', or a list .*got None"),
        ({"exclude": None}, TypeError, "exclude must be a list of codes, .*got None"),
        ({"exclude": "gravity"}, TypeError, r"got the text 'gravity'. Pass \['gravity'\]"),
        ({"alpha": "a"}, TypeError, "alpha must be a number between 0 and 1, got 'a'"),
        ({"level": None}, TypeError, "level must be a number"),
        ({"test_fraction": "x"}, TypeError, "test_fraction must be a number"),
        ({"n_jobs": "a"}, TypeError, "n_jobs counts threads"),
        ({"n_jobs": 0}, ValueError, "n_jobs counts threads and cannot be 0"),
        ({"max_effects": True}, TypeError, "max_effects must be an integer of at least 1, got True"),
        ({"verbose": -1}, ValueError, "verbose must be an integer of at least 0, got -1"),
        ({"verbose": "yes"}, TypeError, "verbose must be an integer of at least 0, got 'yes'"),
    ],
)
def test_settings_of_a_wrong_kind_are_refused(settings, error, words):
    with pytest.raises(error, match=words):
        DiscrepancyRegressor(SIM, **settings).fit(U, Y)


def test_stages_are_told_a_line_each_where_there_is_no_terminal(fitted, swapped):
    dx, told, _ = swapped
    told = told.splitlines()
    assert told[0] == "[narx_sklearn] check of the record"
    assert "[narx_sklearn] location" in told
    assert not hasattr(dx, "_show")  # nothing of the bar stays in what may be pickled
    _, told_unasked = fitted
    assert told_unasked == ""
