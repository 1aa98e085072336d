"""Effects at their place: a port of a simulator, with arguments and parameter values."""

from collections.abc import Collection, Iterable, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from narx_sklearn.physics.effects import PARAMETER, PORTS, Effect, Name, PutOut


class Span(NamedTuple):
    """Time in which something acts, its beginning included, its end not."""

    begins: float = -np.inf  # s since the session began, or along the record
    ends: float = np.inf
    along_record: bool = False  # where there are several sessions: in those that it covers

    def holds(self, samples: np.ndarray, began: np.ndarray | int, dt: float) -> np.ndarray:
        """Tell which samples of a record lie in it, from the first ones of their sessions."""
        time = (samples - (0 if self.along_record else began)) * dt
        return (self.begins <= time) & (time < self.ends)

    def in_session(self, began: int, dt: float) -> "Span":
        """Return it with its time counted in a session that begins at a sample of the record."""
        return Span(self.begins - began * dt, self.ends - began * dt) if self.along_record else self

    def within(self, first: float, last: float) -> "Span":
        """Return what of it lies between two times."""
        return self._replace(begins=max(self.begins, first), ends=min(self.ends, last))

    @property
    def n_ends(self) -> int:
        """Number of its ends that are not those of the record."""
        return int(np.isfinite(self.begins)) + int(np.isfinite(self.ends))


ALWAYS = Span()


class Port(NamedTuple):
    """Where something enters a simulator."""

    kind: str  # "input", "state" or "output", or "parameter"
    index: int  # type: ignore[assignment]  # counted from zero

    @property
    def is_parameter(self) -> bool:
        """Whether what acts there makes a parameter another one, wherever that stands in the equations."""
        return self.kind == PARAMETER

    @property
    def turn(self) -> int:
        """When signals pass it on their way through a machine; parameters come last."""
        return (*PORTS, PARAMETER).index(self.kind)

    def signals(self, u: np.ndarray, y: np.ndarray, p: np.ndarray) -> np.ndarray:
        """Return what an effect there changes, not being one of a state equation.

        Inputs or outputs along a record, (n_samples, n_signals), or the parameters, (n_parameters,).
        """
        return {"input": u, "output": y, PARAMETER: p}[self.kind]

    def __str__(self) -> str:
        return f"{self.kind}:{self.index}"


