"""Effects as functions in a NARX model."""

from collections.abc import Callable
from dataclasses import dataclass

from narx_sklearn.model.phi import FunctionPhi, Phi, Play


@dataclass(frozen=True)
class Curve:
    """A named function with its parameter values, for a `FunctionPhi`; pickles and compares by value."""

    name: str
    function: Callable
    theta: tuple[float, ...]

    @property
    def __name__(self) -> str:
        return self.name

    def __call__(self, *arguments):
        return self.function(*arguments, *self.theta)


def of_level(name: str, function: Callable, theta, signal: str) -> tuple[Phi, ...]:
    """Return ``function(s[k], *theta)`` as the only phi regressor."""
    return (FunctionPhi(Curve(name, function, tuple(map(float, theta))), [f"{signal}[k]"]),)


def of_difference(name: str, function: Callable, theta, signal: str) -> tuple[Phi, ...]:
    """Return ``function(s[k], s[k-1], *theta)`` as the only phi regressor."""
    return (FunctionPhi(Curve(name, function, tuple(map(float, theta))), [f"{signal}[k]", f"{signal}[k-1]"]),)


def plays(signal: str, *radii: float) -> tuple[Phi, ...]:
    """Return the play operators of these radii; one without radius is the signal itself and left out."""
    return tuple(Play(signal, radius=float(radius)) for radius in radii if radius > 0)
