"""Samples that stand alone: no measurements, and no physics."""

import numpy as np
import pytest
from scipy.signal import lfilter

from narx_sklearn.discrepancy import DiscrepancyRegressor, ODESimulator
from narx_sklearn.discrepancy.records.spikes import find_spikes
from narx_sklearn.physics.effects import CATALOGUE
from narx_sklearn.physics.effects._effect import Setting

N = 2000
WHOLE = [slice(0, N)]
QUIET = np.zeros((N, 1))


def stage(x, u, p):
    return x[1], p[0] * u[0] - p[1] * x[1] - p[2] * x[0]


def make_stage(gain=1.0, damping=0.9, stiffness=36.0):
    return ODESimulator(
        stage,
        dt=0.02,
        parameters={"gain [m/s^2/V]": gain, "damping [1/s]": damping, "stiffness [1/s^2]": stiffness},
        states=["position [m]", "velocity [m/s]"],
        inputs=["drive [V]"],
    )


def spikes_in(signal, u=QUIET, pieces=WHOLE):
    """Return where spikes are found in what a simulation leaves, if the record is all of that."""
    return np.flatnonzero(find_spikes(signal[:, None], lambda: (signal[:, None], pieces), u, pieces))


@pytest.fixture
def noise():
    return np.random.default_rng(0).normal(size=N)


@pytest.mark.parametrize("size", [20.0, -1e3])
def test_one_or_two_samples_far_off_are_found_and_longer_stretches_are_not(noise, size):
    noise[[300, 900, 901, *range(1500, 1504)]] += size
    assert spikes_in(noise).tolist() == [300, 900, 901]


def test_noise_steps_whole_steps_corners_and_decays_are_no_spikes(noise):
    time = np.arange(N)
    assert spikes_in(noise).size == 0
    assert spikes_in(np.round(noise / 2) * 2).size == 0
    assert spikes_in(noise + 100.0 * (time // 250 % 2)).size == 0
    assert spikes_in(0.01 * noise + np.abs(time % 100 - 50.0)).size == 0
    assert spikes_in(0.01 * noise + 0.6 ** (time % 200)).size == 0


def coloured(pole, seed, n=N):
    """Return noise of deviation 1 that keeps a share of itself; with a pole of 1 it drifts, each step 1."""
    e = np.random.default_rng(seed).normal(size=n + 500)
    return lfilter([1.0], [1.0, -pole], e)[500:] * (np.sqrt(1 - pole**2) if pole < 1 else 1.0)


# in each of these a sample is far off the median around it
@pytest.mark.parametrize(("pole", "seed", "n"), [(0.95, 984, 5000), (0.99, 584, 5000), (0.99, 662, 1000)])
def test_noise_that_remembers_has_no_spikes(pole, seed, n):
    noise = coloured(pole, seed, n)
    assert spikes_in(noise, np.zeros((n, 1)), [slice(0, n)]).size == 0


@pytest.mark.parametrize("pole", [0.0, 0.7, 0.95, 0.99, 1.0])
def test_a_spike_in_noise_that_remembers_is_found(pole):
    noise = coloured(pole, 2)
    noise[700] += 15.0 * np.std(np.diff(noise))
    assert spikes_in(noise).tolist() == [700]


def test_what_comes_when_an_input_moves_and_what_is_frequent_is_no_spike(noise):
    at = np.arange(20, N, 100)
    noise[at] += 30.0
    moved = np.zeros((N, 1))
    moved[at] = 1.0
    assert spikes_in(noise).size == at.size
    assert spikes_in(noise, np.cumsum(moved, axis=0)).size == 0
    noise[np.arange(50, N, 25)] += 30.0
    assert spikes_in(noise).size == 0


def test_what_comes_where_the_machine_moves_most_is_a_blow_and_no_failure(noise):
    motion = 30.0 * np.sin(2 * np.pi * np.arange(N) / 500)
    far = np.abs(motion) > 24.0
    rng = np.random.default_rng(5)
    blows = rng.choice(np.flatnonzero(far), 15, replace=False)
    failures = rng.choice(N, 15, replace=False)

    def told(at):
        signal = noise + motion
        left = noise.copy()
        for wave in (signal, left):
            wave[at] += 40.0
        found = find_spikes(signal[:, None], lambda: (left[:, None], WHOLE), QUIET, WHOLE)
        return np.flatnonzero(found).tolist()

    assert told(blows) == []
    assert told(failures) == sorted(failures)
    assert told(blows[:3]) == sorted(blows[:3])  # three may be there by chance


def test_gaps_and_the_edges_of_pieces_are_stood(noise):
    noise[[0, 700, 1999]] += 40.0
    noise[100:140] = np.nan
    pieces = [slice(0, 690), slice(700, N)]
    assert spikes_in(noise, pieces=pieces).tolist() == [0, 700, 1999]
    assert spikes_in(np.full(N, np.nan)).size == 0


def test_where_a_window_begins_what_is_left_leaps(noise):
    signal = 3.0 * noise + 300.0 * np.sin(np.arange(N) / 40)
    signal[600] += 120.0  # looked at for this one
    left = 3.0 * noise
    left[600] += 120.0
    left[1000:1004] += 100.0 * 0.3 ** np.arange(4)  # a state that a window begins with wrong
    windows = [slice(0, 1000), slice(1000, N)]
    for pieces, told in ((WHOLE, [600, 1000]), (windows, [600])):
        found = find_spikes(signal[:, None], lambda: (left[:, None], pieces), QUIET, WHOLE)  # noqa: B023
        assert np.flatnonzero(found).tolist() == told


def test_a_record_in_which_nothing_stands_out_is_not_refitted(noise):
    def refused():
        raise AssertionError("refitted for nothing")

    assert not find_spikes(noise[:, None], refused, QUIET, WHOLE).any()


def test_a_hold_that_only_spikes_speak_for_is_no_start():
    time = 0.02 * np.arange(N)
    signal = np.sin(time) + 0.3 * np.sin(3.1 * time)
    residual = 0.01 * np.random.default_rng(1).normal(size=N)
    setting = Setting(
        signal, np.gradient(signal, 0.02), signal, None, time, 0.02, np.array([0]), residual.copy()
    )
    scan = CATALOGUE["stuck_sensor"].scan
    held = residual.copy()
    begin = int(np.argmax(np.gradient(signal)[:1500]))  # where it shows at once
    held[begin : begin + 60] += signal[begin] - signal[begin : begin + 60]
    rows, _ = scan(setting, held)
    assert rows[0] == pytest.approx([time[begin], 60 * 0.02, 0.0], abs=0.05)
    residual[[400, 1200]] -= 0.5 * np.sign(np.gradient(signal))[[400, 1200]]
    assert len(scan(setting, residual)[0]) == 0


def test_spikes_of_a_sensor_are_told_and_left_out():
    rng = np.random.default_rng(3)
    u = np.repeat(rng.normal(0, 3, N // 10), 10)[:, None]
    true = make_stage(1.1, 0.8, 40.0).simulate(u)
    y = true + 0.01 * true.std() * rng.standard_normal(true.shape)
    at = np.sort(rng.choice(N, 12, replace=False))
    y[at] += true.std() * np.sign(rng.standard_normal((12, 1)))
    dx = DiscrepancyRegressor(make_stage()).fit(u, y)
    assert dx.verdict_ == "refit"
    (found,) = (finding for finding in dx.data_findings_ if finding.code == "spikes")
    assert found.evidence["samples"] == at.tolist()
    assert found.sentence.startswith("12 samples of position stand alone")
    assert dx.scores_.loc["refitted", "nrmse"] < 0.02
