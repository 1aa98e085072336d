"""The recordings, each with a nominal simulator that lacks what its authors documented.

Nominal parameters are round numbers of the right order; the diagnosis refits them first. Everything that is
decided is decided on the training parts.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from narx_sklearn import ODESimulator
from narx_sklearn.datasets import (
    fetch_bh_loops,
    fetch_bouc_wen,
    fetch_cascaded_tanks,
    fetch_emps,
    fetch_f16,
    fetch_mr_damper,
    fetch_silverbox,
)
from narx_sklearn.discrepancy.simulators.simulator import Simulator

FORCE_PER_VOLT = 35.15065188248547  # N/V, drive of EMPS as documented


@dataclass(frozen=True)
class Part:
    """A record: inputs, outputs, and how many first samples may fix the initial state."""

    u: np.ndarray  # (n_samples, n_inputs)
    y: np.ndarray  # (n_samples, n_outputs)
    n_init: int = 50
    sessions: np.ndarray | None = None  # (n_samples,)


@dataclass(frozen=True)
class Case:
    """A recording and a simulation of it that is not right."""

    name: str
    simulator: Simulator
    train: Part
    tests: dict[str, Part]
    unit: str
    per_unit: float = 1.0  # of the recorded unit: 1000 turns V into mV
    settings: Mapping[str, Any] = field(default_factory=dict)  # of the DiscrepancyRegressor


def _part(frame, data, n_init: int | None = None) -> Part:
    y = np.atleast_2d(frame[data.output].to_numpy(dtype=float).T).T
    return Part(frame[data.input].to_numpy(dtype=float), y, data.n_init if n_init is None else n_init)


def for_linear_hold(u: np.ndarray) -> np.ndarray:
    """Return samples of a band-limited input whose linear interpolation has the input's spectrum.

    A straight line between samples attenuates the frequency f by sinc^2(f dt); the samples are raised by as
    much before. The record is mirrored at its end, so that the Fourier transform sees no jump.
    """
    n = len(u)
    mirrored = np.concatenate([u, u[::-1]])
    raised = np.fft.rfft(mirrored, axis=0) / np.sinc(np.fft.rfftfreq(2 * n))[:, None] ** 2
    return np.fft.irfft(raised, 2 * n, axis=0)[:n]


def _raised(part: Part) -> Part:
    return replace(part, u=for_linear_hold(part.u))


def _oscillator(x, u, p):
    return x[1], p[0] * u[0] - p[1] * x[1] - p[2] * x[0]


def _with_offset(x, u, p):
    return (x[0] + p[3],)


def silverbox(most: int | None = None) -> Case:
    """Linear second-order circuit; left out: the cubic spring.

    The offsets of both channels are documented, so the nominal simulator has one.
    """
    data = fetch_silverbox()
    simulator = ODESimulator(
        _oscillator,
        dt=data.sampling_period,
        parameters={
            "gain [1/s^2]": 2e5,
            "damping [1/s]": 40.0,
            "stiffness [1/s^2]": 2e5,
            "offset [V]": (0.0, -1.0, 1.0),
        },
        states=["charge [V]", "rate [V/s]"],
        inputs=["u [V]"],
        output=_with_offset,
        outputs=["y [V]"],
        substeps=2,
        hold="linear",
    )
    tests = {name: _raised(_part(frame, data)) for name, frame in data.test_parts.items()}
    return Case("silverbox", simulator, _raised(_part(data.train[:most], data)), tests, "mV", 1000.0)


def _drive(x, u, p):
    return x[1], (FORCE_PER_VOLT * u[0] - p[1] * x[1]) / p[0]


def emps(most: int | None = None) -> Case:
    """Double integrator with viscous damping, from the drive voltage; left out: dry friction."""
    data = fetch_emps()
    simulator = ODESimulator(
        _drive,
        dt=data.sampling_period,
        parameters={"mass [kg]": 100.0, "damping [N s/m]": 250.0},
        states=["position [m]", "velocity [m/s]"],
        inputs=["drive [V]"],
        hold="linear",
    )
    return Case(
        "emps", simulator, _part(data.train[:most], data), {"pulses": _part(data.test, data)}, "mm", 1000.0
    )


def _tanks(x, u, p):
    upper, lower = p[1] * np.sqrt(max(x[0], 0.0)), p[2] * np.sqrt(max(x[1], 0.0))
    return p[0] * u[0] - upper, upper - lower


def cascaded_tanks() -> Case:
    """Two tanks that drain by Torricelli's law; left out: the overflow.

    More than that is wrong: the sensor ends at 10 V, and pump and outlets are idealised. So three effects may
    be named. The upper level is never measured, so its unit is free: it is counted such that what leaves the
    upper tank raises the lower one as much.
    """
    data = fetch_cascaded_tanks()
    simulator = ODESimulator(
        _tanks,
        dt=data.sampling_period,
        parameters={"pump [1/s]": 0.05, "upper outlet [V^0.5/s]": 0.06, "lower outlet [V^0.5/s]": 0.06},
        states=["upper level [V]", "lower level [V]"],
        inputs=["pump [V]"],
        outputs=["lower level [V]"],
        substeps=2,
    )
    tests = {"test": _part(data.test, data)}
    return Case("cascaded_tanks", simulator, _part(data.train, data), tests, "V", settings={"max_effects": 3})


def _mass_spring(x, u, p):
    return x[1], (u[0] - p[1] * x[1] - p[2] * x[0]) / p[0]


def bouc_wen(most: int | None = None) -> Case:
    """Linear oscillator; left out: the hysteresis of its spring."""
    data = fetch_bouc_wen()
    simulator = ODESimulator(
        _mass_spring,
        dt=data.sampling_period,
        parameters={"mass [kg]": 2.2, "damping [N s/m]": 20.0, "stiffness [N/m]": 1e5},
        states=["position [m]", "velocity [m/s]"],
        inputs=["force [N]"],
        substeps=4,
        hold="linear",
    )
    tests = {name: _raised(_part(frame, data)) for name, frame in data.test_parts.items()}
    return Case("bouc_wen", simulator, _raised(_part(data.train[:most], data)), tests, "1e-5 m", 1e5)


def _maxwell(x, u, p):
    return (p[0] * u[1] - p[1] * (x[0] - p[2] - p[3] * u[0]),)


def mr_damper(most: int | None = 24_000) -> Case:
    """Spring and dashpot in series beside a weak spring; left out: yield, and the driver's voltage."""
    data = fetch_mr_damper()

    def part(frame) -> Part:
        u = frame[["D [cm]", "V [cm/s]", "Y [V]"]].to_numpy(dtype=float)
        return Part(u, frame[[data.output]].to_numpy(dtype=float), data.n_init)

    simulator = ODESimulator(
        _maxwell,
        dt=data.sampling_period,
        parameters={
            "series stiffness [N/cm]": 5000.0,
            "relaxation [1/s]": 100.0,
            "offset [N]": (0.0, -1e3, 1e3),
            "parallel stiffness [N/cm]": 5.0,
        },
        states=["force [N]"],
        inputs=["displacement [cm]", "velocity [cm/s]", "driver [V]"],
        hold="linear",
    )
    tests = {name: part(frame) for name, frame in data.test_parts.items()}
    return Case("mr_damper", simulator, part(data.train[:most]), tests, "N", settings={"max_effects": 2})


