"""Public recordings keep their promises; synthetic plants keep the laws they were made from."""

import hashlib
import os
import pickle
import sys
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import solve_ivp
from scipy.io import savemat

from narx_sklearn import datasets
from narx_sklearn.datasets import _excitation as excitation
from narx_sklearn.datasets import _files as files
from narx_sklearn.datasets import _integrate as integrate
from narx_sklearn.datasets import _plants_hysteresis as hysteresis
from narx_sklearn.datasets import _plants_mechanical as mechanical
from narx_sklearn.datasets import _plants_process as process
from narx_sklearn.datasets._registry import FILES

BESIDE = Path(__file__).resolve().parents[2] / "shared" / "data"
FETCHERS = [name for name in datasets.__all__ if name.startswith("fetch_")]
PLANTS = [name for name in datasets.__all__ if name.startswith("make_") and name != "make_narx"]
SMALL = {"n_samples": 400, "random_state": 3}


@pytest.fixture
def local_data(monkeypatch):
    """Folder of local copies, or a skip."""
    folder = os.environ.get(files.DATA_VARIABLE) or (str(BESIDE) if BESIDE.is_dir() else None)
    if folder is None:
        pytest.skip(
            f"No local copies of the recordings: set {files.DATA_VARIABLE} to their folder to run this."
        )
    monkeypatch.setenv(files.DATA_VARIABLE, folder)
    return Path(folder)


def small_file(**changes):
    """Describe a recording of three samples whose checksum is right."""
    frame = pd.DataFrame({"u [V]": [0.1, -2.5, 0.0], "y [m]": [1 / 3, 2e-7, 12345.678]})
    columns = {"u [V]": 5, "y [m]": 9}
    given = {
        "dataset": "toy",
        "part": "full",
        "n_samples": 3,
        "sha256": files.content_sha256(frame, columns),
        "columns": columns,
        "origin": ("someone/toy", "0" * 40),
        "paths": ("some folder/toy.mat",),
        "read": files.read_mat("u", "y"),
    }
    return files.DataFile(**{**given, **changes}), frame


# Content checksum


def test_checksum_is_that_of_the_text_worked_by_hand():
    frame = pd.DataFrame({"b": [0.5, -0.0], "a": [1.23456, 2e10]})
    text = "a\n1.23\n2e+10\nb\n0.5\n0\n"
    assert files.content_sha256(frame, {"a": 3, "b": 2}) == hashlib.sha256(text.encode()).hexdigest()


@settings(max_examples=50, deadline=None)
@given(st.lists(st.floats(-1e6, 1e6), min_size=1, max_size=30), st.integers(3, 12))
def test_checksum_of_a_printed_copy_is_that_of_the_original(values, digits):
    printed = [float(f"%.{digits}g" % v) for v in values]
    original = files.content_sha256(pd.DataFrame({"y": values}), {"y": digits})
    assert files.content_sha256(pd.DataFrame({"y": printed}), {"y": digits}) == original


def test_checksum_notices_one_changed_digit_and_swapped_rows():
    file, frame = small_file()
    changed, swapped = frame.copy(), frame.iloc[[1, 0, 2]]
    changed.loc[0, "y [m]"] += 1e-9
    assert len({files.content_sha256(f, file.columns) for f in (frame, changed, swapped)}) == 3


# Reading local copies


@pytest.mark.parametrize("key", sorted(FILES), ids="/".join)
def test_every_local_copy_has_the_registered_content(local_data, key):
    file = FILES[key]
    frame = files.load_file(file)
    assert list(frame.columns) == list(file.columns)
    assert len(frame) == file.n_samples


@pytest.mark.parametrize("name", FETCHERS)
def test_fetcher_returns_named_finite_columns_of_its_split(local_data, name):
    data = getattr(datasets, name)()
    outputs = [data.output] if isinstance(data.output, str) else data.output
    for part in [*data.train_parts.values(), *data.test_parts.values()]:
        X, y = part[data.input], part[outputs]
        assert np.isfinite(X.to_numpy()).all()
        assert np.isfinite(y.to_numpy()).all()
        assert part.index[0] == 0
        assert data.n_init < len(part)
        assert all("[" in column for column in part.columns)
    assert all(url.startswith("https://raw.githubusercontent.com/") for url in data.source)
    assert data.licence
    assert data.references
    assert len(data.DESCR) > 80
    assert repr(pickle.loads(pickle.dumps(data))) == repr(data)


def test_silverbox_split_is_that_of_the_official_loader(local_data):
    data = datasets.fetch_silverbox()
    record = pd.read_csv(local_data / "silverbox/silverbox_snls80mv.csv.gz").to_numpy()
    assert {name: len(part) for name, part in data.test.items()} == {
        "multisine": 21_688,
        "arrow": 40_475,
        "arrow_no_extrapolation": 32_000,
    }
    assert np.array_equal(data.test["arrow"], record[100:40_575])
    joined = np.vstack([data.train, data.test["multisine"]])
    assert np.array_equal(joined, record[40_650:127_400])
    assert data.test["arrow"]["V2 [V]"].abs().max() == pytest.approx(0.300, abs=1e-3)
    assert data.train["V2 [V]"].abs().max() < 0.232


