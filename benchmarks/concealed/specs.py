"""What a case is to be: cell, stratum, plant, effects, depth, noise and input."""

from dataclasses import dataclass

from benchmarks.concealed.plants.codes import Code
from benchmarks.concealed.plants.machine import Site

__all__ = ["Concealed", "Spec"]


@dataclass(frozen=True)
class Concealed:
    """One effect at one site, to be concealed to a structural residual of `depth` times the noise."""

    code: Code
    site: Site
    depth: float
    start: float = 0.0  # share of the recording at which it begins
    stop: float = float("inf")


@dataclass(frozen=True)
class Spec:
    """The recipe of a case; `seed` draws everything it leaves open."""

    cell: str
    stratum: str
    plant: str
    effects: tuple[Concealed, ...]
    noise: str
    excitation: str
    closed_loop: bool
    seed: tuple[int, ...]
    n_samples: int = 4000
    mismatch: tuple[float, float] = (
        0.03,
        0.3,
    )  # relative errors of the nominal parameters, smallest and largest
