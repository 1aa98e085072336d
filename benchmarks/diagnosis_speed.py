"""Time and memory of a diagnosis: two states, the whole catalogue at every port, default settings.

    python benchmarks/diagnosis_speed.py [--samples 1e4 5e4 1e6] [--n-jobs 2] [--out x.json]

A mass on a spring that hardens is recorded, and simulated without the hardening and with wrong
parameters. Every size runs in a process of its own, after a short record that loads and compiles.
"""

import argparse
import time

import numpy as np
from harness.measure import reset_peak_memory, run_fresh
from harness.tables import format_table, save_json

DT = 0.05  # s
NOMINAL = {"gain [m/s^2/V]": 1.0, "damping [1/s]": 0.8, "stiffness [1/s^2]": 12.0}
TRUE = {"gain": 1.1, "damping": 0.7, "stiffness": 11.0}
HARDENING = 15.0  # 1/m^2/s^2
HELD, DRIVE, NOISE = 10, 3.0, 0.02  # samples, V, m


def stage(x, u, p):
    """What the user simulates."""
    return x[1], p[0] * u[0] - p[1] * x[1] - p[2] * x[0]


def machine(x, u, p):
    """What was recorded."""
    return x[1], p[0] * u[0] - p[1] * x[1] - p[2] * x[0] - HARDENING * x[0] ** 3


def record(n_samples: int) -> tuple[np.ndarray, np.ndarray]:
    """Return input and noisy output of the machine."""
    from narx_sklearn import ODESimulator

    rng = np.random.default_rng(0)
    u = np.repeat(rng.normal(0.0, DRIVE, -(-n_samples // HELD)), HELD)[:n_samples]
    plant = ODESimulator(machine, dt=DT, parameters=TRUE, states=["x", "v"], inputs=["u"])
    return u, plant.simulate(u)[:, 0] + NOISE * rng.standard_normal(n_samples)


def job(task: dict) -> dict:
    """Diagnose one record (runs in a process of its own)."""
    from narx_sklearn import DiscrepancyRegressor, ODESimulator

    u, y = record(task["samples"])
    simulator = ODESimulator(
        stage, dt=DT, parameters=NOMINAL, states=["position [m]", "velocity [m/s]"], inputs=["drive [V]"]
    )
    diagnosis = DiscrepancyRegressor(simulator, n_jobs=task["n_jobs"])
    diagnosis.fit(*record(2000))  # loads and compiles
    reset_peak_memory()
    wall, processor = time.perf_counter(), time.process_time()
    diagnosis.fit(u, y)
    return {
        "wall_s": time.perf_counter() - wall,
        "processor_s": time.process_time() - processor,
        "verdict": diagnosis.verdict_,
        "effects": [finding.effect for finding in diagnosis.findings_],
    }


def main() -> None:
    """Measure every size, print a table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--samples", type=float, nargs="+", default=[1e4, 5e4])
    parser.add_argument("--n-jobs", type=int, nargs="+", default=[1, 2])
    parser.add_argument("--memory-gb", type=float, default=8.0)
    parser.add_argument("--out", help="write the raw results to this JSON file")
    options = parser.parse_args()
    results, rows = [], []
    for n_samples in map(int, options.samples):
        for n_jobs in options.n_jobs:
            task = {"samples": n_samples, "n_jobs": n_jobs}
            found = run_fresh(
                "diagnosis_speed:job", task, threads=1, limit_s=3600, memory_gb=options.memory_gb
            )
            results.append({**task, **found})
            if "failed" in found:
                rows.append([n_samples, n_jobs, found["failed"], "", "", ""])
                continue
            said = f"{found['verdict']}: {', '.join(found['effects'])}"
            seconds = f"{found['wall_s']:.1f}", f"{found['processor_s']:.1f}"
            rows.append([n_samples, n_jobs, *seconds, f"{found['peak_mb']:.0f}", said])
            print(rows[-1], flush=True)
    print(format_table(["samples", "n_jobs", "wall s", "processor s", "peak MB", "verdict"], rows))
    save_json(options.out, results)


if __name__ == "__main__":
    main()