def test_wiener_hammerstein_split_is_that_of_the_official_loader(local_data):
    data = datasets.fetch_wiener_hammerstein()
    record = pd.read_csv(local_data / "wiener_hammerstein/wiener_hammerstein_full.csv.gz").to_numpy()
    assert len(data.train) == 100_000
    assert np.array_equal(np.vstack([data.train, data.test]), record[5_200:184_000])


def test_emps_voltage_is_the_control_law_and_holds_the_pulses(local_data):
    data = datasets.fetch_emps()
    kp, kv = data.constants["kp [1/s]"], data.constants["kv [V s/m]"]
    for part, spread in ((data.train, 0.01), (data.test, 0.1)):
        q, t = part["qm [m]"].to_numpy(), part["t [s]"].to_numpy()
        smooth = (q[1:] + q[:-1]) / 2
        speed = np.diff(smooth) / np.diff(t)[1:]
        law = kp * kv * (part["qg [m]"].to_numpy()[2:] - q[2:]) - kv * speed
        pulses = part["pulses [V]"].to_numpy()[2:] if "pulses [V]" in part else 0.0
        assert np.std(part["vir [V]"].to_numpy()[2:] - law - pulses) < spread


def test_cascaded_tanks_clip_at_ten_volt(local_data):
    data = datasets.fetch_cascaded_tanks()
    assert data.train["y [V]"].max() == data.test["y [V]"].max() == 10.0
    assert (data.train["y [V]"] == 10.0).sum() == 47
    assert (data.test["y [V]"] == 10.0).sum() == 37


def test_bouc_wen_record_obeys_its_published_equation(local_data):
    data = datasets.fetch_bouc_wen()
    c = {key.split()[0]: value for key, value in data.constants.items()}
    part = data.test["sine sweep"].iloc[:1500]
    u, fs = part["u [N]"].to_numpy(), 1 / data.sampling_period

    def rhs(t, x):
        y, v, z = x
        force = np.interp(t, np.arange(u.size) / fs, u)
        dz = c["alpha"] * v - c["beta"] * (c["gamma"] * abs(v) * z + c["delta"] * v * abs(z))
        return [v, (force - c["cL"] * v - c["kL"] * y - z) / c["mL"], dz]

    t = np.arange(u.size) / fs
    run = solve_ivp(rhs, (0, t[-1]), [0, 0, 0], t_eval=t, max_step=0.5 / fs, rtol=1e-6, atol=1e-10)
    assert np.sqrt(np.mean((run.y[0] - part["y [m]"]) ** 2)) < 6e-5  # straight lines between samples


def test_f16_levels_are_split_by_parity_and_sweep_is_offered(local_data):
    sweep = datasets.fetch_f16("sine sweep")
    assert {k: len(v) for k, v in sweep.test.items()} == {"level 2": 108_477}
    assert sweep.train["level 3"]["Force [N]"].std() > sweep.train["level 1"]["Force [N]"].std()


@pytest.mark.parametrize("material", ["mnzn_ferrite", "mnzn_hp_ferrite", "amorphous_alloy", "m130_27s_steel"])
def test_bh_test_part_reaches_the_largest_field_and_parts_add_up(local_data, material):
    data = datasets.fetch_bh_loops(material)
    assert data.test["H [A/m]"].max() >= data.train["H [A/m]"].max() - 10.0
    assert len(data.train) + len(data.test) == FILES["bh_loops", material].n_samples


def test_unknown_choice_is_refused_with_the_choices():
    with pytest.raises(
        ValueError, match="excitation is 'noise', but must be one of 'multisine', 'sine sweep'"
    ):
        datasets.fetch_f16("noise")
    with pytest.raises(ValueError, match="material is 'iron'"):
        datasets.fetch_bh_loops("iron")


def test_missing_local_copy_says_what_is_wanted_and_the_way_out(tmp_path, monkeypatch):
    monkeypatch.setenv(files.DATA_VARIABLE, str(tmp_path))
    with pytest.raises(FileNotFoundError, match=r"silverbox_snls80mv.csv.gz.*V1 \[V\], V2 \[V\].*unset NARX"):
        datasets.fetch_silverbox()


def write_copy(frame, folder):
    (folder / "toy").mkdir()
    frame.to_csv(folder / "toy/toy_full.csv.gz", index=False)


def test_local_copy_with_another_content_is_refused(tmp_path, monkeypatch):
    file, frame = small_file()
    frame.loc[1, "u [V]"] = -2.6
    write_copy(frame, tmp_path)
    monkeypatch.setenv(files.DATA_VARIABLE, str(tmp_path))
    with pytest.raises(
        ValueError, match=f"expected 3 samples with checksum {file.sha256}, got 3 samples with"
    ):
        files.load_file(file)


