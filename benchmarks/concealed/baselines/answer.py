"""What a baseline answers, and the corrected free run of one that found a function for a state equation."""

from dataclasses import dataclass, field

import numpy as np

__all__ = ["Answer", "corrected_runs"]


@dataclass(frozen=True)
class Answer:
    """`missing`: it says that something is missing; `named`: what, by catalogue code; held-out free runs."""

    missing: bool | None
    named: str | None = None
    runs: dict[str, np.ndarray] = field(default_factory=dict)


def corrected_runs(bench, added) -> dict[str, np.ndarray]:
    """Return held-out free runs of the nominal plus ``added(x, u)``, by Runge-Kutta steps of order two.

    `added` takes one state and one input, each with a leading axis of one, and returns the missing rates.
    """
    runs = {}
    for name, u in bench.heldout.items():
        x, states = bench.x0.copy(), np.empty((len(u), bench.x0.size))
        for k, now in enumerate(u):
            states[k] = x
            with np.errstate(all="ignore"):
                half = x + 0.5 * bench.machine.dt * (bench.rates(x, now) + added(x[None], now[None]))
                x = x + bench.machine.dt * (bench.rates(half, now) + added(half[None], now[None]))
            if not np.all(np.abs(x) < 1e9):
                states[k + 1 :] = np.nan
                break
        runs[name] = states[:, list(bench.machine.measured)]
    return runs
