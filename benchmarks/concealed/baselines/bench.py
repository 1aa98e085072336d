"""What a baseline is given: a case's folder, the refitted nominal simulator, and what its rates lack."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd
from scipy.signal import savgol_filter

from benchmarks.concealed.diagnose import load_nominal
from benchmarks.concealed.plants.dispatch import MACHINES, NUMBERS
from benchmarks.concealed.plants.integrate import UNFORCED, run_nominal
from benchmarks.concealed.plants.machine import Machine
from benchmarks.concealed.structural import Structural, refit_nominal

__all__ = ["Bench", "open_case"]

# Each state as (output, order of its derivative); None where only the nominal simulator knows it.
SEEN = {
    "mass_spring_damper": ((0, 0), (0, 1)),
    "servo_axis": ((0, 0), (0, 1)),
    "pendulum": ((0, 0), (0, 1)),
    "dc_motor": ((0, 0), (1, 0)),
    "heated_mass": ((0, 0), (1, 0)),
    "rlc": ((0, 0), (1, 0)),
    "two_tanks": (None, (0, 0)),
    "two_mass_drive": ((0, 0), (0, 1), None, None),
}


@dataclass(frozen=True)
class Bench:
    """A case as a baseline sees it.

    Attributes
    ----------
    u, y : ndarray
        Training recording.
    sigma : ndarray of shape (n_outputs,)
        Noise, from second differences.
    fit : Structural
        The nominal simulator fitted to the recording, windows with free initial states.
    states : ndarray of shape (n_samples, n_states)
        Measured and smoothed, or the fitted nominal's.
    missing : ndarray of shape (n_samples, n_states)
        Smoothed rates less the fitted nominal's; zero where the state is not seen.
    x0 : ndarray
        State at the start of the held-out recordings.
    heldout : dict of ndarray
        Their inputs.
    """

    machine: Machine
    u: np.ndarray
    y: np.ndarray
    sigma: np.ndarray
    fit: Structural
    states: np.ndarray
    missing: np.ndarray
    x0: np.ndarray
    heldout: dict[str, np.ndarray]

    def rates(self, x, u):
        """Return the fitted nominal's rates at one state."""
        return np.array(self.machine.nominal(x, u, self.fit.parameters))

    def free_run(self, u: np.ndarray) -> np.ndarray:
        """Return the outputs of the fitted nominal's free run from rest."""
        return self.windowed(u, self.x0[None], len(u))[:, list(self.machine.measured)]

    def windowed(self, u, starts, length, added=UNFORCED):
        """Return the fitted nominal's states over windows, with something added to its rates."""
        m = self.machine
        return run_nominal(NUMBERS[m.name], self.fit.parameters, starts, u, length, m.dt, added)


def open_case(folder: Path) -> Bench:
    """Read a case's folder and refit its nominal simulator to the recording."""
    nominal = load_nominal(folder)
    ports = tuple(nominal.STATES), tuple(nominal.INPUTS)
    machine = next(m for m in MACHINES.values() if (m.states, m.inputs) == ports)
    recording, heldout = (pd.read_csv(Path(folder) / f"{name}.csv") for name in ("recording", "heldout"))
    u, y = (recording[list(names)].to_numpy() for names in (nominal.INPUTS, nominal.OUTPUTS))
    guess, x0 = np.array(list(nominal.PARAMETERS.values())), np.array(nominal.X0, dtype=float)
    sigma = np.std(np.diff(y, n=2, axis=0), axis=0) / np.sqrt(
        6.0
    )  # second differences of white noise: 1, 4, 1
    simulated = run_nominal(NUMBERS[machine.name], guess, x0[None], u, len(u), machine.dt, UNFORCED)
    states = _seen(machine, y, simulated)
    fit = refit_nominal(machine, u, y, sigma, guess, states, n_iterations=15)
    bench = Bench(
        machine,
        u,
        y,
        sigma,
        fit,
        states,
        np.zeros_like(states),
        x0,
        {
            name: part[list(nominal.INPUTS)].to_numpy()
            for name, part in heldout.groupby("session", sort=False)
        },
    )
    states = _seen(machine, y, bench.windowed(u, fit.starts, fit.length))
    return Bench(machine, u, y, sigma, fit, states, _missing(bench, states), x0, bench.heldout)


def _window(machine):
    """Return the samples over which a signal of the machine's band is nearly a cubic."""
    return max(5, int(0.2 / (machine.band * machine.dt)) // 2 * 2 + 1)


def _smooth(machine, signal, order):
    return savgol_filter(signal, _window(machine), 3, deriv=order, delta=machine.dt)


def _seen(machine, y, simulated):
    """Return the states: what the sensors show, smoothed, and the simulated ones where they show nothing."""
    states = np.clip(np.nan_to_num(simulated), -1e9, 1e9)
    for i, source in enumerate(SEEN[machine.name]):
        if source is not None:
            states[:, i] = _smooth(machine, y[:, source[0]], source[1])
    return states


def _missing(bench, states):
    machine = bench.machine
    nominal = np.array([bench.rates(x, u) for x, u in zip(states, bench.u, strict=True)])
    missing = np.zeros_like(states)
    for i, source in enumerate(SEEN[machine.name]):
        if source is not None:
            missing[:, i] = _smooth(machine, bench.y[:, source[0]], source[1] + 1) - nominal[:, i]
    return missing