def test_local_copy_with_other_columns_is_refused(tmp_path, monkeypatch):
    file, frame = small_file()
    write_copy(frame.rename(columns={"y [m]": "y [mm]"}), tmp_path)
    monkeypatch.setenv(files.DATA_VARIABLE, str(tmp_path))
    with pytest.raises(ValueError, match="cannot be read as toy/full"):
        files.load_file(file)


# Downloading, without a network


@pytest.fixture
def fake_pooch(monkeypatch):
    """Replace the download by a file written in its place; collect what was asked for."""
    pooch = pytest.importorskip("pooch")
    monkeypatch.delenv(files.DATA_VARIABLE, raising=False)
    state = SimpleNamespace(calls=[], write=None)

    def retrieve(url, known_hash, fname, path):
        state.calls.append((url, fname, Path(path)))
        Path(path).mkdir(parents=True, exist_ok=True)
        state.write(Path(path) / fname)
        return str(Path(path) / fname)

    monkeypatch.setattr(pooch, "retrieve", retrieve)
    return state


def test_download_reads_the_original_at_the_pinned_commit(tmp_path, fake_pooch):
    file, frame = small_file()
    u, y = frame.to_numpy().T
    fake_pooch.write = lambda path: savemat(path, {"u": u[:, None], "y": y[None, :]})
    loaded = files.load_file(file, data_home=tmp_path)
    url = f"https://raw.githubusercontent.com/someone/toy/{'0' * 40}/some%20folder/toy.mat"
    assert fake_pooch.calls == [(url, "toy.mat", tmp_path / "toy")]
    assert np.array_equal(loaded.to_numpy(), frame.to_numpy())


def test_downloaded_original_with_another_content_is_refused(tmp_path, fake_pooch):
    file, frame = small_file()
    fake_pooch.write = lambda path: savemat(path, {"u": frame["u [V]"].to_numpy(), "y": np.ones(3)})
    with pytest.raises(ValueError, match=r"not the known one.*toy\.mat.*[Dd]elete.*fetch it again"):
        files.load_file(file, data_home=tmp_path)


def test_downloaded_original_without_the_variable_is_refused(tmp_path, fake_pooch):
    file, _ = small_file()
    fake_pooch.write = lambda path: savemat(path, {"u": np.ones(3)})
    with pytest.raises(ValueError, match=r"cannot be read .*'y'"):
        files.load_file(file, data_home=tmp_path)


def test_downloaded_original_with_too_few_columns_is_refused(tmp_path, fake_pooch):
    file, _ = small_file(read=files.read_mat("u"))
    fake_pooch.write = lambda path: savemat(path, {"u": np.ones(3)})
    with pytest.raises(ValueError, match="has 1 columns, but 2 are wanted"):
        files.load_file(file, data_home=tmp_path)


def test_machine_without_network_is_told_the_variable(tmp_path, fake_pooch):
    def fail(path):
        raise OSError("no route to host")

    fake_pooch.write = fail
    with pytest.raises(ConnectionError, match=r"Could not download .*no route to host.*NARX_SKLEARN_DATA"):
        datasets.fetch_silverbox(data_home=tmp_path)


def test_missing_pooch_is_said_with_its_install_name(monkeypatch):
    monkeypatch.delenv(files.DATA_VARIABLE, raising=False)
    monkeypatch.setitem(sys.modules, "pooch", None)
    with pytest.raises(ImportError, match=r'pip install "narx-sklearn\[data\]"'):
        datasets.fetch_silverbox()


def test_default_data_home_is_the_cache_folder_of_the_system(fake_pooch, monkeypatch, tmp_path):
    import pooch

    monkeypatch.setattr(pooch, "os_cache", lambda name: tmp_path / name)
    file, frame = small_file()
    fake_pooch.write = lambda path: savemat(path, {"u": frame["u [V]"], "y": frame["y [m]"]})
    files.load_file(file)
    assert fake_pooch.calls[0][2] == tmp_path / "narx_sklearn" / "toy"


