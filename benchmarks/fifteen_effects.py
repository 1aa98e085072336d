"""One mass on a spring, fifteen ways to be wrong about it: named first, and down to the noise.

    python benchmarks/fifteen_effects.py [--seed 0] [--noise 0.01 0.05] [--known narx] [--jobs 2]

Every effect is recorded under 1 % and 5 % of noise; the simulation lacks it and starts from wrong parameters.
What is known of it: its equations, a NARX model, its output alone, or a program that answers to parameters.
The machine is stepped by semi-implicit Euler at a four-hundredth of the sampling period (at a fortieth, the
steps' own error stands out of 1 % of noise), dry friction by impulses (Moreau 1988), and shares no code with
the package. The last fifth of each record is held out.
"""

import argparse
import warnings
from concurrent.futures import ProcessPoolExecutor

import numpy as np
from harness.tables import format_table, save_json
from numba import njit

DT, FINE, N_SAMPLES = 0.02, 400, 4000  # s, steps a sample, samples
HELD_OUT = 0.2
GAIN, DAMPING, STIFFNESS = 10.0, 1.2, 40.0  # m/s^2/V, 1/s, 1/s^2
NOMINAL = {"gain [m/s^2/V]": 9.0, "damping [1/s]": 1.5, "stiffness [1/s^2]": 43.0}
EFFECTS = (
    "coulomb_friction",
    "stribeck_friction",
    "quadratic_drag",
    "cubic_stiffness",
    "quadratic_stiffness",
    "bilinear_stiffness",
    "clearance",
    "bouc_wen_hysteresis",
    "periodic_disturbance",
    "backlash",
    "dead_zone",
    "input_saturation",
    "input_polynomial",
    "delay",
    "sensor_clip",
)
NOTHING = "none"
KNOWN = ("equations", "narx", "trace", "program")
DELAY = 0.07  # s


@njit
def spring(code, x, t, z):
    """Return what the effects that depend on position, time or memory add to the acceleration."""
    if code == 3:
        return -12.0 * x**3
    if code == 4:
        return -4.0 * x**2
    if code == 5:
        return -6.0 * max(x, 0.0)
    if code == 6:
        return -40.0 * (x - min(max(x, -0.9), 0.9))
    if code == 7:
        return -20.0 * z
    if code == 8:
        return 1.5 * np.sin(2.0 * np.pi * 0.83 * t + 0.4)
    return 0.0


@njit
def machine(code, u):
    """Return the position of the machine at every sample, from rest."""
    h = DT / FINE
    y = np.empty(u.size)
    x = v = z = 0.0
    for k in range(u.size):
        y[k] = min(x, 1.0) if code == 14 else x
        command = u[k]
        if code == 9:  # a gear with play
            z = min(max(z, command - 0.25), command + 0.25)
            command = z
        elif code == 10:
            command -= min(max(command, -0.4), 0.4)
        elif code == 11:
            command = min(max(command, -2.2), 2.2)
        elif code == 12:
            command += 0.12 * command**2
        for i in range(FINE):
            t = (k + i / FINE) * DT
            if code == 13:
                late = int(np.floor((t - DELAY) / DT + 1e-9))
                command = u[late] if late >= 0 else 0.0
            v += h * (GAIN * command - DAMPING * v - STIFFNESS * x + spring(code, x, t, z))
            if code == 2:
                v -= h * 0.2 * v * abs(v)
            if code == 0 or code == 1:
                level = 1.2 if code == 0 else 0.8 + 0.9 * np.exp(-((v / 0.4) ** 2))
                v = np.sign(v) * max(abs(v) - h * level, 0.0)
            x += h * v
            if code == 7:  # A = 1, b = g = 10, n = 1
                z += h * (v - 10.0 * abs(v) * z - 10.0 * v * abs(z))
    return y


