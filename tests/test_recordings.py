"""Recordings in files: the model of the arrays, corrupt files by name, interrupted fits resumed."""

import json
import warnings

import numpy as np
import pandas as pd
import pytest
from joblib import parallel_config

from narx_sklearn import NARXRegressor, NARXRegressorCV, free_run
from narx_sklearn.exceptions import NarxWarning
from narx_sklearn.identification import Factor
from narx_sklearn.identification.free_run.many import by_session, free_run_many
from narx_sklearn.identification.free_run.scoring import free_run_score
from narx_sklearn.identification.records import record, recordings
from narx_sklearn.identification.records.record import Moments
from narx_sklearn.identification.records.recordings import Recordings
from narx_sklearn.model import AbsoluteDifference, Difference, FunctionPhi, NARXModel, Play

LENGTHS = (400, 150, 300)


def simulate(n_samples, seed):
    """Return input and output of a second-order system with noise in the equation."""
    rng = np.random.default_rng(seed)
    u, y = rng.uniform(-1, 1, n_samples), np.zeros(n_samples)
    for k in range(2, n_samples):
        y[k] = 0.5 * y[k - 1] - 0.2 * y[k - 2] + u[k - 1] + 0.3 * u[k - 2] ** 2 + 0.02 * rng.normal()
    return u, y


@pytest.fixture(scope="module")
def machines():
    return [
        pd.DataFrame(np.column_stack(simulate(n, i)), columns=["u [V]", "y [mm]"])
        for i, n in enumerate(LENGTHS)
    ]


def write(table, path):
    if path.suffix == ".npy":
        np.save(path, table.to_numpy())
    elif path.suffix == ".parquet":
        table.to_parquet(path)
    else:
        table.to_csv(path, index=False, float_format="%.17g")
    return path


@pytest.fixture
def files(machines, tmp_path):
    endings = (".csv", ".parquet", ".npy")
    return [
        write(table, tmp_path / f"machine{i}{ending}")
        for i, (table, ending) in enumerate(zip(machines, endings, strict=True))
    ]


def open_files(files, **options):
    settings = {"inputs": "u [V]", "outputs": "y [mm]", "columns": ["u [V]", "y [mm]"]} | options
    return Recordings(files, **settings)


def in_memory(machines):
    table = pd.concat(machines, ignore_index=True)
    labels = np.repeat(np.arange(len(machines)), [len(m) for m in machines])
    return table[["u [V]"]], table["y [mm]"], labels


def assert_same_model(one, other):
    assert one.terms_ == other.terms_
    np.testing.assert_allclose(one.coef_, other.coef_, rtol=0, atol=1e-10)


@pytest.mark.parametrize("chunk", [60, 1 << 18], ids=["small blocks", "one block a file"])
@pytest.mark.parametrize("refine", [False, "auto"])
def test_files_of_three_kinds_give_the_model_of_the_arrays(machines, files, monkeypatch, chunk, refine):
    monkeypatch.setattr(recordings, "CHUNK_ROWS", chunk)
    settings = {"output_lags": 3, "input_lags": 3, "refine": refine}
    ours = NARXRegressor(**settings).fit(open_files(files))
    plain = NARXRegressor(**settings).fit(*in_memory(machines))
    assert_same_model(ours, plain)
    assert ours.model_.units == {"u": "V", "y": "mm"}
    np.testing.assert_allclose(ours.summary()["low"], plain.summary()["low"], rtol=1e-8)


@pytest.mark.filterwarnings("ignore:The best choice has")  # the lags of the record are the most tried
def test_the_search_over_lags_judges_files_as_it_does_arrays(machines, files):
    grid = {"output_lags": (1, 2), "input_lags": (2,), "degree": (1, 2), "max_terms": 5, "refine": False}
    ours = NARXRegressorCV(**grid).fit(open_files(files))
    plain = NARXRegressorCV(**grid).fit(*in_memory(machines))
    assert ours.best_params_ == plain.best_params_
    np.testing.assert_allclose(
        ours.cv_results_["mean_test_score"], plain.cv_results_["mean_test_score"], atol=1e-9
    )


def test_phi_regressors_that_remember_their_session_read_whole_files(machines, files, monkeypatch):
    monkeypatch.setattr(recordings, "CHUNK_ROWS", 60)
    settings = {"phi": [Play("u", radius=0.5)], "refine": False, "n_terms": 4}
    assert_same_model(
        NARXRegressor(**settings).fit(open_files(files)), NARXRegressor(**settings).fit(*in_memory(machines))
    )


