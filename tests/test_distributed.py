"""Fits on dask collections: the model of the arrays, whatever becomes of partitions and workers."""

import os
import runpy
import signal
import subprocess
import sys
import threading
import time

import numpy as np
import pandas as pd
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from narx_sklearn import NARXRegressor, NARXRegressorCV
from narx_sklearn.identification.cross_validation.folds import Fold, runs_of, split_in_runs
from narx_sklearn.identification.one_step.compression import (
    screened_library,
    screened_on_factor,
    total_factor,
)
from narx_sklearn.identification.records import record
from narx_sklearn.identification.records.record import ArrayRecord
from narx_sklearn.model import DifferenceSign, Play, TermLibrary
from narx_sklearn.model.recording import Layout

dask = pytest.importorskip("dask")
da = pytest.importorskip("dask.array")
dd = pytest.importorskip("dask.dataframe")

N_SAMPLES = 240


@pytest.fixture(autouse=True)
def in_this_thread():
    """Compute without a pool of threads, unless a test brings its own scheduler."""
    with dask.config.set(scheduler="synchronous"):
        yield


def make_record(n_samples=N_SAMPLES, seed=0):
    """Return inputs and output of a second-order system, with a gap and three sessions of unequal length."""
    rng = np.random.default_rng(seed)
    X, y = rng.uniform(-1, 1, size=(n_samples, 2)), np.zeros(n_samples)
    for k in range(2, n_samples):
        y[k] = 0.5 * y[k - 1] - 0.2 * y[k - 2] + X[k - 1, 0] + 0.3 * X[k - 2, 1] * X[k - 1, 0]
    y += 0.02 * rng.normal(size=n_samples)
    y[n_samples // 2] = np.nan
    X[n_samples // 5, 1] = np.nan
    return X, y, np.repeat([3, 1, 2], [n_samples // 4, n_samples // 2, n_samples - 3 * (n_samples // 4)])


RECORD = make_record()
SETTINGS = {"output_lags": 3, "input_lags": [1, 4], "max_terms": 6, "refine": False, "search": "floating"}
IN_MEMORY = NARXRegressor(**SETTINGS).fit(*RECORD)


def chunked(data, sizes):
    return da.from_array(data, chunks=(tuple(sizes), *data.shape[1:]))


def assert_same_model(one, other):
    assert one.terms_ == other.terms_
    np.testing.assert_allclose(one.coef_, other.coef_, rtol=0, atol=1e-10)


@st.composite
def partitionings(draw):
    """Draw sizes of partitions that add up to the record, some of them shorter than the lags or empty."""
    cuts = draw(
        st.lists(st.tuples(st.integers(0, N_SAMPLES), st.lists(st.integers(0, 3), max_size=4)), max_size=5)
    )
    edges = {first + int(step) for first, steps in cuts for step in np.cumsum([0, *steps])}
    edges = sorted(edge for edge in edges if edge <= N_SAMPLES)
    repeated = draw(st.lists(st.sampled_from(edges), max_size=2)) if edges else []
    return np.diff([0, *sorted([*edges, *repeated]), N_SAMPLES]).tolist()


@settings(max_examples=12)
@example([1] * 12 + [N_SAMPLES - 12])
@example([N_SAMPLES])
@example([0, 60, 0, 0, 180, 0])
@given(partitionings())
def test_no_partitioning_changes_the_model(sizes):
    ours = NARXRegressor(**SETTINGS).fit(*(chunked(data, sizes) for data in RECORD))
    assert_same_model(ours, IN_MEMORY)
    assert ours.path_.n_samples == IN_MEMORY.path_.n_samples
    np.testing.assert_allclose(ours.summary()["low"], IN_MEMORY.summary()["low"], rtol=1e-8)


@pytest.mark.filterwarnings("ignore:The best choice has")  # the lags of the record are the most tried
@settings(max_examples=4)
@given(partitionings())
def test_no_partitioning_changes_the_search_over_lags(sizes):
    grid = {"output_lags": (1, 3), "input_lags": (2,), "degree": (1, 2), "max_terms": 4, "cv": 3}
    grid |= {"refine": False, "search": "floating"}
    plain = NARXRegressorCV(**grid).fit(*RECORD)
    ours = NARXRegressorCV(**grid).fit(*(chunked(data, sizes) for data in RECORD))
    assert ours.best_params_ == plain.best_params_
    np.testing.assert_allclose(
        ours.cv_results_["mean_test_score"], plain.cv_results_["mean_test_score"], atol=1e-9
    )
    assert_same_model(ours.best_estimator_, plain.best_estimator_)


@pytest.mark.parametrize("phi", [Play("u1", radius=0.5), DifferenceSign("u1")], ids=["play", "sign"])
def test_phi_regressors_see_the_past_of_their_session_across_partitions(phi):
    more = {"phi": [phi], "n_terms": 4, "degree": 1, "refine": False}
    plain = NARXRegressor(**more).fit(*RECORD)
    ours = NARXRegressor(**more).fit(*(chunked(d, [7] * 34 + [2]) for d in RECORD))
    assert_same_model(ours, plain)


@pytest.mark.parametrize(
    "more",
    [{"refine": "auto"}, {"refine": True, "n_terms": 4}, {"size": "free_run"}, {"estimator": "els"}],
    ids=str,
)
def test_what_reads_all_samples_gathers_them(more):
    X, y, sessions = RECORD
    X, y = np.nan_to_num(X), np.nan_to_num(y)
    plain = NARXRegressor(2, 2, **({"refine": False} | more)).fit(X, y, sessions)
    ours = NARXRegressor(2, 2, **({"refine": False} | more))
    assert_same_model(ours.fit(*(chunked(d, [100, 140]) for d in (X, y, sessions))), plain)


def test_frames_give_names_and_units_and_lengths_that_dask_does_not_know():
    X, y, sessions = RECORD
    table = pd.DataFrame(X, columns=["drive [V]", "load [N]"]).assign(**{"pos [m]": y, "run": sessions})
    frame = dd.from_pandas(table, npartitions=7)
    sides = table[["drive [V]", "load [N]"]], table["pos [m]"], table["run"]
    plain = NARXRegressor(**SETTINGS).fit(*sides)
    lazy = frame[["drive [V]", "load [N]"]], frame["pos [m]"]
    for last in (frame["run"], sessions, table["run"]):
        assert_same_model(NARXRegressor(**SETTINGS).fit(*lazy, last), plain)
    ours = NARXRegressor(**SETTINGS).fit(*lazy, sessions)
    assert ours.model_.units == {"drive": "V", "load": "N", "pos": "m"}
    assert ours.feature_names_in_.tolist() == ["drive [V]", "load [N]"]
    assert ours.predict(sides[0], sides[1]).shape == (N_SAMPLES,)


@pytest.mark.filterwarnings("ignore:The inplace keyword:DeprecationWarning")  # raised inside dask
def test_parquet_partitions_are_read_where_they_are(tmp_path):
    X, y, sessions = RECORD
    table = pd.DataFrame({"u1": X[:, 0], "u2": X[:, 1], "y": y, "run": [f"run {s}" for s in sessions]})
    dd.from_pandas(table, npartitions=4).to_parquet(tmp_path)
    frame = dd.read_parquet(tmp_path)
    assert_same_model(NARXRegressor(**SETTINGS).fit(frame[["u1", "u2"]], frame["y"], frame["run"]), IN_MEMORY)


def test_sides_in_memory_and_of_other_chunks_are_cut_alike():
    X, y, sessions = RECORD
    lazy = da.from_array(X, chunks=(50, 1))
    for target in (y, pd.Series(y), da.from_array(y, chunks=31)):
        assert_same_model(NARXRegressor(**SETTINGS).fit(lazy, target, sessions), IN_MEMORY)


def test_two_outputs_are_identified_as_in_memory():
    X, y, sessions = RECORD
    Y = np.column_stack([y, np.roll(X[:, 1], 1) + 0.1 * np.random.default_rng(1).normal(size=y.size)])
    plain = NARXRegressor(2, 2, n_terms=3, refine=False).fit(X, Y, sessions)
    ours = NARXRegressor(2, 2, n_terms=3, refine=False).fit(
        *(chunked(d, [77, 163]) for d in (X, Y, sessions))
    )
    assert_same_model(ours, plain)
    assert ours.predict(X[:9]).shape == (9, 2)


def test_a_batch_may_be_a_dask_collection():
    X, y, _ = RECORD
    batches = NARXRegressor(2, 2, refine=False, origin="zero")
    plain = NARXRegressor(2, 2, refine=False, origin="zero")
    for part in (slice(0, 100), slice(100, 240)):
        batches.partial_fit(*(da.from_array(d[part], chunks=(33, *d.shape[1:])) for d in (X, y)))
        plain.partial_fit(X[part], y[part])
    assert_same_model(batches, plain)


@pytest.mark.parametrize("constraints", [None, "y[k-1] + y[k-2] = 0.3"])
def test_large_libraries_are_screened_to_the_same_candidates(constraints, monkeypatch):
    monkeypatch.setattr("narx_sklearn.identification.one_step.compression.SCREENING_CANDIDATES", 20)
    monkeypatch.setattr("narx_sklearn.identification.one_step.compression.SCREENED_PER_TERM", 2)
    more = SETTINGS | {"constraints": constraints, "origin": "zero"}
    plain = NARXRegressor(**more).fit(*RECORD)
    ours = NARXRegressor(**more).fit(*(chunked(d, [99, 141]) for d in RECORD))
    assert ours.candidates_ == plain.candidates_
    assert len(plain.candidates_) < plain.path_.n_considered
    assert_same_model(ours, plain)


def test_screening_on_the_factor_is_screening_on_the_data():
    X, y, sessions = RECORD
    library = TermLibrary.polynomial(["y[k-1]", "y[k-2]", "u1[k-1]", "u2[k-1]", "u2[k-2]"], degree=3)
    layout = Layout.of(("y",), ("u1", "u2"), ())
    whole = ArrayRecord(X, y[:, None], sessions)
    factor = total_factor(library, layout, whole)
    for n_terms in (1, 5, 20):
        on_factor = screened_on_factor(library, layout, factor, n_terms)
        assert on_factor == screened_library(library, layout, whole, n_terms)


def test_folds_of_consecutive_samples_are_scikit_learn_s():
    from sklearn.model_selection import KFold

    X, y, _ = RECORD
    whole = ArrayRecord(X, y[:, None])
    for n_splits in (2, 3, 7):
        indices = KFold(n_splits).split(X)
        assert split_in_runs(n_splits, whole) == [Fold(runs_of(a), runs_of(b)) for a, b in indices]


@pytest.mark.parametrize(
    ("sides", "error", "match"),
    [
        (lambda X, y, s: (X, chunked(y, [240]), s), TypeError, "X is ndarray; make X one too"),
        (lambda X, y, s: (chunked(X, [240]), None, s), ValueError, "requires y"),
        (lambda X, y, s: (chunked(X, [240]), y[:9], s), ValueError, "y has 9; they must be of one length"),
        (lambda X, y, s: (chunked(X, [240]), chunked(y[:9], [9]), s), ValueError, "must be of one length"),
        (lambda X, y, s: (chunked(X[:, 0], [240]), y, s), ValueError, "two axes"),
        (lambda X, y, s: (chunked(np.where(X > 0.99, np.inf, X), [240]), y, s), ValueError, "infinity"),
        (lambda X, y, s: (chunked(X, [240]), y * np.nan, s), ValueError, "y contains NaN at every sample"),
        (lambda X, y, s: (chunked(X[:2], [1, 1]), y[:2], s[:2]), ValueError, "none can be used"),
        (lambda X, y, s: (chunked(X[:0], [0]), y[:0], s[:0]), ValueError, "holds no samples"),
    ],
)
def test_sides_that_do_not_fit_are_refused(sides, error, match):
    with pytest.raises(error, match=match):
        NARXRegressor(3, 3, refine=False).fit(*sides(*RECORD))


def test_partitions_of_unequal_lengths_are_refused_where_dask_does_not_know_them():
    X, y, _ = RECORD
    one = dd.from_pandas(pd.DataFrame(X, columns=["a", "b"]), npartitions=3)
    other = dd.from_pandas(pd.Series(y, name="y"), npartitions=4)
    with pytest.raises(ValueError, match="3 partitions and y has 4"):
        NARXRegressor(refine=False).fit(one, other)
    shifted = dd.concat([other.partitions[:2].repartition(npartitions=1), other.partitions[2:]])
    with pytest.raises(ValueError, match="A partition of X has 80 samples, and of y 120"):
        NARXRegressor(refine=False).fit(one, shifted)


def test_a_fit_on_a_cluster_resumes_from_its_checkpoint(tmp_path, monkeypatch):
    monkeypatch.setattr("narx_sklearn.identification.records.distributed.GROUP_BLOCKS", 2)
    sides = [chunked(data, [40] * 6) for data in RECORD]
    plain = NARXRegressor(**SETTINGS).fit(*sides)
    NARXRegressor(**SETTINGS, checkpoint=tmp_path).fit(*sides)
    saved = sorted(tmp_path.iterdir())
    assert len(saved) >= 3
    saved[1].unlink()
    resumed = NARXRegressor(**SETTINGS, checkpoint=tmp_path).fit(*sides)
    assert resumed.coef_.tobytes() == plain.coef_.tobytes()
    with pytest.raises(ValueError, match="record partitions was"):
        NARXRegressor(**SETTINGS, checkpoint=tmp_path).fit(*(chunked(data, [60] * 4) for data in RECORD))
    X, y, labels = RECORD
    backwards = np.concatenate([y[:50], y[50:70][::-1], y[70:]])
    others = ((X, backwards, labels), *((X, y, np.repeat([1, 2], [n, 240 - n])) for n in (120, 130)))
    for other in others:
        with pytest.raises(ValueError, match=r"record (fingerprints|sessions) was"):
            NARXRegressor(**SETTINGS, checkpoint=tmp_path).fit(*(chunked(data, [40] * 6) for data in other))


def test_without_dask_the_error_says_what_to_install(monkeypatch):
    X = chunked(RECORD[0], [240])
    monkeypatch.setitem(sys.modules, "dask", None)
    with pytest.raises(ImportError, match=r"narx-sklearn\[dask\]"):
        NARXRegressor().fit(X, RECORD[1])


# -- a cluster of processes ---------------------------------------------------------------------------------


def make_part(index, n_samples, seconds):
    """Return a stretch of the record, seeded by its place; it takes a while, as reading does."""
    time.sleep(seconds)
    rng = np.random.default_rng(index)
    u, y = rng.uniform(-1, 1, n_samples), np.zeros(n_samples)
    for k in range(1, n_samples):
        y[k] = 0.5 * y[k - 1] + u[k - 1] + 0.3 * u[k - 1] ** 2
    return np.column_stack([u, y + 0.01 * rng.normal(size=n_samples)])


def fit_parts(scheduler, seconds=0.0, n_parts=10, n_samples=400):
    make = dask.delayed(make_part, pure=True)
    parts = [make(i, n_samples, seconds) for i in range(n_parts)]
    data = da.concatenate([da.from_delayed(part, (n_samples, 2), float) for part in parts])
    with dask.config.set(scheduler=scheduler):
        return NARXRegressor(2, 2, refine=False).fit(data[:, :1], data[:, 1])


@pytest.fixture(scope="module")
def cluster_of_two():
    distributed = pytest.importorskip("distributed")
    cluster = distributed.LocalCluster(
        n_workers=2, threads_per_worker=1, processes=True, dashboard_address=":0", silence_logs=50
    )
    with cluster, distributed.Client(cluster) as client:
        yield client


def fit_while_a_worker_is_killed(client, delay):
    """Fit on the cluster, one of its processes killed by its id some time after the fit began."""
    client.wait_for_workers(2, timeout=60)
    before = set(client.run(os.getpid).values())
    victim = min(before)

    def kill():
        time.sleep(delay)
        os.kill(victim, signal.SIGKILL)

    killer = threading.Thread(target=kill)
    killer.start()
    narx = fit_parts("distributed", seconds=0.1)
    running = killer.is_alive()
    killer.join()
    assert not running, "the fit ended before the worker was killed"
    return narx


on_a_cluster = pytest.mark.filterwarnings(
    # what a killed process leaves open
    "ignore::ResourceWarning",
    "ignore::pytest.PytestUnraisableExceptionWarning",
)


@on_a_cluster
def test_the_number_of_workers_changes_no_bit(cluster_of_two):
    found = set()
    for scheduler in ("synchronous", "threads", "distributed"):
        narx = fit_parts(scheduler)
        found.add((narx.coef_.tobytes(), narx.uncertainty_[0].covariance.tobytes(), tuple(narx.terms_)))
    assert len(found) == 1


@on_a_cluster
def test_a_worker_killed_in_mid_fit_changes_no_bit(cluster_of_two):
    calm = fit_parts("synchronous")
    killed = fit_while_a_worker_is_killed(cluster_of_two, delay=0.7)
    assert killed.terms_ == calm.terms_ == ["y[k-1]", "u[k-1]", "u[k-1]^2"]
    assert killed.coef_.tobytes() == calm.coef_.tobytes()


@on_a_cluster
@pytest.mark.long
def test_ten_kills_at_ten_moments_change_no_bit(cluster_of_two):
    calm = fit_parts("synchronous")
    for delay in np.linspace(0.1, 2.0, 10):
        killed = fit_while_a_worker_is_killed(cluster_of_two, delay)
        assert killed.coef_.tobytes() == calm.coef_.tobytes()


RESUMED = """
import sys
import time
import numpy as np
from narx_sklearn import NARXRegressor
from narx_sklearn.identification.records import record

def fit(folder):
    rng = np.random.default_rng(0)
    u, e = rng.uniform(-1, 1, 60_000), 0.01 * rng.normal(size=60_000)
    y = np.convolve(u, [0.0, 1.0, 0.5])[:60_000] + e
    return NARXRegressor(4, 4, degree=2, refine=False, checkpoint=folder).fit(u[:, None], y)

if __name__ == "__main__":
    record.CHUNK_ROWS, record.GROUP_BLOCKS = 500, 1
    write = np.savez

    def write_slowly(*arguments, **arrays):
        write(*arguments, **arrays)
        time.sleep(0.05)  # so that a busy machine has the time to look on

    np.savez = write_slowly
    fit(sys.argv[1])
"""


def test_a_killed_process_leaves_a_checkpoint_that_another_goes_on_from(tmp_path, monkeypatch):
    script, folder = tmp_path / "fit.py", tmp_path / "checkpoint"
    script.write_text(RESUMED)
    command = [sys.executable, str(script), str(folder)]
    with subprocess.Popen(command, stdout=subprocess.DEVNULL) as victim:
        deadline = time.monotonic() + 60
        while not folder.exists() or len(list(folder.glob("*.npz"))) < 5:
            assert time.monotonic() < deadline, "the fit wrote no checkpoint"
            assert victim.poll() is None, "the fit was over before it was looked at"
            time.sleep(0.002)
        victim.kill()
    left = {path: path.stat().st_mtime_ns for path in folder.glob("*.npz")}
    assert len(left) >= 5
    fit = runpy.run_path(str(script))["fit"]
    monkeypatch.setattr(record, "CHUNK_ROWS", 500)
    monkeypatch.setattr(record, "GROUP_BLOCKS", 1)
    assert fit(folder).coef_.tobytes() == fit(None).coef_.tobytes()
    assert {path: path.stat().st_mtime_ns for path in left} == left