def _follow(x, u, p):
    return (p[1] * (p[0] * u[0] - x[0]),)


def bh_loops(material: str = "mnzn_ferrite") -> Case:
    """Constant permeability that follows within a point or two; left out: the hysteresis of the material.

    The points have no time; they are taken as a second apart. The loops are closed, so each is gone round
    once before it counts: what the material remembers was there when its first point was measured.
    """
    data = fetch_bh_loops(material)

    def part(frame) -> Part:
        loops = [loop for _, loop in frame.groupby("loop [-]", sort=False)]
        u = [np.tile(loop[data.input].to_numpy(dtype=float), (2, 1)) for loop in loops]
        y = [loop[[data.output]].to_numpy(dtype=float) for loop in loops]
        twice = [np.concatenate([np.full_like(once, np.nan), once]) for once in y]
        labels = np.repeat(np.arange(len(loops)), [len(loop) for loop in twice])
        return Part(np.concatenate(u), np.concatenate(twice), len(y[0]) + 4, labels)

    simulator = ODESimulator(
        _follow,
        dt=1.0,
        parameters={"permeability [T m/A]": 0.005, "pace [1/s]": (1.0, 0.05, 2.0)},
        states=["B [T]"],
        inputs=["H [A/m]"],
        hold="linear",
        substeps=2,
    )
    return Case(
        f"bh_loops {material}",
        simulator,
        part(data.train),
        {"largest loop": part(data.test)},
        "T",
        settings={"max_effects": 2},
    )


def _two_modes(x, u, p):
    return (
        x[1],
        u[0] - p[0] * x[1] - p[1] * x[0],
        x[3],
        u[0] - p[3] * x[3] - p[4] * x[2],
    )


def _acceleration(x, u, p, rates):
    return (p[2] * rates[1] + p[5] * rates[3] + p[6] * u[0],)


def f16(most: int | None = 8192) -> Case:
    """Two linear modes of the wing with its payload; left out: the other modes, clearance and friction.

    Trained on level 5 of the full multisine, one period after the transient; tested at the levels held out.
    """
    data = fetch_f16()
    simulator = ODESimulator(
        _two_modes,
        dt=data.sampling_period,
        parameters={
            "damping 1 [1/s]": 1.0,
            "stiffness 1 [1/s^2]": (2 * np.pi * 5.2) ** 2,
            "share 1 [1/kg]": (0.01, -1.0, 1.0),
            "damping 2 [1/s]": 1.0,
            "stiffness 2 [1/s^2]": (2 * np.pi * 7.3) ** 2,
            "share 2 [1/kg]": (-0.01, -1.0, 1.0),
            "rest [1/kg]": (0.0, -1.0, 1.0),
        },
        states=["mode 1 [N s^2]", "rate 1 [N s]", "mode 2 [N s^2]", "rate 2 [N s]"],
        inputs=["force [N]"],
        output=_acceleration,
        outputs=["payload [m/s^2]"],
        hold="linear",
    )

    def part(frame) -> Part:
        y = frame[["Acc3_payload [m/s^2?]"]].to_numpy(dtype=float)
        return _raised(Part(frame[data.input].to_numpy(dtype=float), y, 400))

    train = part(data.train_parts["level 5"][8192 : None if most is None else 8192 + most])
    tests = {name: part(frame[8192:24_576]) for name, frame in data.test_parts.items()}
    return Case("f16", simulator, train, tests, "m/s^2", settings={"max_effects": 2})