@pytest.mark.parametrize(
    ("dataset", "part"),
    [
        ("silverbox", "snls80mv"),
        ("emps", "test_pulses"),
        ("bouc_wen", "test_multisine"),
        ("f16_gvt", "sinesw_level1_est"),
    ],
)
def test_mat_originals_give_the_registered_content(
    local_data, tmp_path, fake_pooch, monkeypatch, dataset, part
):
    """Write the local numbers in the form of the original, noise below the printed digits, and read them."""
    file = FILES[dataset, part]
    monkeypatch.setenv(files.DATA_VARIABLE, str(local_data))
    frame = files.load_file(file)
    monkeypatch.delenv(files.DATA_VARIABLE)
    rng = np.random.default_rng(0)
    digits = np.array(list(file.columns.values()))
    values = frame.to_numpy() * (1 + 0.01 * 10.0**-digits * rng.uniform(-1, 1, frame.shape))
    variables = {
        "silverbox": {"V1": values[:, [0]], "V2": values[:, [1]]},
        "emps": dict(zip(("t", "qm", "qg", "vir", "pulses_N"), values.T, strict=False)),
        "bouc_wen": {"uval_multisine": values[:, 0], "yval_multisine": values[:, 1]},
        "f16_gvt": {"Force": values[:, 0], "Voltage": values[:, 1], "Acceleration": values[:, 2:].T},
    }[dataset]
    fake_pooch.write = lambda path: savemat(
        path, variables if len(file.paths) == 1 else {path.stem: variables[path.stem]}
    )
    assert np.allclose(files.load_file(file, data_home=tmp_path), frame, rtol=1e-5)


def test_csv_original_of_the_tanks_is_read_by_its_own_column_names(
    local_data, tmp_path, fake_pooch, monkeypatch
):
    parts = [FILES["cascaded_tanks", part] for part in ("estimation", "test")]
    monkeypatch.setenv(files.DATA_VARIABLE, str(local_data))
    (u_est, y_est), (u_val, y_val) = (files.load_file(file).to_numpy().T for file in parts)
    monkeypatch.delenv(files.DATA_VARIABLE)
    table = pd.DataFrame({"uEst": u_est, "uVal": u_val, "yEst": y_est, "yVal": y_val, "Ts": np.nan})
    fake_pooch.write = lambda path: table.to_csv(path, index=False)
    assert np.array_equal(datasets.fetch_cascaded_tanks(data_home=tmp_path).test["y [V]"], y_val)


@pytest.mark.parametrize("heading", ["", "value\n"])
def test_single_column_files_are_read_with_and_without_heading(tmp_path, heading):
    for name, numbers in (("u.csv", "5\n0\n"), ("y.csv", "-143.8\n2.5\n")):
        (tmp_path / name).write_text(heading + numbers)
    read = files.read_single_columns([tmp_path / "u.csv", tmp_path / "y.csv"])
    assert read.tolist() == [[5.0, -143.8], [0.0, 2.5]]


def test_loops_are_numbered_by_the_columns_of_the_original(tmp_path):
    savemat(tmp_path / "H.mat", {"HmeasT": [[1.0, 10.0], [2.0, 20.0]]})
    savemat(tmp_path / "B.mat", {"BmeasT": [[0.1, 0.3], [0.2, 0.4]]})
    read = files.read_loops([tmp_path / "H.mat", tmp_path / "B.mat"])
    assert read.tolist() == [[1, 1.0, 0.1], [1, 2.0, 0.2], [2, 10.0, 0.3], [2, 20.0, 0.4]]


def test_hdf5_original_needs_h5py_and_says_so(monkeypatch, tmp_path):
    monkeypatch.setitem(sys.modules, "h5py", None)
    with pytest.raises(ImportError, match="pip install h5py"):
        files.read_hdf5("a/u")([tmp_path / "train.h5"])


def test_hdf5_original_is_read_by_dataset_name(monkeypatch, tmp_path):
    class File(dict):
        def __init__(self, path, mode):
            super().__init__({"m/u": np.ones((1, 4)), "m/y": np.arange(4.0)[:, None]})

        def __enter__(self):
            return self

        def __exit__(self, *error):
            return None

    monkeypatch.setitem(sys.modules, "h5py", SimpleNamespace(File=File))
    read = files.read_hdf5("m/u", "m/y")([tmp_path / "train.h5"])
    assert read.tolist() == [[1, 0], [1, 1], [1, 2], [1, 3]]


# Synthetic plants: what all of them promise


@pytest.mark.parametrize("name", PLANTS)
def test_plant_is_the_same_for_the_same_random_state(name):
    make = getattr(datasets, name)
    first, again, other = make(**SMALL, noise=0.1), make(**SMALL, noise=0.1), make(400, random_state=4)
    assert first.X.equals(again.X)
    assert first.y.equals(again.y)
    assert not first.X.equals(other.X)


@pytest.mark.parametrize("name", [n for n in PLANTS if n != "make_servo_axis"])
def test_noise_of_a_plant_has_the_size_asked_for_and_leaves_its_truth(name):
    make = getattr(datasets, name)
    clean, noisy = make(4000, random_state=1), make(4000, noise=0.05, random_state=1)
    assert clean.y.equals(clean.truth.y)
    assert noisy.truth.y.equals(clean.y)
    e = noisy.y - noisy.truth.y
    assert np.std(e) == pytest.approx(0.05 * np.std(clean.y), rel=0.06)  # 4000 samples: 1.1 % standard error


