"""Physics that no catalogue holds: write your own effect in six lines, and let the diagnosis find it.

A pendulum swings past a magnet that nobody modelled. What a magnet does is known to whoever built the bench;
as an effect it takes part in the search beside friction, drag and stiffness, and must win on its merits.
"""

import argparse
from pathlib import Path

import numpy as np

from narx_sklearn.discrepancy import DiscrepancyRegressor, ODESimulator
from narx_sklearn.displays import EffectCurveDisplay
from narx_sklearn.physics.effects import Effect, EffectParameter, register_effect, unregister_effect

RIVALS = ["coulomb_friction", "quadratic_drag", "cubic_stiffness"]
BENCH = {
    "dt": 0.02,
    "parameters": {"drive [rad/s^2/A]": 3.0, "damping [1/s]": 0.4, "stiffness [1/s^2]": 20.0},
    "states": ["angle [rad]", "speed [rad/s]"],
    "inputs": ["current [A]"],
}


def magnet(argument, rate, own, second, time, step, z, theta, dz):
    """Pull towards the magnet at zero, theta[0] strong and theta[1] wide."""
    distance = argument / theta[1]
    return -theta[0] * distance / (1.0 + distance * distance) ** 2


def likely_values(setting):
    """Return strengths and widths worth trying: a tenth of what moves the port, parts of the travel."""
    strength, travel = 0.1 * np.std(setting.own), np.std(setting.argument)
    return np.array([[sign * strength, share * travel] for sign in (1, -1) for share in (0.2, 0.5, 1.0)])


MAGNET = Effect(
    code="magnet",
    title="Magnet",
    sentence="A magnet pulls where the pendulum passes it.",
    equation="-a (x/w) / (1 + (x/w)^2)^2",
    parameters=(EffectParameter("a", "{port}"), EffectParameter("w", "{arg}", 1e-6)),
    starts=likely_values,
    force=magnet,
    argument="position",
    lookalikes=("cubic_stiffness",),
    separate_by="an amplitude ladder from well inside the width to well outside",
)


def pendulum(x, u, p):
    """Small angles, viscous friction."""
    return x[1], p[0] * u[0] - p[1] * x[1] - p[2] * x[0]


def magnetic_pendulum(x, u, p):
    """What the bench really does."""
    near = x[0] / 0.1
    return x[1], p[0] * u[0] - p[1] * x[1] - p[2] * x[0] - 4.0 * near / (1.0 + near * near) ** 2


def main(folder: Path) -> None:
    """Register, diagnose, draw."""
    folder.mkdir(parents=True, exist_ok=True)
    rng = np.random.default_rng(0)
    current = np.repeat(rng.normal(0, 2, 150), 12)
    angle = ODESimulator(magnetic_pendulum, **BENCH).simulate(current)[:, 0]
    angle += 0.002 * rng.normal(size=angle.size)

    register_effect(MAGNET)
    try:
        dx = DiscrepancyRegressor(
            ODESimulator(pendulum, **BENCH), effects=["magnet", *RIVALS], max_effects=1, n_leaders=4
        ).fit(current[:, None], angle)
    finally:
        unregister_effect("magnet")
    print(dx.report_)
    if dx.simulator_.effects:
        EffectCurveDisplay.from_estimator(dx).figure_.savefig(folder / "own_effect.png", dpi=110)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, default=Path(), help="folder for the figure")
    main(parser.parse_args().out)
