"""The cells T0 to T10 as lists of recipes, one batch per seed."""

import itertools
import zlib
from dataclasses import replace

import numpy as np

from benchmarks.concealed.excitation import POOR, RICH
from benchmarks.concealed.noise import NOISES
from benchmarks.concealed.plants.codes import CATALOGUE, FURTHER_OUTSIDE, OUTSIDE, THIRD_OUTSIDE, Code
from benchmarks.concealed.plants.dispatch import MACHINES
from benchmarks.concealed.specs import Concealed, Spec

__all__ = ["CELLS", "DEPTHS", "LOOKALIKES", "recipes"]

DEPTHS = {"R>=0.3": (0.3, 3.0), "R>=0.15": (0.15, 0.3), "R>=0.1": (0.1, 0.15)}  # T2
FAINT = (0.03, 0.06)  # T3
PLAIN = (0.3, 3.0)
STRONG = (1.0, 3.0)

# Effect pairs of which the second shows only once the first is modelled.
MASKED = (
    (Code.cubic_stiffness, Code.coulomb_friction),
    (Code.coulomb_friction, Code.quadratic_drag),
    (Code.input_saturation, Code.coulomb_friction),
    (Code.overflow, Code.input_polynomial),
    (Code.gravity, Code.coulomb_friction),
    (Code.constant_load, Code.stribeck_friction),
    (Code.root_outflow, Code.lag),
    (Code.gain_drift, Code.cubic_stiffness),
    (Code.quadratic_drag, Code.dead_zone),
    (Code.cogging, Code.coulomb_friction),
)
# Effects that one cannot tell apart on a poor recording; the set reported should hold the truth.
LOOKALIKES = (
    Code.coulomb_friction,
    Code.asymmetric_friction,
    Code.stribeck_friction,
    Code.quadratic_drag,
    Code.cubic_stiffness,
    Code.quadratic_stiffness,
    Code.bilinear_stiffness,
    Code.gravity,
    Code.input_saturation,
    Code.dead_zone,
    Code.backlash,
    Code.delay,
    Code.lag,
    Code.sensor_clip,
    Code.root_outflow,
)
# Effects that live in a region of a signal, or that began at some time: T10 scores where they are.
REGIONAL = (Code.clearance, Code.input_saturation, Code.overflow, Code.sensor_clip, Code.dead_zone)
TIMED = (
    Code.coulomb_friction,
    Code.quadratic_drag,
    Code.cubic_stiffness,
    Code.input_saturation,
    Code.dead_zone,
    Code.constant_load,
    Code.periodic_disturbance,
)


def recipes(cell: str, seed: int, n_samples: int = 4000, plants=None) -> list[list[Spec]]:
    """Return the recipes of a cell for one seed, each with alternatives should its depth be out of reach."""
    if cell not in CELLS:
        raise ValueError(f"cell {cell!r} is not built; cells are {', '.join(CELLS)}.")
    names = [name for name in MACHINES if not plants or name in plants]
    found = CELLS[cell](seed, _Draw(cell, seed, names))
    return [[replace(spec, n_samples=n_samples) for spec in options] for options in found if options]


class _Draw:
    """Seeded choices of plant, site, noise and input for the cases of one cell and seed."""

    N_OPTIONS = 6

    def __init__(self, cell, seed, plants):
        self.cell, self.seed, self.plants = cell, seed, plants

    def case(self, stratum, effects=(), depths=(), *, allowed=None, turn=0, **fixed):
        """Return the options of one case: the plants take turns, the rest is drawn."""
        allowed = [p for p in (allowed or self.plants) if p in self.plants and _can_hold(p, effects)]
        options = []
        for attempt in range(self.N_OPTIONS if allowed else 0):
            key = f"{self.cell}|{stratum}|{[e.name for e in effects]}|{attempt}"
            seed = (self.seed, zlib.crc32(key.encode()))
            rng = np.random.default_rng(seed)
            first = zlib.crc32(f"{self.cell}|{stratum}|{effects}".encode())
            plant = allowed[(first + self.seed + turn + attempt) % len(allowed)]
            machine = MACHINES[plant]
            concealed = tuple(
                Concealed(code, _pick(machine.sites[code], rng), float(np.exp(rng.uniform(*np.log(depth)))))
                for code, depth in zip(effects, depths, strict=True)
            )
            spec = Spec(
                self.cell,
                stratum,
                plant,
                concealed,
                str(rng.choice(["white", "white", "ar1"])),
                str(rng.choice(RICH)),
                machine.closed_only,
                seed,
            )
            if machine.control is None:
                fixed = {**fixed, "closed_loop": False}
            elif machine.closed_only:
                fixed = {**fixed, "closed_loop": True}
            options.append(replace(spec, **fixed))
        return options

    def gate(self, options, rng):
        """Let the effect be there during one stretch only."""
        start = rng.uniform(0.2, 0.5)
        stop = start + rng.uniform(0.2, 0.4)
        return [
            replace(spec, effects=tuple(replace(e, start=start, stop=stop) for e in spec.effects))
            for spec in options
        ]