@pytest.mark.parametrize("name", PLANTS)
def test_plant_names_units_and_can_be_pickled(name):
    plant = getattr(datasets, name)(**SMALL)
    columns = [*plant.X.columns, plant.y.name, *plant.truth.states.columns]
    assert all(column.endswith("]") and "[" in column for column in columns)
    assert len(plant.X) == len(plant.y) == len(plant.truth.states) == 400
    assert plant.truth.equation
    copy = pickle.loads(pickle.dumps(plant))
    assert copy.y.equals(plant.y)
    assert "400 samples" in repr(plant)


@pytest.mark.parametrize("name", PLANTS)
@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"n_samples": 1}, "n_samples is 1, but must be at least 2"),
        ({"noise": -0.1}, "noise is -0.1, but must be a finite number, zero or above"),
        ({"sampling_period": 0.0}, "sampling_period is 0.0, but must be a finite number above zero"),
        ({"u": [1.0, np.nan, 2.0]}, "is not finite at sample 1"),
        ({"u": np.ones((3, 3))}, r"has shape \(3, 3\), but must have shape \(n_samples"),
    ],
)
def test_plant_refuses_bad_arguments_by_name(name, arguments, message):
    if name == "make_servo_axis" and "u" in arguments:
        arguments = {"reference": arguments["u"]}
    if name == "make_mr_damper" and "is not finite" in message:
        arguments = {"u": np.column_stack([arguments["u"]] * 2)}
    with pytest.raises(ValueError, match=message):
        getattr(datasets, name)(**arguments)


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: datasets.make_duffing(excitation="chirp"), "excitation is 'chirp'"),
        (
            lambda: datasets.make_duffing(initial_state=[1.0]),
            r"initial_state is \[1.0\], but must be 2 finite",
        ),
        (lambda: datasets.make_duffing(100, band=(0.01, 0.02)), "No line of the multisine lies in the band"),
        (
            lambda: datasets.make_duffing(cubic_stiffness=-1e9, random_state=0),
            "left the finite range at sample",
        ),
        (lambda: datasets.make_servo_axis(breakaway_force=1.0), "breakaway_force is 1.0"),
        (lambda: datasets.make_pneumatic_valve(breakaway_force=np.inf), "breakaway_force is inf"),
        (lambda: datasets.make_cascaded_tanks(initial_state=[11, 0]), "levels must be from 0 to 10.0"),
        (
            lambda: datasets.make_cascaded_tanks(caught_share=1.5),
            "caught_share is 1.5, but must be at most 1",
        ),
        (lambda: datasets.make_ph_process(hold=(5, 2)), r"hold is \(5, 2\)"),
    ],
)
def test_particular_argument_out_of_range_is_refused(call, message):
    with pytest.raises(ValueError, match=message):
        call()


# Integrators


def test_runge_kutta_has_fourth_order_on_the_oscillator(monkeypatch):
    monkeypatch.setattr(integrate, "rk4_step", integrate.rk4_step.py_func)

    def oscillator(x, u, rate, p, out):
        out[:] = x[1], -x[0]

    def error(n):
        u, nothing = np.zeros((2, 1)), np.empty(0)
        x = integrate.rk4_run.py_func(oscillator, np.array([1.0, 0.0]), u, True, nothing, 1.0 / n, n)
        return abs(x[-1, 0] - np.cos(1.0))

    assert error(4) / error(8) == pytest.approx(16, rel=0.15)


def test_friction_step_stops_a_mass_where_the_parabola_ends():
    """v0 = 1 m/s, Fc/m = 2 m/s^2: stops after 0.5 s and 0.25 m, and stays."""
    for step in (integrate.friction_step, integrate.friction_step.py_func):
        v, x, h = 1.0, 0.0, 1e-3
        for _ in range(600):
            v = step(v, 0.0, h, 1.0, 0.0, 0.0, 2.0, 2.0)
            x += h * v
        assert v == 0.0
        assert x == pytest.approx(0.25, abs=1e-3)  # first order in h


@settings(max_examples=60, deadline=None)
@given(st.floats(-5, 5), st.floats(-50, 50), st.floats(0, 20), st.floats(0, 20))
def test_friction_only_takes_kinetic_energy(v, force, coulomb, damping):
    step = integrate.friction_step.py_func
    after = step(v, force, 1e-2, 1.0, damping, 0.0, coulomb, coulomb)
    free = step(v, force, 1e-2, 1.0, 0.0, 0.0, 0.0, 0.0)
    assert abs(after) <= abs(free)
    assert after * free >= 0.0


SERVO_PARAMETERS = np.array([95, 200, 20, 22, -3, 35, 160, 243, 10.0])
VALVE_PARAMETERS = np.array([0.1, 0.0645, 2e4, 8e4, 1.4, 612, 2e5, 250, 255, 2.5e-4, 2e-4])
KERNELS = [
    (mechanical._simulate_servo, (np.linspace(0, 0.01, 12), np.zeros(12), SERVO_PARAMETERS, 5e-5, 20)),
    (mechanical._simulate_valve, (np.linspace(2, 4, 12), VALVE_PARAMETERS, 1e-3, 10)),
]


