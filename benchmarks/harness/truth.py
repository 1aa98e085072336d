"""Two known nine-term systems and the scenarios in which they are to be found again.

`MIXED` is a system of products and cubes over three output and three input lags. Inputs stay within +-1: five
million samples of white, of coloured and of corner-to-corner input did not take it beyond |y| = 2.2.

    y[k] = 0.45 y[k-1] - 0.2 y[k-3] + 0.4 u[k-1] + 0.25 u[k-2] + 0.12 y[k-1] u[k-2] - 0.15 u[k-1] u[k-3]
           - 0.07 y[k-2]^3 + 0.12 u[k-1]^2 u[k-2] - 0.07 y[k-1] y[k-2] u[k-3]

`CLOSED` has with every term all terms obtained by dropping factors, so that its set of terms is the same
whatever unit and origin the signals have. It plays a heater: current in mA around 12, temperature in K around
300.

    y[k] = 0.05 + 0.65 y[k-1] - 0.2 y[k-3] + 0.5 u[k-1] + 0.3 u[k-2] + 0.2 u[k-3]
           - 0.2 u[k-1]^2 - 0.25 u[k-1]^3 - 0.2 y[k-1] u[k-2]
"""

from dataclasses import dataclass

import numpy as np
from scipy.signal import lfilter

from harness.polynomial import Term, free_run

MIXED: dict[Term, float] = {
    (("y", 1),): 0.45,
    (("y", 3),): -0.2,
    (("u", 1),): 0.4,
    (("u", 2),): 0.25,
    (("u", 2), ("y", 1)): 0.12,
    (("u", 1), ("u", 3)): -0.15,
    (("y", 2), ("y", 2), ("y", 2)): -0.07,
    (("u", 1), ("u", 1), ("u", 2)): 0.12,
    (("u", 3), ("y", 1), ("y", 2)): -0.07,
}
CLOSED: dict[Term, float] = {
    (): 0.05,
    (("y", 1),): 0.65,
    (("y", 3),): -0.2,
    (("u", 1),): 0.5,
    (("u", 2),): 0.3,
    (("u", 3),): 0.2,
    (("u", 1), ("u", 1)): -0.2,
    (("u", 1), ("u", 1), ("u", 1)): -0.25,
    (("u", 2), ("y", 1)): -0.2,
}
BURN_IN = 200


@dataclass(frozen=True)
class Scenario:
    """How a record is made: which system, which input, which noise (relative to the output's deviation)."""

    system: dict[Term, float]
    coloured_input: bool = False
    equation_noise: float = 0.0
    output_noise: float = 0.0
    origin: tuple[float, float] = (0.0, 0.0)  # of u and y
    unit: tuple[float, float] = (1.0, 1.0)
    standardised: bool = False  # the methods are handed standardised signals


@dataclass(frozen=True)
class Record:
    """A noisy training record and a noise-free test record."""

    u: np.ndarray
    y: np.ndarray
    u_test: np.ndarray
    y_test: np.ndarray


HEATER = {"origin": (12.0, 300.0), "unit": (4.0, 8.0)}
SCENARIOS = {
    "no noise": Scenario(MIXED),
    "equation noise": Scenario(MIXED, equation_noise=0.05),
    "coloured input": Scenario(MIXED, coloured_input=True, equation_noise=0.03),
    "output noise": Scenario(MIXED, output_noise=0.05),
    "physical units": Scenario(CLOSED, equation_noise=0.1, **HEATER),
    "physical units, standardised by hand": Scenario(CLOSED, equation_noise=0.1, standardised=True, **HEATER),
}


def make_record(scenario: Scenario, seed: int, n_train: int = 2000, n_test: int = 2000) -> Record:
    """Simulate the system; the same seed always gives the same record."""
    rng = np.random.default_rng(seed)
    terms, theta = list(scenario.system), np.array(list(scenario.system.values()))
    u, u_test = (_make_input(scenario, rng, BURN_IN + n) for n in (n_train, n_test))
    y_clean, y_test = (free_run(terms, theta, signal, np.zeros(3)) for signal in (u, u_test))
    deviation = y_clean.std()
    # Equation noise enters as one more input of the recursion, with parameter one.
    e = rng.normal(size=len(u)) * deviation * scenario.equation_noise
    y = _simulate_with_noise(terms, theta, u, e) if scenario.equation_noise else y_clean
    y = y + rng.normal(size=len(u)) * deviation * scenario.output_noise
    (u0, y0), (u1, y1) = scenario.origin, scenario.unit
    signals = [u0 + u1 * u, y0 + y1 * y, u0 + u1 * u_test, y0 + y1 * y_test]
    if scenario.standardised:
        u_scale, y_scale = ((s[BURN_IN:].mean(), s[BURN_IN:].std()) for s in signals[:2])
        scales = (u_scale, y_scale, u_scale, y_scale)
        signals = [(s - mean) / std for s, (mean, std) in zip(signals, scales, strict=True)]
    return Record(*(signal[BURN_IN:] for signal in signals))


def _make_input(scenario: Scenario, rng: np.random.Generator, n_samples: int) -> np.ndarray:
    if not scenario.coloured_input:
        return rng.uniform(-1.0, 1.0, n_samples)
    pole = 0.9
    coloured = lfilter([np.sqrt(1 - pole**2)], [1.0, -pole], rng.normal(size=n_samples))
    return np.clip(0.5 * coloured, -1.0, 1.0)


def _simulate_with_noise(terms: list[Term], theta: np.ndarray, u: np.ndarray, e: np.ndarray) -> np.ndarray:
    signals = {"u": u, "y": np.zeros(len(u))}
    y = signals["y"]
    for k in range(3, len(u)):
        y[k] = e[k]
        for term, parameter in zip(terms, theta, strict=True):
            value = parameter
            for signal, lag in term:
                value *= signals[signal][k - lag]
            y[k] += value
    return y
