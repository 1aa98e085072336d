"""One concealed case, told as a story.

Somebody recorded a stage and wrote a simulation of it. The two curves lie on each other; the difference
looks like noise. Still a part of it is not: the guide rubs. The script shows what the eye sees, where the
tool looks, what it says, and the corrected simulation on another recording. The truth is revealed last.

Run ``python examples/concealed_effect.py --out folder``.
"""

import argparse
from pathlib import Path

import numpy as np

from narx_sklearn import DiscrepancyRegressor, ODESimulator

DT = 0.01  # s
MASS, DAMPING, STIFFNESS, FORCE_CONSTANT, FRICTION = 1.0, 4.0, 150.0, 4.0, 0.25  # kg, N s/m, N/m, N/V, N
NOISE = 3.0e-3  # m


def machine(drive, random_state):
    """The machine itself: friction by implicit small steps, a rule that no simulation here uses."""
    rng = np.random.default_rng(random_state)
    x, v, h = 0.0, 0.0, DT / 20
    position = np.empty(drive.size)
    for k, u in enumerate(drive.tolist()):
        position[k] = x
        for _ in range(20):
            free = v + h * (FORCE_CONSTANT * u - STIFFNESS * x) / MASS
            slowed = max(abs(free) - h * FRICTION / MASS, 0.0) / (1 + h * DAMPING / MASS)
            v = slowed if free > 0 else -slowed
            x += h * v
    return position + NOISE * rng.normal(size=drive.size)


def stage(x, u, p):
    """The simulation: a mass, a spring and a damper."""
    return x[1], p[0] * u[0] - p[1] * x[1] - p[2] * x[0]


def random_levels(n, size, random_state):
    """Levels held 0.5 s each, with corners rounded."""
    levels = np.repeat(np.random.default_rng(random_state).uniform(-size, size, -(-n // 50)), 50)[:n]
    return np.convolve(levels, np.ones(15) / 15)[:n]


def main(out):
    out.mkdir(parents=True, exist_ok=True)
    simulator = ODESimulator(
        stage,
        dt=DT,
        parameters={"gain [m/s^2/V]": 4.4, "damping [1/s]": 5.0, "stiffness [1/s^2]": 160.0},
        states=["position [m]", "velocity [m/s]"],
        inputs=["drive [V]"],
    )
    drive = random_levels(5000, 2.5, 0)
    position = machine(drive, 1)
    dx = DiscrepancyRegressor(simulator).fit(drive, position)
    print(dx.report_)

    other = random_levels(1500, 1.2, 2)  # another recording, at half the amplitude
    measured = machine(other, 3)
    before = dx.refitted_simulator_.simulate(other)[:, 0]
    after = dx.predict(other)
    error = {"refitted": np.std(measured - before), "corrected": np.std(measured - after)}
    print(f"Another recording: error {1e3 * error['refitted']:.2f} mm refitted, ", end="")
    print(f"{1e3 * error['corrected']:.2f} mm corrected, noise {1e3 * NOISE:.2f} mm.")
    print(f"The truth: a guide that rubs with {FRICTION / MASS:.2f} N/kg.")
    draw(out, dx, drive, position, measured, before, after, other)


def draw(out, dx, drive, position, measured, before, after, other):
    import matplotlib.pyplot as plt

    time, refitted = DT * np.arange(drive.size), dx.refitted_simulator_.simulate(drive)[:, 0]
    fig, axes = plt.subplots(2, 2, figsize=(10, 6.4), layout="constrained")
    part = slice(1000, 1800)
    ax = axes[0, 0]
    ax.plot(time[part], 1e3 * position[part], color="0.55", lw=2.5, label="recorded")
    ax.plot(time[part], 1e3 * refitted[part], color="tab:blue", lw=1, label="simulated, refitted")
    ax.set(title="What the eye sees: they agree", xlabel="time [s]", ylabel="position [mm]")
    ax.legend(loc="lower right", fontsize=8)
    ax = axes[0, 1]
    ax.plot(time[part], 1e3 * (position - refitted)[part], color="0.35", lw=0.7)
    ax.set(title="The difference: looks like noise", xlabel="time [s]", ylabel="residual [mm]")
    ax = axes[1, 0]
    velocity = np.gradient(refitted, DT)
    force = dx.location_.force
    at = force["sample"].to_numpy()
    ax.plot(velocity[at], force["force"], ".", ms=2, color="0.7", label="unknown force, estimated")
    if dx.findings_ and "Fc" in dx.findings_[0].parameters:
        level = dx.findings_[0].parameters["Fc"]
        # the refit had made damping of part of the friction; the unknown force is what that leaves
        hidden = dx.parameters_.loc["damping", "refitted"] - dx.parameters_.loc["damping", "augmented"]
        v = np.linspace(velocity[at].min(), velocity[at].max(), 401)
        name = f"{dx.findings_[0].title}, less the refit's damping"
        ax.plot(v, hidden * v - level * np.sign(v), color="tab:red", lw=2, label=name)
    ax.set(title=f"Where it looks: {dx.verdict_}", xlabel="velocity [m/s]", ylabel="force per mass [m/s²]")
    ax.legend(loc="upper right", fontsize=8)
    ax = axes[1, 1]
    t = DT * np.arange(other.size)
    window = slice(300, 900)
    for run, colour, name in ((before, "tab:blue", "refitted"), (after, "tab:red", "corrected")):
        smooth = np.convolve(measured - run, np.ones(15) / 15, mode="same")
        ax.plot(t[window], 1e3 * smooth[window], color=colour, lw=1, label=f"{name}: error, 15-sample mean")
    ax.set(title="Another recording, half the amplitude", xlabel="time [s]", ylabel="error [mm]")
    ax.legend(loc="lower right", fontsize=8)
    fig.savefig(Path(out) / "concealed_effect.png", dpi=110)
    plt.close(fig)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, default=Path(), help="folder for the figure")
    main(parser.parse_args().out)