@pytest.mark.parametrize(("kernel", "arguments"), KERNELS, ids=["servo", "valve"])
def test_compiled_kernel_and_its_python_original_agree(kernel, arguments):
    assert np.allclose(kernel(*arguments), kernel.py_func(*arguments), rtol=1e-12, atol=1e-15)


@pytest.mark.parametrize(
    ("name", "run"),
    [
        ("make_duffing", lambda make: make(u=np.sin(np.arange(12.0)), initial_state=[0.01, 0.1])),
        ("make_piezo_bench", lambda make: make(u=20 * np.sin(np.arange(12.0)))),
        ("make_hysteresis_circuit", lambda make: make(u=3 * np.sin(np.arange(12.0)))),
        (
            "make_mr_damper",
            lambda make: make(u=np.column_stack([np.ones(12), 0.01 * np.sin(np.arange(12.0))])),
        ),
        ("make_ph_process", lambda make: make(u=np.arange(12) / 2)),
        ("make_cascaded_tanks", lambda make: make(u=np.full(12, 6.0), initial_state=[9.9, 9.9])),
    ],
)
def test_compiled_plant_and_its_python_original_agree(name, run, monkeypatch):
    make = getattr(datasets, name)
    compiled = run(make)
    for module in (mechanical, hysteresis, process, integrate):
        for attribute, value in list(vars(module).items()):
            if hasattr(value, "py_func"):
                monkeypatch.setattr(module, attribute, value.py_func)
    python = run(make)
    assert np.allclose(python.y, compiled.y, rtol=1e-10, atol=1e-13)
    assert np.allclose(python.truth.states, compiled.truth.states, rtol=1e-10, atol=1e-13)


# Excitations


def test_filtered_noise_fills_its_range_and_keeps_below_its_cutoff():
    b = excitation.filtered_noise(20_000, 2.0, 0.01, np.random.RandomState(0))
    power = np.abs(np.fft.rfft(b)) ** 2
    frequency = np.fft.rfftfreq(b.size, 0.01)
    assert (b.min(), b.max()) == (-1.0, 1.0)
    assert power[(frequency > 4.0)].sum() < 0.01 * power[1:].sum()  # 30 dB an octave


def test_multisine_excites_its_band_evenly_and_nothing_else():
    u = excitation.multisine(1000, (1.0, 5.0), 0.01, np.random.RandomState(0))
    lines = np.abs(np.fft.rfft(u))
    assert np.sqrt(np.mean(u**2)) == pytest.approx(1.0)
    assert np.ptp(lines[10:51]) < 1e-9
    assert max(lines[:10].max(), lines[51:].max()) < 1e-9


def test_random_steps_hold_as_long_as_asked():
    u = excitation.random_steps(5000, (0.0, 6.0), (20, 40), np.random.RandomState(0))
    holds = np.diff(np.flatnonzero(np.diff(u)))
    assert 20 <= holds.min() <= holds.max() <= 40
    assert 0 <= u.min() < u.max() <= 6


# Laws of the plants


def test_duffing_agrees_with_an_independent_integrator():
    plant = datasets.make_duffing(200, random_state=0)
    p, f = plant.truth.parameters, plant.X["force [N]"].to_numpy()
    t = np.arange(200) * plant.sampling_period

    def rhs(time, x):
        spring = p["stiffness"] * x[0] + p["cubic_stiffness"] * x[0] ** 3
        return [x[1], (np.interp(time, t, f) - p["damping"] * x[1] - spring) / p["mass"]]

    run = solve_ivp(
        rhs, (0, t[-1]), [0, 0], t_eval=t, rtol=1e-9, atol=1e-12, max_step=plant.sampling_period / 4
    )
    assert np.allclose(plant.y, run.y[0], atol=1e-5 * np.std(plant.y))


@settings(max_examples=15, deadline=None)
@given(st.floats(-0.04, 0.04), st.floats(-2, 2), st.floats(0, 2), st.floats(0, 1e6))
def test_duffing_loses_energy_without_input_and_keeps_it_without_damper(x, v, damping, cubic):
    plant = datasets.make_duffing(
        u=np.zeros(100), initial_state=[x, v], damping=damping, cubic_stiffness=cubic, sampling_period=0.002
    )
    p = plant.truth.parameters
    x, v = plant.truth.states.to_numpy().T
    energy = p["mass"] * v**2 / 2 + p["stiffness"] * x**2 / 2 + p["cubic_stiffness"] * x**4 / 4
    slack = 1e-6 * energy[0] + 1e-30  # error of the Runge-Kutta steps
    assert (np.diff(energy) <= slack).all()
    if damping == 0:
        assert np.ptp(energy) <= 100 * slack


def test_piezo_bench_loads_along_the_exponential_worked_by_hand():
    u = np.linspace(0, 80, 4001)
    plant = datasets.make_piezo_bench(u=u)
    h = 0.9 / 0.016 * (1 - np.exp(-0.016 * u))  # h' = (A - (beta + gamma) h) u' while h and u rise
    assert np.allclose(plant.y, 1.6 * u - h, atol=1e-10)