@dataclass(frozen=True)
class PlacedEffect:
    """An effect at a port, with what it depends on and with values for its parameters.

    Parameters
    ----------
    effect : Effect
        The entry of the catalogue.
    port : Port
        Where it acts.
    weights : tuple of float
        At a state port: the argument as a weighted sum of the states (a difference of two positions, say).
    second : tuple of float
        The second argument as a weighted sum of the inputs and then the states; empty for none. At an input
        port the inputs alone count.
    onward : int
        State equation to which a share goes on, or that is pushed back; -1 for none. Its own where it is the
        integral of a controller that follows what is put out, so that it does not wind up.
    theta : tuple of float
        Parameters of the effect, and last the share that goes on, or the ratio in which it pushes back, where
        ``onward`` names an equation, or how fast an integral follows.
    argument_name, argument_unit : str
        How the argument is called and its unit.
    second_name, second_unit : str
        How the second argument is called and its unit.
    share : float
        From which the search for the share, or the ratio, begins.
    through : int
        Input that it is added to: what it does the simulator's own equations tell, as of a force on one of
        several bodies that move together; -1 for none, and it is added to its port.
    handed_on : bool
        Whether it changes what all other equations have of the port's state, and not that state's own
        equation. The state follows an input; or it comes in a sum with its rate, as the integral of a
        controller does in what that puts out, and the effect depends on that sum, the ``second``. Where that
        has no integral, all equations have it of an input, ``through`` which it is changed.
    is_seen : bool
        Whether what is handed on is so in outputs too: those made of the port's state have what other
        equations have.
    inertial : bool
        In a map: whether the argument is the rate of the port's signal, from its last two values. The force
        is then an acceleration, and ``dt**2`` of it is added to the signal.
    odd : bool
        Whether one meets the effect elsewhere, not at such a place.
    during : Span
        The time in which it acts; always by default.
    limits : tuple of (float, float)
        Of each parameter, between which it means on a record what it is called; none by default.
    begins : tuple of (int, float)
        At inputs and outputs: where its memory begins in sessions that do not begin alike, each by its first
        sample; in all others it begins where ``theta`` says.
    """

    effect: Effect
    port: Port
    weights: tuple[float, ...] = ()
    second: tuple[float, ...] = ()
    onward: int = -1
    theta: tuple[float, ...] = ()
    argument_name: str = ""
    argument_unit: str = ""
    second_name: str = ""
    second_unit: str = ""
    share: float = 0.5
    through: int = -1
    handed_on: bool = False
    is_seen: bool = False
    inertial: bool = False
    odd: bool = False
    during: Span = ALWAYS
    limits: tuple[tuple[float, float], ...] = ()
    begins: tuple[tuple[int, float], ...] = ()

    def at(self, theta) -> "PlacedEffect":
        """Return it with other parameter values."""
        return replace(self, theta=tuple(float(value) for value in theta))

    def with_positive_amplitude(self) -> "PlacedEffect":
        """Return it with a positive amplitude, the phase half a turn on, within half a turn of zero."""
        amplitude, phase = self.amplitude, self.effect.phase
        if phase is None or amplitude is None:
            return self
        theta = np.array(self.theta)
        turned = theta[phase] + np.pi * (theta[amplitude] < 0)
        theta[amplitude], theta[phase] = abs(theta[amplitude]), (turned + np.pi) % (2 * np.pi) - np.pi
        return self.at(theta)

    def with_zeros(self, indices: Collection[int]) -> "PlacedEffect":
        """Return it with some parameters held at zero."""
        if not indices:
            return self
        theta, limits = np.array(self.theta), self.bounds
        for k in self.effect.chosen if self.limits else ():  # may be chosen anew, where they were before
            limits[k] = self.limits[k]
        at = list(indices)
        theta[at], limits[at] = 0.0, 0.0
        return replace(self, limits=tuple(map(tuple, limits.tolist()))).at(theta)

    @property
    def place(self) -> tuple:
        """Everything but the parameter values: two of one place are the same hypothesis.

        In what sum a state comes with its rate the simulator's own parameters say.
        """
        ways = self.onward, self.through, self.handed_on, self.is_seen
        second = self.of_sum if self.is_on_sum else self.second
        return (self.effect.code, self.port, self.weights, second, *ways, self.during)

    @property
    def passes(self) -> bool:
        """Whether it acts for a while only."""
        return self.during != ALWAYS

    def acting(self, during: Span) -> "PlacedEffect":
        """Return it acting in another time."""
        return replace(self, during=during)

    def always(self) -> "PlacedEffect":
        """Return it acting at all times."""
        return self.acting(ALWAYS)

    def begun_anew(self) -> "PlacedEffect":
        """Return it as it begins another record: memories in the middle, what follows a command there."""
        begin = self.effect.begin
        if begin is None:
            return self
        return replace(self, begins=()).at([*self.theta[:begin], 0.0, *self.theta[begin + 1 :]])

    @property
    def bounds(self) -> np.ndarray:
        """Lower and upper bounds of ``theta`` on a record, shape (n_theta, 2)."""
        bounds = self.domain
        for row, (lower, upper) in zip(bounds, self.limits, strict=False):
            row[:] = np.clip([lower, upper], *row)
        return bounds

    @property
    def domain(self) -> np.ndarray:
        """Lower and upper bounds of ``theta`` on any record, shape (n_theta, 2)."""
        limits = [(p.lower, p.upper) for p in self.effect.parameters]
        choice = () if self.effect.choice is None else (self.effect.choice,)
        for k in (*choice, *self.effect.chosen) if self.theta else ():
            limits[k] = (self.theta[k],) * 2
        if self.is_how_it_follows or self.put_out:
            begin = self.effect.begin if self.is_how_it_follows else None
            for k in {begin, self.effect.form, *choice} - {None}:
                limits[k] = (0.0, 0.0)
        if self.port.kind == "input" or self.handed_on:
            given = [p.at_input for p in self.effect.parameters]
            limits = [
                limit if value is None else (value, value) for limit, value in zip(limits, given, strict=True)
            ]
        if self.onward >= 0:
            limits.append((0.0, np.inf if self.reacts or self.tracks else 1.0))
        return np.array(limits, dtype=float).reshape(-1, 2)

    @property
    def amplitude(self) -> int | None:
        """Index of the parameter that scales the whole effect here; None where no parameter does."""
        scales = self.effect.amplitude
        return scales if scales is not None and np.ptp(self.bounds[scales]) > 0 else None

    @property
    def force(self):
        """Function of the force at a state port, or of what is added to a state that is handed on."""
        if self.put_out is not None:
            return self.put_out.force
        if self.handed_on:
            return self.effect.handed_on or self.effect.force
        return self.effect.force or self.effect.following

    @property
    def put_out(self) -> PutOut | None:
        """What makes a controller's output arrive later, where it does that; None for all else."""
        return self.effect.put_out if self.handed_on and self.effect.handed_on is None else None

    @property
    def n_memory(self) -> int:
        """States of its own, where it acts."""
        return self.effect.n_memory if self.put_out is None else self.put_out.n_memory

    @property
    def dead_time(self) -> float | None:
        """By how much later than it is put out a controller's output arrives, s; None of all else."""
        late = None if self.put_out is None else self.put_out.late
        return None if late is None else self.theta[late]

    @property
    def lacking(self) -> float | None:
        """Share of a controller's first output that was not there yet before a record; None of all else."""
        begin = self.effect.begin
        return None if self.put_out is None or begin is None else self.theta[begin]

    @property
    def is_how_it_follows(self) -> bool:
        """Whether it is in the equation of a state that follows an input: how that does."""
        return self.port.kind == "state" and not self.handed_on and self.effect.force is None

    @property
    def reacts(self) -> bool:
        """Whether it acts between two neighbours, so that it pushes the other one back."""
        return self.onward >= 0 and not (self.effect.onward or self.handed_on)

    @property
    def tracks(self) -> bool:
        """Whether a controller's integral follows what is put out."""
        return self.onward >= 0 and self.handed_on

    @property
    def is_on_sum(self) -> bool:
        """Whether it acts on what other equations have of a state in a sum with its rate."""
        return self.handed_on and bool(self.second)

    @property
    def name(self) -> Name:
        """What it is called at its place."""
        effect = self.effect
        ordinary = Name(effect.form_of or effect.code, effect.title, effect.sentence)
        return (effect.in_coupling or ordinary) if self.is_on_sum else ordinary

    @property
    def of_sum(self) -> tuple:
        """Where that sum is, and what it is made of."""
        return self.port.index, self.through, tuple(weight != 0.0 for weight in self.second)

    @property
    def taken_onward(self) -> float:
        """How much of the force is taken off the equation to which it goes on."""
        return -self.theta[-1] if self.tracks else self.theta[-1]

    @property
    def is_fed(self) -> bool:
        """Whether another signal stands in the argument's place."""
        return bool(self.second) and (self.effect.second == "feed" or self.handed_on)

    @property
    def answer(self) -> float:
        """How fast the force changes its argument, if that is how fast two neighbours part; else 0."""
        if self.port.kind != "state" or np.count_nonzero(self.weights) < 2:
            return 0.0
        own = self.weights[self.port.index]
        return own - self.theta[-1] * self.weights[self.onward] if own and self.onward >= 0 else own

    @property
    def rising(self) -> np.ndarray:
        """The order of ``theta`` in which its levels rise, (n_theta,)."""
        order, levels = np.arange(self.n_theta), np.array(self.effect.levels, dtype=int)
        order[levels] = levels[np.argsort(np.array(self.theta)[levels], kind="stable")]
        return order

    def added(self, dt: float) -> float:
        """Return how much of its force is added to the port in one evaluation."""
        return dt**2 if self.inertial else 1.0

    @property
    def n_theta(self) -> int:
        """Number of parameters, the share that goes on included."""
        return len(self.effect.parameters) + (self.onward >= 0)

    @property
    def own_theta(self) -> np.ndarray:
        """Parameters of the effect itself, without the share or ratio in which it goes on."""
        return np.array(self.theta[: len(self.effect.parameters)])

    @property
    def onward_theta(self) -> tuple[float, ...]:
        """The share or ratio in which it goes on; empty for none."""
        return self.theta[len(self.effect.parameters) :]

    @property
    def n_values(self) -> int:
        """Number of parameters fitted or chosen, but for where its memory begins and how it is built."""
        fitted = set(np.flatnonzero(np.ptp(self.bounds, axis=1) > 0).tolist())
        besides = {self.effect.begin, self.effect.form}
        return len(fitted - besides) + (len(self.effect.chosen) if self.theta else 0)

    def argument_of(self, u: np.ndarray, x: np.ndarray) -> np.ndarray:
        """Return at a state port what the force depends on along a record, (n_samples,)."""
        fed = self.second_of(u, x) if self.handed_on else None
        return x @ np.array(self.weights) if fed is None else fed

    def second_of(self, u: np.ndarray, x: np.ndarray | None = None) -> np.ndarray | None:
        """Return the second argument along a record, (n_samples,); None for none."""
        if not self.second:
            return None
        weights = np.array(self.second)
        n_inputs = u.shape[1]
        own = u @ weights[:n_inputs]
        of_states = x is not None and weights[n_inputs:].any()
        return own + x @ weights[n_inputs:] if of_states else own


def for_other_records(
    effects: Iterable[PlacedEffect], beginning_alike: Collection[tuple] = ()
) -> tuple[PlacedEffect, ...]:
    """Return effects as they act in other records, where memories begin anew.

    What happened once, or in some sessions only, does not act there. Those at places that are
    ``beginning_alike`` begin as they did.
    """
    return tuple(
        replace(placed, begins=()) if placed.place in beginning_alike else placed.begun_anew()
        for placed in that_recur(effects)
        if not placed.during.along_record
    )


def that_recur(effects: Iterable[PlacedEffect]) -> tuple[PlacedEffect, ...]:
    """Return the effects but those that happened once."""
    return tuple(placed for placed in effects if not placed.effect.instants)


def in_turn(effects: Sequence[PlacedEffect]) -> list[int]:
    """Return which effects act at state equations, in the order in which a run asks them."""
    acting = [i for i, placed in enumerate(effects) if placed.port.kind == "state"]
    return sorted(acting, key=lambda i: effects[i].effect.last)


def in_short(effects: Iterable[PlacedEffect]) -> str:
    """Return a set of effects as ``"code at port + code at port"``."""
    return " + ".join(f"{placed.effect.code} at {placed.port}" for placed in effects)