def test_a_column_of_labels_begins_sessions_inside_a_file(machines, tmp_path):
    X, y, labels = in_memory(machines)
    path = tmp_path / "all.csv"
    X.assign(y=y, machine=labels).to_csv(path, index=False, float_format="%.17g")
    ours = NARXRegressor(2, 2, refine=False).fit(
        Recordings(path, inputs="u [V]", outputs="y", session="machine")
    )
    assert_same_model(ours, NARXRegressor(2, 2, refine=False).fit(X, y, labels))


def test_the_number_of_jobs_changes_no_bit(files):
    def parameters(n_jobs):
        with parallel_config(backend="threading"):
            opened = open_files(files, n_jobs=n_jobs)
            return NARXRegressor(2, 2, refine=False).fit(opened).coef_.tobytes()

    assert parameters(1) == parameters(2)


def corrupt(files, how):
    path = files[1] if how == "parquet cut short" else files[2] if how == "npy cut short" else files[0]
    data = path.read_bytes()
    if how == "csv cut in its last line":
        path.write_bytes(data[: data.rindex(b",")])
    elif how == "csv with a word":
        path.write_bytes(data.replace(b"\n", b"\noops,1.0\n", 2))
    elif how == "infinite value":
        path.write_bytes(data + b"inf,1.0\n")
    elif how == "no samples":
        path.write_bytes(data[: data.index(b"\n") + 1])
    elif how == "other columns":
        path.write_bytes(data.replace(b"u [V]", b"volts"))
    elif how == "empty file":
        path.write_bytes(b"")
    elif how == "not there":
        path.unlink()
    else:
        path.write_bytes(data[: len(data) // 2])
    return path


@pytest.mark.parametrize(
    "how",
    [
        "csv cut in its last line", "csv with a word", "infinite value", "no samples", "other columns",
        "empty file", "not there", "parquet cut short", "npy cut short",
    ],
)  # fmt: skip
def test_a_corrupt_file_is_named_and_refused_or_left_out_as_a_whole(machines, files, how):
    path = corrupt(files, how)
    with pytest.raises(ValueError, match=path.name):
        NARXRegressor(2, 2, refine=False).fit(open_files(files))
    skipping = open_files(files, errors="skip")
    with pytest.warns(NarxWarning, match=f"{path.name} is left out"):
        ours = NARXRegressor(2, 2, refine=False).fit(skipping)
    assert list(skipping.skipped) == [str(path)]
    rest = [m for m, file in zip(machines, files, strict=True) if file != path]
    assert_same_model(ours, NARXRegressor(2, 2, refine=False).fit(*in_memory(rest)))


def test_nothing_left_is_an_error_even_where_corrupt_files_are_skipped(files):
    for file in files:
        file.write_bytes(b"")
    with pytest.raises(ValueError, match="None of the 3 files"):
        NARXRegressor(refine=False).fit(open_files(files, errors="skip"))


def test_a_file_that_changes_during_a_fit_is_named(files):
    opened = open_files(files)
    assert opened.n_samples == sum(LENGTHS)
    files[2].write_bytes(files[2].read_bytes() + b" ")
    with pytest.raises(RuntimeError, match=r"machine2\.npy has changed"):
        NARXRegressor(refine=False).fit(opened)


@pytest.mark.parametrize(
    ("change", "error", "match"),
    [
        ({"files": "nowhere/*.csv"}, ValueError, "No file matches"),
        ({"files": []}, ValueError, "files is empty"),
        ({"files": {"a": "b.csv"}}, TypeError, "got a mapping"),
        ({"files": "data.xls"}, ValueError, "no ending of"),
        ({"files": "a.csv", "errors": "ignore"}, ValueError, "errors='ignore'"),
    ],
)
def test_wrong_arguments_are_refused(change, error, match):
    with pytest.raises(error, match=match):
        Recordings(**({"inputs": "u", "outputs": "y"} | change))


def test_outputs_beside_recordings_are_refused(files):
    with pytest.raises(ValueError, match="y and sessions must be left out"):
        NARXRegressor().fit(open_files(files), np.zeros(3))


def test_a_refinement_too_long_to_start_unasked_is_left_out_and_said(files, monkeypatch):
    monkeypatch.setattr("narx_sklearn.identification.free_run.free_run_fit.GATHERED_SAMPLES", 100)
    with pytest.warns(NarxWarning, match="n_samples = 850 are more than the 100"):
        narx = NARXRegressor(2, 2).fit(open_files(files))
    assert narx.refinement_ is None
    assert NARXRegressor(2, 2, refine=True).fit(open_files(files)).refinement_ is not None


# -- saved factors ------------------------------------------------------------------------------------------


def test_a_saved_factor_comes_back_bit_by_bit(tmp_path):
    factor = Factor.of(np.random.default_rng(0).normal(size=(30, 4)), np.ones(30))
    factor.save(tmp_path / "factor.npz", {"terms": ["u[k-1]"], "origin": (0.1, 0.2)})
    loaded = Factor.load(tmp_path / "factor.npz", {"origin": [0.1, 0.2], "terms": ["u[k-1]"]})
    assert loaded.R.tobytes() == factor.R.tobytes()
    assert (loaded.n_outputs, loaded.n_samples) == (1, 30)
    assert [path.name for path in tmp_path.iterdir()] == ["factor.npz"]


def test_a_factor_of_other_settings_is_refused_and_they_are_named(tmp_path):
    factor = Factor.of(np.ones((3, 1)), np.ones(3))
    factor.save(tmp_path / "factor.npz", {"terms": ["u[k-1]"], "origin": 0.0})
    with pytest.raises(ValueError, match=r"terms was \['u\[k-1\]'\], is \['u\[k-2\]'\]"):
        Factor.load(tmp_path / "factor.npz", {"terms": ["u[k-2]"], "origin": 0.0})


@pytest.mark.parametrize("share", [0.0, 0.5, 0.99])
def test_half_a_factor_is_refused(tmp_path, share):
    path = tmp_path / "factor.npz"
    Factor.of(np.ones((30, 4)), np.ones(30)).save(path)
    path.write_bytes(path.read_bytes()[: int(share * path.stat().st_size)])
    with pytest.raises(ValueError, match="not a complete saved factor"):
        Factor.load(path)


def test_a_factor_of_another_format_is_refused(tmp_path):
    about = np.array(json.dumps({"format": 99, "settings": {}}))
    np.savez(tmp_path / "factor.npz", R=np.eye(2), counts=np.array([1, 1]), about=about)
    with pytest.raises(ValueError, match="format 99"):
        Factor.load(tmp_path / "factor.npz")


def test_an_interrupted_fit_goes_on_where_it_stopped(files, tmp_path, monkeypatch):
    monkeypatch.setattr(recordings, "FILES_TOGETHER", 1)
    folder = tmp_path / "checkpoint"
    settings = {"output_lags": 2, "input_lags": 2, "refine": False}
    plain = NARXRegressor(**settings).fit(open_files(files))

    read = recordings._total_of_file

    def stop_at_the_third(function, merge, table, *rest):
        if "machine2" in table.path:
            raise KeyboardInterrupt
        return read(function, merge, table, *rest)

    monkeypatch.setattr(recordings, "_total_of_file", stop_at_the_third)
    with pytest.raises(KeyboardInterrupt):
        NARXRegressor(**settings, checkpoint=folder).fit(open_files(files))
    assert len(list(folder.iterdir())) == 2

    compressed = []

    def note(function, merge, table, *rest):
        if getattr(function.func, "__name__", "") == "factor_of_block":
            compressed.append(table.path)
        return read(function, merge, table, *rest)

    monkeypatch.setattr(recordings, "_total_of_file", note)
    resumed = NARXRegressor(**settings, checkpoint=folder).fit(open_files(files))
    assert compressed == [str(files[2])]
    assert resumed.terms_ == plain.terms_
    assert resumed.coef_.tobytes() == plain.coef_.tobytes()


@pytest.mark.parametrize(
    ("change", "named"), [({"output_lags": [2, 3]}, "terms was"), ({"files": 2}, "record files was")]
)
def test_a_checkpoint_of_other_settings_is_refused(files, tmp_path, change, named):
    folder, settings = tmp_path / "checkpoint", {"output_lags": 2, "input_lags": 2, "origin": "zero"}
    NARXRegressor(**settings, refine=False, checkpoint=folder).fit(open_files(files))
    used = files[: change.pop("files", 3)]
    with pytest.raises(ValueError, match=named):
        NARXRegressor(**(settings | change), refine=False, checkpoint=folder).fit(open_files(used))


def test_arrays_in_memory_resume_too(machines, tmp_path, monkeypatch):
    monkeypatch.setattr(record, "CHUNK_ROWS", 100)
    monkeypatch.setattr(record, "GROUP_BLOCKS", 3)
    plain = NARXRegressor(2, 2, refine=False).fit(*in_memory(machines))
    for _ in range(2):
        kept = NARXRegressor(2, 2, refine=False, checkpoint=tmp_path).fit(*in_memory(machines))
        assert kept.coef_.tobytes() == plain.coef_.tobytes()


def test_a_checkpoint_knows_its_samples_and_sessions(tmp_path):
    u, y = simulate(600, 0)
    X, settings = u[:, None], {"output_lags": 2, "input_lags": 2, "refine": False, "checkpoint": tmp_path}
    NARXRegressor(**settings).fit(X, y)
    NARXRegressor(**settings).fit(X, y, np.zeros(600))  # one session, as before
    backwards = np.concatenate([y[:100], y[100:200][::-1], y[200:]])
    for data in ((X, y, np.arange(600) // 2), (X, backwards), (X[::-1], y)):
        with pytest.raises(ValueError, match="record fingerprint was"):
            NARXRegressor(**settings).fit(*data)


def test_both_origins_of_a_fit_have_a_place_in_a_checkpoint(tmp_path):
    u, y = simulate(300, 0)
    # without terms in u alone no translation leads from one origin to the other
    task = {"output_lags": 2, "input_lags": 2, "exclude": ["u"], "refine": False}
    plain = NARXRegressor(**task).fit(u[:, None] + 300.0, y)
    for _ in range(2):
        kept = NARXRegressor(**task, checkpoint=tmp_path).fit(u[:, None] + 300.0, y)
        assert kept.coef_.tobytes() == plain.coef_.tobytes()


def test_a_checkpoint_knows_a_function_by_name_and_values(tmp_path):
    u, y = simulate(300, 0)

    def fit(power):
        def shape(u):
            return np.abs(u) ** power

        phi = [FunctionPhi(shape, ["u[k]"])]
        return NARXRegressor(1, 1, phi=phi, refine=False, checkpoint=tmp_path).fit(u[:, None], y)

    assert fit(1).coef_.tobytes() == fit(1).coef_.tobytes()
    with pytest.raises(ValueError, match="scale was"):
        fit(2)


# -- streams ------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("size", [1, 2, 7, 150])
def test_batches_of_one_session_make_the_model_of_the_whole(size):
    n_samples = 60 + 20 * size if size < 10 else 300
    u, y = simulate(n_samples, 5)
    X, session = u[:, None], np.zeros(n_samples)
    settings = {"output_lags": 3, "input_lags": 3, "origin": "zero", "refine": False, "n_terms": 4}
    whole = NARXRegressor(**settings).fit(X, y, session)
    stream = NARXRegressor(**settings).partial_fit(X[:60], y[:60], session[:60])
    for begin in range(60, n_samples, size):
        part = slice(begin, begin + size)
        stream.partial_fit(X[part], y[part], session[part])
    assert_same_model(stream, whole)


def test_a_stream_that_forgets_follows_a_change():
    (u, y), rng = simulate(800, 1), np.random.default_rng(2)
    v, z = rng.uniform(-1, 1, 800), np.zeros(800)
    for k in range(1, 800):
        z[k] = 0.8 * z[k - 1] + v[k - 1] + 0.02 * rng.normal()
    stream = NARXRegressor(1, 1, degree=1, forgetting=0.1, fit_intercept=False)
    for X, target in ((u, y), (v[:400], z[:400]), (v[400:], z[400:])):
        stream.partial_fit(X[:, None], target)
    np.testing.assert_allclose(stream.coef_, [0.8, 1.0], atol=0.01)


def test_intervals_of_a_stream_are_those_of_all_it_saw():
    u, y = simulate(6000, 3)
    X, batch = u[:, None], np.arange(6000) // 300
    settings = {"output_lags": 2, "input_lags": 2, "origin": "zero", "refine": False, "n_terms": 4}
    stream = NARXRegressor(**settings)
    for b in range(20):
        stream.partial_fit(X[batch == b], y[batch == b])
        if b == 0:
            first = NARXRegressor(**settings).fit(X[:300], y[:300])
            np.testing.assert_allclose(stream.confidence_intervals(), first.confidence_intervals(), rtol=1e-9)
    whole = NARXRegressor(**settings).fit(X, y, batch)
    assert_same_model(stream, whole)
    np.testing.assert_allclose(stream.sigma_, whole.sigma_, rtol=1e-9)
    ours, plain = (narx.uncertainty_[0].standard_errors for narx in (stream, whole))
    assert 0.8 < np.sqrt(np.mean((ours / plain) ** 2)) < 1.25  # of twelve stretches, cut in other places


def test_intervals_of_a_stream_that_forgets_are_as_wide_as_what_it_remembers():
    u, y = simulate(6000, 3)
    settings = {"output_lags": 2, "input_lags": 2, "origin": "zero", "refine": False, "n_terms": 4}
    widths = []
    for forgetting in (1.0, 0.5):
        stream = NARXRegressor(**settings, forgetting=forgetting)
        for part in np.split(np.arange(6000), 40):
            stream.partial_fit(u[part, None], y[part])
        widths.append(float(np.diff(stream.confidence_intervals()).mean()))
    # sum of weights squared over sum of squared weights: 3 batches of 40
    assert widths[1] / widths[0] == pytest.approx(np.sqrt(40 / 3), rel=0.4)


def test_a_stream_of_single_samples_counts_what_forgetting_leaves():
    u, y = simulate(400, 0)
    session = np.zeros(400)
    stream = NARXRegressor(1, 1, degree=1, origin="zero", forgetting=0.98)
    stream.partial_fit(u[:101, None], y[:101], session[:101])
    for k in range(101, 400):
        stream.partial_fit(u[k : k + 1, None], y[k : k + 1], session[k : k + 1])
    left = 0.98**299
    assert stream.path_.n_samples == round(100 * left + (1 - left) / 0.02)


def test_fit_forgets_the_batches_before_it():
    (u, y), (v, z) = simulate(200, 0), simulate(200, 1)
    narx = NARXRegressor(2, 2, refine=False).partial_fit(u[:, None], 5.0 * y)
    narx.fit(u[:, None], y).partial_fit(v[:, None], z)
    alone = NARXRegressor(2, 2, refine=False).partial_fit(v[:, None], z)
    np.testing.assert_array_equal(narx.coef_, alone.coef_)


@pytest.mark.parametrize(
    ("change", "other"),
    [
        ({"degree": 3}, "candidate terms"),
        ({"phi": [AbsoluteDifference("u")]}, "phi"),
        ({"names": "v"}, "inputs"),
        ({"outputs": 2}, "outputs"),
    ],
)
def test_a_batch_of_another_problem_is_refused_and_does_not_count(change, other):
    u, y = simulate(400, 0)
    X = u[:, None]
    stream = NARXRegressor(2, 2, phi=[Difference("u")], refine=False).partial_fit(X[:200], y[:200])
    before = stream.coef_
    rest = X[200:], y[200:]
    if "names" in change:
        rest = pd.DataFrame(rest[0], columns=["v"]), rest[1]
        stream.set_params(phi=[Difference("v")])
    elif "outputs" in change:
        rest = rest[0], np.column_stack([y, y])[200:]
    else:
        stream.set_params(**change)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # scikit-learn's, of names that were not there before
        with pytest.raises(ValueError, match=f"other {other} than the batches before"):
            stream.partial_fit(*rest)
    np.testing.assert_array_equal(stream.coef_, before)
    stream.set_params(degree=2, phi=[Difference("u")]).partial_fit(X[200:], y[200:])
    twice = NARXRegressor(2, 2, phi=[Difference("u")], refine=False)
    twice.partial_fit(X[:200], y[:200]).partial_fit(X[200:], y[200:])
    np.testing.assert_array_equal(stream.coef_, twice.coef_)


def test_forgetting_that_is_no_number_is_refused_for_streams():
    u, y = simulate(100, 0)
    for wrong in ("variable", 0.0, 1.5, None):
        with pytest.raises(ValueError, match="forgetting"):
            NARXRegressor(forgetting=wrong).partial_fit(u[:, None], y)


# -- many recordings ----------------------------------------------------------------------------------------


def test_moments_of_parts_merge_to_those_of_the_whole():
    data = np.random.default_rng(0).normal(3.0, 2.0, size=(50, 2))
    data[4, 0] = np.nan
    total = Moments.none(2)
    for part in (data[:7], data[7:8], data[8:]):
        total = total.merge(Moments.of(part[:, 1:], part[:, :1]))
    np.testing.assert_allclose(total.mean, np.nanmean(data, axis=0))
    np.testing.assert_allclose(total.deviation, np.nanstd(data, axis=0))
    np.testing.assert_array_equal([total.low, total.high], [np.nanmin(data, 0), np.nanmax(data, 0)])


MODEL = NARXModel.from_equations("0.5*y[k-1] + u[k-1]")


def test_free_runs_over_many_recordings_are_the_single_runs(files):
    with parallel_config(backend="threading"):
        found = free_run_many(MODEL, open_files(files).by_file(), n_jobs=2)
    for path, (X, y) in open_files(files).by_file().items():
        run = free_run(MODEL, X, y)
        np.testing.assert_array_equal(found.runs[path].y, run.y)
        row = found.table.set_index("recording").loc[path]
        np.testing.assert_allclose(row["rmse"], np.sqrt(np.mean((y - run.y[:, 0])[1:] ** 2)))
        assert row["stopped_at"] == -1


def test_what_is_not_simulated_is_not_judged():
    rng = np.random.default_rng(0)
    X, y = rng.normal(size=(300, 1)), rng.normal(size=300)
    X[100:200] = np.nan
    y[50] = np.nan
    row = free_run_many(MODEL, [(X, y)]).table.iloc[0]
    run = free_run(MODEL, X, y).y[:, 0]
    # sample 0, and sample 200 after the gap, are where the runs start from
    judged = np.setdiff1d(np.r_[1:100, 201:300], [50])
    assert row["n_samples"] == judged.size
    np.testing.assert_allclose(row["rmse"], np.sqrt(np.mean((y - run)[judged] ** 2)))
    np.testing.assert_allclose(row["r2"], 1 - np.mean((y - run)[judged] ** 2) / y[judged].var())
    np.testing.assert_allclose(free_run_score(MODEL, X, y), row["r2"])


def test_a_divergent_recording_is_told_by_its_sample():
    grows = NARXModel.from_equations("y[k-1]^2 + u[k-1]")
    table = free_run_many(grows, [(np.full((50, 1), 9.0), np.zeros(50))]).table
    assert 0 < table["stopped_at"][0] < 50


def test_recordings_that_do_not_fit_are_named():
    with pytest.raises(ValueError, match="Recording 'second'"):
        free_run_many(
            MODEL, {"first": (np.zeros((9, 1)), np.zeros(9)), "second": (np.zeros((9, 2)), np.zeros(9))}
        )
    with pytest.raises(ValueError, match="recordings is empty"):
        free_run_many(MODEL, [])
    with pytest.raises(TypeError, match="must be a pair"):
        free_run_many(MODEL, [np.zeros(3)])
    with pytest.raises(TypeError, match="must be a mapping"):
        free_run_many(MODEL, "all")


def test_a_session_that_comes_back_is_refused():
    with pytest.raises(ValueError, match="'a' comes back at sample 2"):
        by_session(np.zeros((3, 1)), np.zeros(3), ["a", "b", "a"])


@pytest.mark.parametrize(("mark", "called"), [(";", "semicolons"), ("\t", "tabs")])
def test_other_separators_than_commas_are_named(tmp_path, mark, called):
    path = tmp_path / "other.csv"
    pd.DataFrame({"u [V]": [0.5, 1.5, 2.5], "y [m]": [1.0, 2.0, 3.0]}).to_csv(path, sep=mark, index=False)
    recordings = Recordings(path, inputs="u [V]", outputs="y [m]")
    with pytest.raises(ValueError, match=f"columns are separated by {called}, and commas are read here"):
        NARXRegressor(refine=False).fit(recordings)


def test_a_column_that_a_text_file_lacks_is_named_with_those_it_has(tmp_path):
    path = tmp_path / "record.csv"
    pd.DataFrame({"u": [0.5, 1.5, 2.5], "y": [1.0, 2.0, 3.0]}).to_csv(path, index=False)
    with pytest.raises(ValueError, match=r"it lacks the columns \['z'\]; it has \['u', 'y'\]"):
        NARXRegressor(refine=False).fit(Recordings(path, inputs="u", outputs="z"))