def test_piezo_bench_depends_on_the_path_not_on_its_rate():
    turns = np.interp(np.arange(0, 4001), [0, 1000, 2500, 4000], [0, 60, -40, 20])
    slow = np.interp(np.arange(0, 12001) / 3, np.arange(4001), turns)
    fast, third = datasets.make_piezo_bench(u=turns), datasets.make_piezo_bench(u=slow)
    assert np.allclose(third.y.to_numpy()[::3], fast.y, atol=1e-5)  # |h| has a kink inside a step
    assert datasets.make_piezo_bench(u=turns, sampling_period=1.0).y.sub(fast.y).abs().max() < 1e-10


def test_piezo_bench_holds_its_value_when_the_voltage_stops():
    plant = datasets.make_piezo_bench(u=np.r_[np.linspace(0, 50, 500), np.full(500, 50.0)])
    assert np.ptp(plant.y[500:]) == 0.0


def test_damper_yield_element_settles_and_force_is_odd_in_the_motion():
    x = np.r_[np.linspace(0, 2, 1000), np.linspace(2, -2, 2000)]
    there = datasets.make_mr_damper(u=np.column_stack([np.full(3000, 1.5), x]))
    back = datasets.make_mr_damper(u=np.column_stack([np.full(3000, 1.5), -x]))
    z = there.truth.states["z [cm]"]
    assert z[900] == pytest.approx(np.sqrt(47.2 / 78.6), rel=1e-3)
    assert np.allclose(there.y, -back.y, atol=1e-9)


def test_damper_grows_stiffer_with_voltage_after_the_lag_of_its_driver():
    x = np.linspace(0, 3, 3000)
    voltage = np.where(np.arange(3000) < 1500, 0.0, 2.0)
    plant = datasets.make_mr_damper(u=np.column_stack([voltage, x]))
    assert plant.y[2900] > 5 * plant.y[1400]
    filtered = plant.truth.states["filtered voltage [V]"]
    after = 10 * 1e-3
    ramp = 1e-3  # straight line from 0 to 2 V within one sample
    expected = 2 - 2 * np.exp(-251 * (after - ramp)) * (1 - np.exp(-251 * ramp)) / (251 * ramp)
    assert filtered[1509] == pytest.approx(expected, rel=1e-4)


def test_circuit_waits_after_a_reversal_by_twice_the_diode_voltage():
    """At 20 V/s the diodes carry C du/dt = 20 uA and stand at slope asinh(i / 2 Is) + R i, either way."""
    up, down = np.linspace(0, 5, 251), np.linspace(5, -5, 501)[1:]
    plant = datasets.make_hysteresis_circuit(u=np.r_[up, down])
    drop = 0.1 * np.arcsinh(20e-6 / 2e-9) + 1e3 * 20e-6
    assert 5 - plant.y[250] == pytest.approx(drop, rel=0.01)
    assert -5 - plant.y[750] == pytest.approx(-drop, rel=0.01)
    inside = slice(250, 300)  # one volt back: the output has hardly moved (it ends its rise first)
    assert np.ptp(plant.y[inside]) < 0.1


@settings(max_examples=40, deadline=None)
@given(st.floats(-20, 20), st.floats(1.0, 1e6), st.floats(1e-12, 1e-6), st.floats(0.02, 0.5))
def test_diode_current_solves_its_equation_and_is_odd(voltage, resistance, saturation, slope):
    current = hysteresis._diode_current.py_func(voltage, resistance, saturation, slope)
    back = resistance * current + slope * np.arcsinh(current / (2 * saturation))
    assert back == pytest.approx(voltage, rel=1e-9, abs=1e-12)
    assert hysteresis._diode_current.py_func(-voltage, resistance, saturation, slope) == -current


@settings(max_examples=15, deadline=None)
@given(st.integers(0, 1000), st.floats(0, 10), st.floats(0, 10), st.floats(0, 1))
def test_tanks_keep_the_water_that_is_pumped(seed, upper, lower, caught):
    plant = datasets.make_cascaded_tanks(
        200, initial_state=[upper, lower], caught_share=caught, cutoff=0.02, random_state=seed
    )
    s = plant.truth.states
    stored = 30.0 * (s["upper level [cm]"] + s["lower level [cm]"])
    balance = stored - s["pumped [cm^3]"] + s["drained [cm^3]"] + s["lost [cm^3]"]
    assert np.ptp(balance) < 1e-8
    assert (s[["upper level [cm]", "lower level [cm]"]] <= 10.0).all(axis=None)
    assert (s[["upper level [cm]", "lower level [cm]"]] > -1e-3).all(axis=None)
    assert (s["lost [cm^3]"].diff().dropna() >= 0).all()