def drive(rng: np.random.Generator) -> np.ndarray:
    """Return levels of random height and length, and five sines."""
    levels = np.concatenate(
        [np.full(rng.integers(5, 60), rng.uniform(-3.0, 3.0)) for _ in range(N_SAMPLES // 5)]
    )[:N_SAMPLES]
    time = DT * np.arange(N_SAMPLES)
    sines = sum(np.sin(2 * np.pi * f * time + rng.uniform(0, 6)) for f in (0.17, 0.45, 0.9, 1.3, 2.1))
    return levels + 0.3 * sines


def simulation(known: str, u: np.ndarray):
    """Return the simulator, as far as it is known."""
    from narx_sklearn import NARXRegressor, ODESimulator
    from narx_sklearn.discrepancy import CallableSimulator, NARXSimulator, TraceSimulator

    def stage(x, u, p):
        return x[1], p[0] * u[0] - p[1] * x[1] - p[2] * x[0]

    equations = ODESimulator(
        stage, dt=DT, parameters=NOMINAL, states=["position [m]", "velocity [m/s]"], inputs=["drive [V]"]
    )
    if known == "equations":
        return equations
    if known == "program":

        def program(u, parameters):
            return equations.with_parameters(parameters).simulate(u)

        return CallableSimulator(program, DT, NOMINAL, ["drive [V]"], ["position [m]"])
    y_sim = equations.simulate(u)[:, 0]
    if known == "trace":
        return TraceSimulator(y_sim, dt=DT)
    return NARXSimulator(NARXRegressor(2, 2, degree=1).fit(u[:, None], y_sim).model_, dt=DT)


def trial(effect: str, noise: float, seed: int, known: str) -> dict:
    """Record, diagnose, compare."""
    from narx_sklearn import DiscrepancyRegressor

    code = EFFECTS.index(effect) if effect in EFFECTS else -1
    rng = np.random.default_rng([seed, code + 1, round(1000 * noise)])
    u = drive(rng)
    clean = machine(code, u)
    level = noise * clean.std()
    disturbance = level * rng.standard_normal(N_SAMPLES)
    simulator = simulation(known, u)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        diagnosis = DiscrepancyRegressor(simulator, test_fraction=HELD_OUT, random_state=0).fit(
            u, clean + disturbance
        )
    (scored,) = diagnosis.held_out_.itertuples()
    floor = np.sqrt(np.mean(disturbance[scored.scored_from : scored.stop] ** 2))
    errors = diagnosis.scores_["rmse"]
    return {
        "effect": effect,
        "noise": noise,
        "verdict": diagnosis.verdict_,
        "named": [finding.effect for finding in diagnosis.findings_],
        "refitted_over_noise": float(errors["refitted"] / floor),
        "augmented_over_noise": float(errors["augmented"] / floor),
    }


def main() -> None:
    """Run all trials, print a table and the counts."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--noise", type=float, nargs="+", default=[0.01, 0.05])
    parser.add_argument("--known", choices=KNOWN, default=KNOWN[0], help="what is known of the simulation")
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument("--out", help="write the raw results to this JSON file")
    options = parser.parse_args()
    tasks = [
        (effect, noise, options.seed, options.known)
        for effect in (*EFFECTS, NOTHING)
        for noise in options.noise
    ]
    with ProcessPoolExecutor(options.jobs) as pool:
        results = list(pool.map(trial, *zip(*tasks, strict=True)))
    rows = [
        (
            r["effect"],
            f"{100 * r['noise']:g} %",
            r["verdict"],
            " + ".join(r["named"]) or "-",
            r["refitted_over_noise"],
            r["augmented_over_noise"],
        )
        for r in results
    ]
    header = ("effect", "noise", "verdict", "named", "error / noise, refitted", "augmented")
    print(format_table(header, rows))
    cases = [r for r in results if r["effect"] != NOTHING]
    first = sum(r["named"][:1] == [r["effect"]] for r in cases)
    down = sum(r["augmented_over_noise"] <= 1.02 for r in cases)
    quiet = sum(r["verdict"] in ("consistent", "refit") for r in results if r["effect"] == NOTHING)
    print(f"\nnamed first {first} of {len(cases)}; within 2 % of the noise {down} of {len(cases)}; ", end="")
    print(f"nulls without a name {quiet} of {len(results) - len(cases)}")
    save_json(options.out, {"seed": options.seed, "known": options.known, "results": results})


if __name__ == "__main__":
    main()
