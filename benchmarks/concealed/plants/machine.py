"""What is known of a machine besides its equations: time scale, units, ports, and where effects can sit."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass

from benchmarks.concealed.plants.codes import Code, Kind

__all__ = ["Control", "Machine", "Site", "on_input", "on_output", "on_state"]


@dataclass(frozen=True)
class Site:
    """A port and what the effect looks at there (indices of states and of an input; -1: nothing)."""

    kind: Kind
    index: int
    position: int = -1
    rate: int = -1
    other: int = -1
    other_to: int = -1  # when given, the effect sees state `other` minus state `other_to`
    input: int = 0

    @property
    def port(self) -> str:
        return f"{self.kind.name}:{self.index}"


def on_input(index: int = 0) -> Site:
    return Site(Kind.input, index, input=index)


def on_output(index: int = 0) -> Site:
    return Site(Kind.output, index)


def on_state(index: int, position: int = -1, rate: int = -1, **seen: int) -> Site:
    return Site(Kind.state, index, position, rate, **seen)


@dataclass(frozen=True)
class Control:
    """A sampled PID loop from the first output to the first input, output limited."""

    proportional: float
    integral: float
    derivative: float
    limit: float
    amplitude: float  # of the reference, in the unit of the first output


@dataclass(frozen=True)
class Machine:
    """A hidden plant.

    Attributes
    ----------
    dt : float
        Sampling period, in seconds.
    constants : mapping
        Physical constants of the hidden equations.
    nominal : callable
        ``rhs(x, u, p)`` as its user would write it; its source becomes the case's simulator.
    parameters : callable
        From physical constants to the true values of the nominal's parameters.
    slow : float
        Slowest time constant, in seconds.
    band : float
        Highest frequency worth exciting, in Hz.
    offset, amplitude : float
        Working point and swing of the first input.
    rest_state : callable or None
        From physical constants to the state at the start of every recording: at rest, at the working point.
        None: all zero.
    sites : mapping
        Where each effect makes sense.
    """

    name: str
    dt: float
    states: tuple[str, ...]
    inputs: tuple[str, ...]
    measured: tuple[int, ...]
    constants: Mapping[str, float]
    nominal: Callable
    parameters: Callable[..., dict[str, float]]
    slow: float
    band: float
    amplitude: float
    sites: Mapping[Code, tuple[Site, ...]]
    rest_state: Callable[..., tuple[float, ...]] | None = None
    offset: float = 0.0
    second_input: tuple[float, float] = (0.0, 0.0)  # working point and swing of an input nobody commands
    control: Control | None = None
    closed_only: bool = False
    unmeasured: bool = False  # a state that matters has no sensor

    @property
    def outputs(self) -> tuple[str, ...]:
        return tuple(self.states[i] for i in self.measured)