def _pick(sites, rng):
    return sites[int(rng.integers(len(sites)))]


def _can_hold(plant, effects):
    return all(code in MACHINES[plant].sites for code in effects)


def _nothing(seed, draw):
    loops = [name for name, m in MACHINES.items() if m.control is not None]
    cases = [draw.case(noise, noise=noise, turn=i) for i, noise in enumerate(NOISES)]
    noise = NOISES[seed % 3]
    return [*cases, draw.case("closed loop", noise=noise, closed_loop=True, allowed=loops)]


def _parameters_only(seed, draw):
    return [
        draw.case(noise, noise=noise, mismatch=(0.1, 0.3), turn=3 * i)
        for i, noise in enumerate(("white", "ar1"))
    ]


def _one_effect(seed, draw):
    return [draw.case(stratum, (code,), (depth,)) for stratum, depth in DEPTHS.items() for code in CATALOGUE]


def _faint_effect(seed, draw):
    return [draw.case("R<=0.06", (code,), (FAINT,)) for code in CATALOGUE]


def _masked(seed, draw):
    return [draw.case("masked", pair, (STRONG, PLAIN)) for pair in MASKED]


def _pairs(seed, draw):
    rng = np.random.default_rng((seed, 5))
    options = []
    for name in draw.plants:
        codes = [c for c in MACHINES[name].sites if c in CATALOGUE and c not in _UNPAIRED]
        pairs = [p for p in itertools.combinations(codes, 2) if not _alike(*p)]
        for i in rng.choice(len(pairs), size=2, replace=False):
            options.append(draw.case("pair", pairs[i], (PLAIN, PLAIN), allowed=[name]))
    return options


_ON_INPUT = {Code.input_saturation, Code.dead_zone, Code.backlash}
_UNPAIRED = {Code.stuck_sensor, Code.quantisation}
_FAMILIES = (
    {
        Code.coulomb_friction,
        Code.asymmetric_friction,
        Code.stribeck_friction,
        Code.presliding_friction,
        Code.load_friction,
        Code.bouc_wen_hysteresis,
        Code.prandtl_ishlinskii,
    },
    {Code.cubic_stiffness, Code.quadratic_stiffness, Code.bilinear_stiffness, Code.clearance, Code.gravity},
    {Code.delay, Code.lag, Code.backlash, Code.valve_stiction, Code.rate_limit},
    {Code.input_saturation, Code.input_polynomial, Code.dead_zone, Code.bilinear_input},
    {Code.additive_drift, Code.sensor_bias, Code.constant_load, Code.creep, Code.gain_drift},
)


def _alike(a, b):
    return any(a in family and b in family for family in _FAMILIES)


def _outside(seed, draw):
    codes = OUTSIDE + FURTHER_OUTSIDE + THIRD_OUTSIDE
    return [draw.case(code.name, (code,), ((0.5, 3.0),)) for code in codes]


def _hard_to_see(seed, draw):
    unseen = [name for name, m in MACHINES.items() if m.unmeasured]
    loops = [name for name, m in MACHINES.items() if m.control is not None]
    cases = []
    for stratum, allowed in (("unmeasured state", unseen), ("closed loop", loops)):
        for code in CATALOGUE:
            closed = {"closed_loop": True} if stratum == "closed loop" else {}
            cases.append(draw.case(stratum, (code,), (PLAIN,), allowed=allowed, **closed))
    return cases


def _poor(seed, draw):
    """On two levels only, what an actuator does to its command is a gain: those get the other poor inputs."""
    cases = []
    for i, code in enumerate(LOOKALIKES):
        kinds = [k for k in POOR if k != "square" or code not in _ON_INPUT]
        kind = kinds[(seed + i) % len(kinds)]
        cases.append(draw.case("poor input", (code,), (PLAIN,), excitation=kind))
    return cases


def _where(seed, draw):
    rng = np.random.default_rng((seed, 10))
    regional = [draw.case("region", (code,), (PLAIN,)) for code in REGIONAL]
    timed = [draw.gate(draw.case("time", (code,), (PLAIN,)), rng) for code in TIMED]
    return regional + timed


CELLS = {
    "T0": _nothing,
    "T1": _parameters_only,
    "T2": _one_effect,
    "T3": _faint_effect,
    "T4": _masked,
    "T5": _pairs,
    "T6": _outside,
    "T7": _hard_to_see,
    "T8": _poor,
    "T9": _poor,
    "T10": _where,
}
