"""The embedded case of ``narx-sklearn demo``: a positioning stage whose friction its simulation left out."""

import numpy as np
import pandas as pd

from narx_sklearn.cli._columns import Recording
from narx_sklearn.cli._diagnose import check_targets, tell_diagnosis
from narx_sklearn.cli._files import check_writable
from narx_sklearn.cli._output import tell_notes, write_columns
from narx_sklearn.discrepancy import DiscrepancyRegressor, ODESimulator

PERIOD = 0.01  # s
SUBSTEPS = 20  # of the machine's own integration in one sample
NOISE = 5e-4  # m

# What the machine is. Its simulation knows nothing of the friction, and has its numbers from a data sheet.
MASS, DAMPING, STIFFNESS, FORCE_CONSTANT, COULOMB = 1.0, 6.0, 180.0, 4.0, 1.6  # kg, N s/m, N/m, N/V, N
DATA_SHEET = {"gain [m/s^2/V]": 4.3, "damping [1/s]": 5.0, "stiffness [1/s^2]": 170.0}


def demo_record(n_samples: int = 4000, random_state=0) -> pd.DataFrame:
    """Simulate a recording of a stage on a guide with dry friction.

    The motion ``m v' = K u - c v - k x - F_c sign(v)`` is integrated by a semi-implicit Euler rule that is
    implicit in the friction, in 20 steps a sample, so that friction stops the stage and never drives it
    back. The simulation under test is integrated by another rule, so nothing agrees by construction.

    Parameters
    ----------
    n_samples : int, default=4000
        Samples, 0.01 s apart.
    random_state : int, default=0
        Seed of the drive and of the measurement noise.

    Returns
    -------
    DataFrame of shape (n_samples, 3)
        ``time [s]``, ``drive [V]``, ``position [m]``.

    Examples
    --------
    >>> from narx_sklearn.cli._demo import demo_record
    >>> float(demo_record(500)["position [m]"].std().round(4))
    0.0371
    """
    rng = np.random.default_rng(random_state)
    levels = np.repeat(rng.uniform(-2.5, 2.5, -(-n_samples // 40)), 40)[:n_samples]
    drive = np.convolve(levels, np.ones(10) / 10, mode="full")[:n_samples]
    position = np.empty(n_samples)
    x, v, h = 0.0, 0.0, PERIOD / SUBSTEPS
    for k, u in enumerate(drive.tolist()):
        position[k] = x
        for _ in range(SUBSTEPS):
            free = v + h * (FORCE_CONSTANT * u - STIFFNESS * x) / MASS
            slowed = max(abs(free) - h * COULOMB / MASS, 0.0) / (1 + h * DAMPING / MASS)
            v = slowed if free > 0 else -slowed
            x += h * v
    position += NOISE * rng.normal(size=n_samples)
    return pd.DataFrame(
        {"time [s]": PERIOD * np.arange(n_samples), "drive [V]": drive, "position [m]": position}
    )


def demo_simulator() -> ODESimulator:
    """Return the simulation under test: mass, spring and damper, numbers from a data sheet, no friction."""
    return ODESimulator(
        stage,
        dt=PERIOD,
        states=["position [m]", "velocity [m/s]"],
        inputs=["drive [V]"],
        parameters=DATA_SHEET,
    )


def stage(x, u, p):
    """Return the rates of position and velocity: ``v' = gain u - damping v - stiffness x``."""
    return x[1], p[0] * u[0] - p[1] * x[1] - p[2] * x[0]


def run(options) -> None:
    """Diagnose the stage and tell."""
    check_targets(options)
    check_writable(options.csv)
    record = demo_record()
    if options.csv:
        write_columns(options.csv, {label: record[label].to_numpy() for label in map(str, record)})
    recording = Recording(
        record[["drive [V]"]],
        record[["position [m]"]],
        None,
        PERIOD,
        np.zeros(len(record), dtype=int),
        (
            f"A simulated stage of {MASS:g} kg with dry friction of {COULOMB} N, of which the simulation "
            "knows nothing.",
        ),
    )
    tell_notes(recording.notes, options.quiet)
    dx = DiscrepancyRegressor(demo_simulator(), random_state=0)
    tell_diagnosis(dx, recording, options, title="Demonstration", source="a simulated positioning stage")