def test_tanks_settle_where_outflow_balances_the_pump():
    plant = datasets.make_cascaded_tanks(u=np.full(400, 3.0))
    level = (3.3 * 3.0 / 0.1) ** 2 / (2 * 981.0)
    assert plant.truth.states.iloc[-1, :2].tolist() == pytest.approx([level, level], rel=1e-6)


def test_ph_balances_the_charges_and_is_neutral_water_without_acid():
    for solve in (process._ph_of, process._ph_of.py_func):
        assert solve(0.0, 0.0, 1e-6) == pytest.approx(7.0, abs=1e-12)
        assert solve(-0.01, 0.0, 1e-6) == pytest.approx(2.0, abs=1e-9)
        assert solve(0.01, 0.0, 1e-6) == pytest.approx(12.0, abs=1e-9)
        # Half-titrated weak acid: pH = pKa, but for the water itself.
        assert solve(0.005, 0.01, 1e-6) == pytest.approx(6.0, abs=1e-3)


def test_ph_process_rests_in_steady_state_and_follows_a_titration_curve():
    levels = np.arange(0, 6.5, 0.5)
    curve = [datasets.make_ph_process(u=np.full(50, level)) for level in levels]
    assert all(np.ptp(plant.y) < 1e-9 for plant in curve)
    gain = np.diff([plant.y.iloc[0] for plant in curve])
    assert (gain > 0).all()
    assert gain.max() > 10 * gain.min()


def test_ph_process_falls_more_slowly_than_it_rises():
    plant = datasets.make_ph_process(u=np.r_[np.full(10, 4.4), np.full(990, 4.6), np.full(1000, 4.4)])
    low, high = plant.y[0], plant.y[999]
    up = np.flatnonzero(plant.y[10:1000] > (low + high) / 2)[0]
    down = np.flatnonzero(plant.y[1000:] < (low + high) / 2)[0]
    assert down > 1.1 * up


def test_valve_stays_put_while_the_command_is_inside_the_friction_band():
    """2 Fc of 250 N over 5334 N of span: 0.37 V. A command that comes back by less moves nothing."""
    command = np.r_[
        np.linspace(3, 3.8, 500), np.full(200, 3.8), np.linspace(3.8, 3.5, 300), np.full(200, 3.5)
    ]
    plant = datasets.make_pneumatic_valve(u=command)
    stem = plant.truth.states["stem [m]"]
    assert np.ptp(stem[705:]) == 0.0  # the ramp ends at 500; until the turn at 700 the stem may creep on
    assert np.ptp(plant.y[705:]) == 0.0
    back = datasets.make_pneumatic_valve(u=np.r_[command, np.linspace(3.5, 3.0, 300)])
    assert np.ptp(back.truth.states["stem [m]"][705:]) > 1e-4


def test_valve_rests_at_many_positions_for_one_command():
    rise, fall = np.linspace(2, 3, 500), np.linspace(4, 3, 500)
    rest = np.full(500, 3.0)
    ends = [datasets.make_pneumatic_valve(u=np.r_[way, rest]).y.iloc[-1] for way in (rise, fall)]
    span = 0.0645 * 82.7e3
    width = 4 * (2 * 250 / 210_000 + 4e-4) / 0.0254  # friction band and play, as reading
    assert ends[1] - ends[0] == pytest.approx(width, rel=0.1)
    assert span > 5000


def test_servo_sticks_below_breakaway_and_moves_above():
    """From rest at zero the PD law asks force_gain kp kv r; the load offset is -3.2 N."""
    per_metre = 35.15 * 160.2 * 243.5
    inside, outside = (force / per_metre for force in (18.0, 19.5))  # + 3.2 N of offset, against 22 N
    assert np.ptp(datasets.make_servo_axis(reference=np.r_[0.0, np.full(200, inside)]).y) == 0.0
    assert np.ptp(datasets.make_servo_axis(reference=np.r_[0.0, np.full(200, outside)]).y) > 0.0


def test_servo_force_balance_holds_at_constant_speed():
    reference = 0.1 * np.arange(3000) * 1e-3
    plant = datasets.make_servo_axis(reference=reference)
    voltage = plant.X["voltage [V]"].iloc[-1]
    assert 35.15 * voltage == pytest.approx(203.5 * 0.1 + 20.4 - 3.2, rel=1e-6)


def test_servo_controller_acts_on_the_measured_position_within_its_limit():
    plant = datasets.make_servo_axis(3000, noise=0.05, random_state=0)
    measured, reference = plant.y, plant.truth.states["reference [m]"]
    law = 160.2 * 243.5 * (reference - measured) - 243.5 * measured.diff() / 1e-3
    assert np.allclose(plant.X["voltage [V]"][1:], law[1:].clip(-10, 10), atol=1e-9)
    assert plant.X["voltage [V]"].abs().max() == 10.0
    e = plant.y - plant.truth.y
    assert np.std(e) == pytest.approx(0.05 * np.std(reference), rel=0.06)
