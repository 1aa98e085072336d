"""Runs of a hidden plant: constants, effects at a strength, a recording from an input."""

from dataclasses import dataclass, field, replace

import numpy as np

from benchmarks.concealed.excitation import excite
from benchmarks.concealed.noise import draw_noise
from benchmarks.concealed.plants.codes import Code, Kind
from benchmarks.concealed.plants.dispatch import NUMBERS
from benchmarks.concealed.plants.integrate import MEMORY, Attached, run_hidden
from benchmarks.concealed.plants.machine import Machine
from benchmarks.concealed.plants.sensors import at_rest_remembered
from benchmarks.concealed.plants.shapes import Scales
from benchmarks.concealed.specs import Concealed

__all__ = ["Recording", "Rig", "measure_scales"]

N_FINE = 20  # fine steps in a sampling period
CONSTANT_SPREAD = 0.2  # the plant of a case is one of a family


@dataclass(frozen=True)
class Recording:
    """What was commanded, what was read, and what nobody sees."""

    u: np.ndarray
    y: np.ndarray
    clean: np.ndarray
    states: np.ndarray

    @property
    def finite(self) -> bool:
        return bool(np.all(np.isfinite(self.clean)))


@dataclass(frozen=True)
class Rig:
    """A hidden plant with its numbers, in or out of a loop, with noise of a given kind and size."""

    machine: Machine
    constants: dict[str, float]
    closed_loop: bool
    noise: str
    sigma: np.ndarray = field(default_factory=lambda: np.zeros(1))  # wanted noise, rms, per output
    effects: tuple[tuple[Concealed, np.ndarray], ...] = ()  # with their numbers theta
    duration: float = 0.0  # s, of the training recording: gates and drifts refer to it

    @property
    def parameters(self) -> dict[str, float]:
        """The true values of the nominal simulator's parameters."""
        return self.machine.parameters(**self.constants)

    def with_effects(self, effects):
        return replace(self, effects=tuple(effects))

    def command(self, kind: str, n: int, rng, swing: float = 1.0) -> np.ndarray:
        """Return the inputs (a reference first, when in a loop), shape (n, n_inputs)."""
        m = self.machine
        u = np.empty((n, len(m.inputs)))
        if self.closed_loop:
            u[:, 0] = self.rest()[m.measured[0]] + swing * m.control.amplitude * excite(
                kind, n, m.dt, m.band / 2.0, rng
            )
        else:
            u[:, 0] = m.offset + swing * m.amplitude * excite(kind, n, m.dt, m.band, rng)
        if len(m.inputs) > 1:
            level, second = m.second_input
            u[:, 1] = level + swing * second * excite("multisine", n, m.dt, m.band / 2.0, rng)
        return u

    def record(self, command: np.ndarray, rng) -> Recording:
        """Run the plant on a command, with fresh noise."""
        m, n = self.machine, len(command)
        n_outputs = len(m.measured)
        sigma = np.broadcast_to(self.sigma, (n_outputs,))
        noise = sigma * draw_noise(self.noise, n, n_outputs, rng)
        steps = np.sqrt(12.0 * (1.0 - 0.3**2)) * sigma if self.noise == "quantised" else np.zeros(n_outputs)
        loop = np.zeros(6)
        if self.closed_loop:
            c = m.control
            loop[:] = 1.0, c.proportional, c.integral, c.derivative, c.limit, m.offset
        states, clean, y, used = run_hidden(
            NUMBERS[m.name],
            np.array(list(self.constants.values())),
            self.rest(),
            command,
            noise,
            steps,
            np.array(m.measured),
            loop,
            self._attached(),
            self._memory(),
            m.dt,
            N_FINE,
        )
        return Recording(used, y, clean, states)

    def rest(self) -> np.ndarray:
        """Return the state at the working point: the machine's own, moved with its constants."""
        m = self.machine
        return np.array(m.rest_state(**self.constants)) if m.rest_state else np.zeros(len(m.states))

    def _delays_first(self) -> list:
        """Return the effects as signals meet them: a delay looks at what was commanded, or stands there."""
        return sorted(self.effects, key=lambda attached: attached[0].code != Code.delay)

    def _attached(self) -> Attached:
        effects = self._delays_first()
        k = len(effects)
        sites = [effect.site for effect, _ in effects]
        seen = [[s.position, s.rate, s.other, s.other_to, s.input] for s in sites]
        gates = [[e.start * self.duration, e.stop * self.duration] for e, _ in effects]
        return Attached(
            np.array([int(e.code) for e, _ in effects], dtype=np.int64),
            np.array([int(s.kind) for s in sites], dtype=np.int64),
            np.array([s.index for s in sites], dtype=np.int64),
            np.array(seen, dtype=np.int64).reshape(k, 5),
            np.array([theta for _, theta in effects], dtype=float).reshape(k, 8),
            np.array(gates, dtype=float).reshape(k, 2),
        )

    def _memory(self) -> np.ndarray:
        """Return the effects' memories as they are after a long rest."""
        memory = np.zeros((len(self.effects), MEMORY))
        for row, (effect, _) in zip(memory, self._delays_first(), strict=True):
            if effect.site.kind == Kind.output:
                at_rest = self.rest()[self.machine.measured[effect.site.index]]
                row[:3] = at_rest_remembered(effect.code, at_rest)
        return memory


def measure_scales(rig: Rig, recording: Recording, site, draws) -> Scales:
    """Return the sizes of the signals at a site in a run without effects."""
    m, rest = rig.machine, rig.rest()
    x = recording.states
    deviation = x - rest

    def size(i, what):
        return float(what(deviation[:, i])) if i >= 0 else 1.0

    def rms(signal):
        return np.sqrt(np.mean(signal**2))

    other = x[:, site.other] if site.other >= 0 else np.ones(1)
    if site.other_to >= 0:
        other = other - x[:, site.other_to]
    port = site.index if site.kind == Kind.state else 0
    seen = recording.u[:, site.input]
    u_rest = m.offset if site.input == 0 else m.second_input[0]
    y = recording.clean[:, site.index if site.kind == Kind.output else 0]
    return Scales(
        rate=float(rms(np.diff(x[:, port]))) / m.dt,
        x=size(site.position, lambda d: np.max(np.abs(d))),
        v=size(site.rate, rms),
        w=float(rms(other)),
        u=float(np.max(np.abs(seen - u_rest))),
        y=float(np.max(np.abs(y))),
        y_std=float(np.std(y)),
        x_rest=float(rest[site.position]) if site.position >= 0 else 0.0,
        x_top=float(x[:, site.position].max()) if site.position >= 0 else 0.0,
        y_range=(float(y.min()), float(y.max())),
        u_rest=u_rest,
        duration=len(x) * m.dt,
        slow=m.slow,
        band=m.band,
        draws=draws,
    )
