"""Compensation laws as values: equations and elements over the reference r and the input m, and their run."""

import warnings
from collections.abc import Callable, Collection, Mapping, Sequence
from copy import copy
from dataclasses import dataclass, field, fields
from functools import cached_property

import numpy as np

from narx_sklearn.compensation import _kernels as kernels
from narx_sklearn.compensation._user_functions import compiled_functions
from narx_sklearn.exceptions import NarxWarning
from narx_sklearn.model.kernels import STATE_SIZE, Program
from narx_sklearn.model.phi import Phi
from narx_sklearn.model.polynomials import Polynomial
from narx_sklearn.model.terms import Variable

__all__ = ["BoucWenElement", "CompensationLaw", "FunctionElement", "LawState", "UnreachableWarning"]

INPUT, REFERENCE = "m", "r"  # the thesis's letters
MOVE = "d"  # m[k] - m[k-1], unless another signal is called so
METHODS = {"explicit": kernels.EXPLICIT, "roots": kernels.ROOTS, "search": kernels.SEARCH}
POLICIES = {"hold": kernels.HOLD, "nearest": kernels.NEAREST}
BRANCHES = {"nearest": kernels.ANY, "rising": kernels.RISING, "falling": kernels.FALLING}


@dataclass(frozen=True)
class BoucWenElement:
    """Bouc-Wen hysteresis of a signal as an element of a law (2.6).

    Parameters
    ----------
    signal : str
        What it is a function of.
    A, beta, gamma, n : float
        As in `narx_sklearn.physics.bouc_wen`.
    name : str, default="h"
        Its name in the law.
    """

    signal: str
    A: float
    beta: float
    gamma: float
    n: float = 1.0
    name: str = "h"
    kind = kernels.BOUC_WEN
    reach = 1
    has_memory = True

    @property
    def kernel_parameters(self) -> np.ndarray:
        """Numbers the kernel takes."""
        return np.array([self.A, self.beta, self.gamma, self.n])

    def describe(self) -> str:
        """Return the definition as text."""
        return (
            f"Bouc-Wen hysteresis of {self.signal}: A={self.A:g}, beta={self.beta:g}, "
            f"gamma={self.gamma:g}, n={self.n:g}"
        )


@dataclass(frozen=True)
class FunctionElement:
    """A function of the user's as an element of a law, in time with the input m[k].

    Parameters
    ----------
    function : callable
        ``function(*arguments) -> value``, elementwise on arrays.
    of : tuple of Variable
        What it is called with, such as ``m[k-1]`` and ``r[k+1]``.
    name : str
        Its name in the law.
    """

    function: Callable
    of: tuple[Variable, ...]
    name: str
    kind = kernels.FUNCTION
    has_memory = False
    kernel_parameters = np.zeros(1)

    @property
    def signal(self) -> str:
        """The input where the one wanted, m[k], is among the arguments; else its own name."""
        return INPUT if Variable(INPUT, 0) in self.of else self.name

    @property
    def reach(self) -> int:
        """Samples before the present that it is a function of."""
        return max(max(v.lag for v in self.of), 0)

    def describe(self) -> str:
        """Return the definition as text."""
        called = getattr(self.function, "__name__", type(self.function).__name__)
        return f"{called}({', '.join(map(str, self.of))})"


@dataclass(frozen=True)
class CompensationLaw:
    """A law that gives the input m[k] from the reference r and past inputs.

    Parameters
    ----------
    method : {"explicit", "roots", "search"}
        ``m[k] = equations[0]``; or m[k] is the last input plus a root of a polynomial, one polynomial a
        regime; or m[k] is a zero of ``equations[0]``, found by search.
    equations : tuple of Polynomial
        In ``m[k-1]``, ``r[k+1]``, ... and elements; with ``"roots"``, for each regime the coefficients of the
        powers 0, 1, ... of the move ``m[k] - m[k-1]``.
    elements : tuple of Phi, BoucWenElement or FunctionElement, default=()
        Named functions of m, r and other known signals that the equations use.
    others : tuple of str, default=()
        Known signals besides the reference.
    n_regimes : int, default=1
        2 where loading and unloading have polynomials of their own (4.13)-(4.14).
    keeps_rest : bool, default=False
        Hold the input while the reference, and the other known signals, do not move.
    limits : (float, float), default=(-inf, inf)
        Range of the input, in its unit.
    rate_limit : float, default=inf
        Largest change of the input in one sample.
    policy : {"hold", "nearest"}, default="hold"
        Input where no admissible one satisfies the law: the last, or the one that comes nearest.
    branch : {"nearest", "rising", "falling"}, default="nearest"
        Which root is taken: the nearest to the last input; or, where the machine's output rises (falls) with
        its input, the nearest on the side that corrects the output, and only without one there the other.
    initial_states : mapping of {str: float}, optional
        First number of the state of elements that do not start from zero.

    See Also
    --------
    RootCompensator, IsolatedCompensator, InverseCompensator : Derive laws from models and data.

    Examples
    --------
    >>> from narx_sklearn.compensation import CompensationLaw
    >>> from narx_sklearn.model import Polynomial
    >>> law = CompensationLaw("explicit", (Polynomial.parse("2*r[k+1] - r[k]"),))
    >>> print(law)
    m[k] = 2*r[k+1] - r[k]
    >>> law.run([0.0, 1.0, 1.0]).m.tolist()
    [2.0, 1.0, 1.0]
    """

    method: str
    equations: tuple[Polynomial, ...]
    elements: tuple[Phi | BoucWenElement | FunctionElement, ...] = ()
    others: tuple[str, ...] = ()
    n_regimes: int = 1
    keeps_rest: bool = False
    limits: tuple[float, float] = (-np.inf, np.inf)
    rate_limit: float = np.inf
    policy: str = "hold"
    branch: str = "nearest"
    initial_states: Mapping[str, float] = field(default_factory=dict)

    def __getstate__(self):
        # what is compiled or packed is made anew where it is wanted
        return {f.name: getattr(self, f.name) for f in fields(self)}

    @property
    def known(self) -> tuple[str, ...]:
        """Names of the known signals: the reference, then the others."""
        return (REFERENCE, *self.others)

    @property
    def channels(self) -> tuple[str, ...]:
        """Names of all signals in the window."""
        return (INPUT, *self.known, *(str(e.name) for e in self.elements))

    @property
    def move(self) -> str:
        """Name of the move ``m[k] - m[k-1]``, a polynomial's unknown."""
        return free_name(MOVE, self.channels)

    @cached_property
    def variables(self) -> tuple[Variable, ...]:
        """All lagged variables the equations read."""
        found = {v for equation in self.equations for v in equation.variables}
        return tuple(sorted(found, key=lambda v: v.order))

    @property
    def degree(self) -> int:
        """Degree in the unknown move; 0 where there is no polynomial to solve."""
        return len(self.equations) // self.n_regimes - 1 if self.method == "roots" else 0

    @cached_property
    def horizon(self) -> int:
        """Samples that the reference must be known ahead."""
        of_input = {INPUT, *(str(e.name) for e in self.elements if e.signal == INPUT)}
        read = {*self.variables, *(v for e in self._functions for v in e.of)}
        return max(max((-v.lag for v in read if v.signal not in of_input), default=0), 0)

    @property
    def _functions(self) -> tuple[FunctionElement, ...]:
        return tuple(e for e in self.elements if isinstance(e, FunctionElement))

    @cached_property
    def functions(self):
        """The user's functions as the kernels take them, None if there are none."""
        if not self._functions:
            return None
        width = len(self.channels)
        column = {signal: i for i, signal in enumerate(self.channels)}
        return compiled_functions(
            [
                (e.function, column[e.name], [column[v.signal] - v.lag * width for v in e.of])
                for e in self._functions
            ]
        )

    @cached_property
    def _back(self) -> int:
        """Rows before the newest one that the equations or their elements read."""
        reach = {str(e.name): e.reach if not e.has_memory else 1 for e in self.elements}
        lags = (v.lag + reach.get(v.signal, 0) for v in self.variables)
        return max(max(lags, default=0), 1) + self.horizon

    @property
    def n_past_inputs(self) -> int:
        """Past inputs that the law reads, at least 1."""
        return self._back - self.horizon

    @cached_property
    def packed(self) -> tuple[np.ndarray, np.ndarray]:
        """The law as integers and numbers, the form its kernels take."""
        program = _program(self.equations, self.channels, self.horizon)
        channels = self.channels
        n_elements = len(self.elements)
        width = max((e.kernel_parameters.size for e in self.elements), default=1)
        parameters = np.zeros((n_elements, width))
        for row, element in zip(parameters, self.elements, strict=True):
            row[: element.kernel_parameters.size] = element.kernel_parameters
        header = np.zeros(kernels.HEADER, dtype=np.int64)
        header[:15] = (
            len(channels),
            self._back + 1,
            self.horizon,
            METHODS[self.method],
            POLICIES[self.policy],
            self.degree,
            self.n_regimes,
            self._known_reach,
            self.keeps_rest,
            program.equation_start.size - 1,
            program.coefficients.size,
            program.factor_step.size,
            n_elements,
            width,
            BRANCHES[self.branch],
        )
        integers = [
            header,
            program.equation_start,
            program.group_start.reshape(-1),
            program.factor_start,
            program.factor_step,
            np.array([e.kind for e in self.elements], dtype=np.int64),
            np.array([channels.index(e.signal) for e in self.elements], dtype=np.int64),
            np.array([channels.index(str(e.name)) for e in self.elements], dtype=np.int64),
            np.array([_owner(e) for e in self.elements], dtype=np.int64),
        ]
        limits = np.array([*self.limits, self.rate_limit], dtype=float)
        return np.concatenate(integers), np.concatenate(
            [limits, program.coefficients, parameters.reshape(-1)]
        )

    @property
    def _known_reach(self) -> int:
        """Rows beyond the newest one in which the known signals must rest for the law to rest."""
        reach = {str(e.name): e.reach for e in self.elements if e.signal in self.known}
        reach |= dict.fromkeys(self.known, 0)
        lags = (v.lag + self.horizon + reach[v.signal] for v in self.variables if v.signal in reach)
        return min(max(max(lags, default=0), 1), self._back)

    def start(self, m: float = 0.0, known=0.0) -> "LawState":
        """Return a state at rest.

        Parameters
        ----------
        m : float, default=0.0
            Input that has been held.
        known : float or array-like of shape (n_known,), default=0.0
            Reference (and other known signals) that have been held.

        Returns
        -------
        LawState
        """
        return LawState(self, m, known)

    def begin(self, known: np.ndarray, m: float) -> "tuple[LawState, np.ndarray]":
        """Return the state at rest before a whole reference, and the rows that its steps then take.

        Parameters
        ----------
        known : ndarray of shape (n_samples, n_known)
            Reference and other known signals, held before the first sample and after the last.
        m : float
            Input that has been held.

        Returns
        -------
        state : LawState
        ahead : ndarray of shape (n_samples, n_known)
            What is known newest at each sample: ``horizon`` samples ahead of it.
        """
        n_samples, h = known.shape[0], self.horizon
        ahead = known[np.minimum(np.arange(n_samples + h), n_samples - 1)]
        state = self.start(m, known[0])
        state.settle(ahead[1:h], np.full(max(h - 1, 0), m))
        return state, np.ascontiguousarray(ahead[h:])

    def run(self, reference, *, m: float = 0.0) -> "LawRun":
        """Compute the input along a whole reference, starting from rest.

        The reference is held before its first sample, and after its last one, where the law looks ahead.

        Parameters
        ----------
        reference : array-like of shape (n_samples,) or (n_samples, n_known)
            Reference, and other known signals if the law has them.
        m : float, default=0.0
            Input held before the first sample.

        Returns
        -------
        LawRun
        """
        known = np.ascontiguousarray(np.asarray(reference, dtype=float).reshape(-1, len(self.known)))
        state, ahead = self.begin(known, m)
        inputs = np.empty(known.shape[0])
        if self.functions is None:
            kernels.run(*self.packed, state.values, ahead, inputs)
        else:
            kernels.with_functions().run(self.functions, *self.packed, state.values, ahead, inputs)
        return LawRun(inputs, state.counts)

    def to_text(self, digits: int = 5) -> str:
        """Return the law as equations, with the definitions of its elements."""
        if self.method == "explicit":
            lines = [f"{INPUT}[k] = {self.equations[0].to_text(digits)}"]
        elif self.method == "search":
            lines = [f"find {INPUT}[k]: 0 = {self.equations[0].to_text(digits)}"]
        else:
            d = self.move
            lines = [f"{INPUT}[k] = {INPUT}[k-1] + {d}, the root nearest to 0 of"]
            if self.branch != "nearest":
                too_low = "negative" if self.branch == "rising" else "positive"
                lines.append(f"  (above 0 where the term without {d} is {too_low}, if there is one)")
            names = (f"loading, {d} > 0", f"unloading, {d} < 0") if self.n_regimes == 2 else ("",)
            for regime, name in enumerate(names):
                lines += [f"  {name}:"] if name else []
                first = regime * (self.degree + 1)
                for power in range(self.degree, -1, -1):
                    body = self.equations[first + power].to_text(digits)
                    factor = f" {d}^{power}" if power > 1 else f" {d}" if power else ""
                    lines.append(f"    {'+ ' if power < self.degree else ''}({body}){factor}")
                lines.append("    = 0")
        lines += [f"  {e.name}[k] = {e.describe()}" for e in self.elements]
        if np.isfinite(self.limits).any():
            lines.append(f"  {self.limits[0]:g} <= {INPUT}[k] <= {self.limits[1]:g}")
        if np.isfinite(self.rate_limit):
            lines.append(f"  |{INPUT}[k] - {INPUT}[k-1]| <= {self.rate_limit:g}")
        if self.keeps_rest:
            rest = "rests" if not self.others else "rest"
            lines.append(f"  {INPUT}[k] = {INPUT}[k-1] while {', '.join(self.known)} {rest}")
        return "\n".join(lines)

    def __str__(self) -> str:
        return self.to_text()


class UnreachableWarning(NarxWarning):
    """A compensator could not satisfy its law, ran away, or limits cut its input or the input's change."""


@dataclass(frozen=True)
class LawCounts:
    """How often a law could not have its way.

    Attributes
    ----------
    samples : int
        Samples computed.
    no_solution : int
        Samples at which no admissible input satisfied the law, or it or the reference was not finite.
    at_limit : int
        Samples at which the input was cut at a limit of its range.
    at_rate_limit : int
        Samples at which its change was cut.
    """

    samples: int
    no_solution: int
    at_limit: int
    at_rate_limit: int


@dataclass(frozen=True)
class LawRun:
    """A law's input along a reference.

    Attributes
    ----------
    m : ndarray of shape (n_samples,)
        The input.
    counts : LawCounts
        How often it was held or cut.
    """

    m: np.ndarray
    counts: LawCounts


class LawState:
    """The state of a law between samples, packed for its kernels.

    Parameters
    ----------
    law : CompensationLaw
        The law.
    m : float
        Input that has been held.
    known : float or array-like of shape (n_known,)
        Known signals that have been held.
    """

    def __init__(self, law: CompensationLaw, m: float, known):
        self.law = law
        self._integers, self._numbers = law.packed
        self.values = np.zeros(kernels.state_size(self._integers))
        known = np.broadcast_to(np.asarray(known, dtype=float), (len(law.known),))
        parts = kernels.unpack_state(self._integers, self.values)
        window = parts.window.reshape(-1, len(law.channels))
        window[:, 0] = m
        window[:, 1 : 1 + known.size] = known
        for p, element in enumerate(law.elements):
            if isinstance(element, FunctionElement):
                continue
            level = window[0, law.channels.index(element.signal)]
            initial = law.initial_states.get(str(element.name))
            if initial is not None:
                parts.elements[p, 0] = initial
            value = kernels.element_value(
                element.kind, element.kernel_parameters, level, level, parts.elements[p]
            )
            window[:, law.channels.index(str(element.name))] = value
        if law.functions is not None:
            law.functions(parts.window, self._present)
            window[:] = window[law._back - law.horizon]
        self._known = np.empty(known.size)

    @property
    def _present(self) -> int:
        """Where in the packed window the row of m[k] begins."""
        return (self.law._back - self.law.horizon) * len(self.law.channels)

    def settle(self, known, inputs) -> None:
        """Move over past rows: known signals up to now, and the inputs ``horizon`` samples before each."""
        known = np.ascontiguousarray(np.asarray(known, dtype=float).reshape(-1, len(self.law.known)))
        inputs = np.ascontiguousarray(inputs, dtype=float)
        if self.law.functions is None:
            kernels.settle(self._integers, self._numbers, self.values, known, inputs)
            return
        window = kernels.unpack_state(self._integers, self.values).window
        for i in range(inputs.size):
            kernels.settle(self._integers, self._numbers, self.values, known[i : i + 1], inputs[i : i + 1])
            self.law.functions(window, self._present)

    def step(self, known) -> float:
        """Take the newest known values, return the input."""
        try:
            self._known[:] = known
        except (TypeError, ValueError) as error:
            raise ValueError(
                f"A step takes {self._known.size} numbers ({', '.join(self.law.known)}), got {known!r}."
            ) from error
        if self.law.functions is None:
            return kernels.advance(self._integers, self._numbers, self.values, self._known)
        advance = kernels.with_functions().advance
        return advance(self.law.functions, self._integers, self._numbers, self.values, self._known)

    @property
    def counts(self) -> LawCounts:
        """How often the law could not have its way so far."""
        at = len(self.law.channels) * (self.law._back + 1) + len(self.law.elements) * STATE_SIZE
        return LawCounts(*(int(c) for c in self.values[at : at + kernels.N_COUNTS]))

    def copy(self) -> "LawState":
        """Return an independent copy, to branch or to warm-start from."""
        twin = copy(self)  # a new state would call the user's functions where it rests
        twin.values, twin._known = self.values.copy(), self._known.copy()
        return twin


def warn_if_unreachable(counts: LawCounts, law: CompensationLaw, beyond: str = "") -> None:
    """Warn where a law could not be satisfied or limits cut its input, and of what is beyond the record."""
    taken = "the last was kept" if law.policy == "hold" else "the nearest was taken"
    low, high = law.limits
    told = {
        f"{counts.no_solution} had no admissible input ({taken})": counts.no_solution,
        f"at {counts.at_limit} the limits {low:g} to {high:g} cut it": counts.at_limit,
        f"at {counts.at_rate_limit} rate_limit={law.rate_limit:g} cut its change": counts.at_rate_limit,
    }
    if not any(told.values()):
        if beyond:
            warnings.warn(beyond, UnreachableWarning, stacklevel=3)
        return
    ways = {
        "widen the limits if the machine allows it, move m_init, or identify from a record that covers the "
        "reference": counts.no_solution or counts.at_limit,
        "raise rate_limit if the machine allows it, or slow the reference down": counts.at_rate_limit,
    }
    warnings.warn(
        f"Of {counts.samples} samples {', '.join(text for text, count in told.items() if count)}. "
        "The machine cannot follow this reference, or the model does not hold there: "
        f"{'; '.join(text for text, count in ways.items() if count)}." + (beyond and f" {beyond}"),
        UnreachableWarning,
        stacklevel=3,
    )


def free_name(name: str, taken: Collection[str]) -> str:
    """Return a name that is not taken: the one wanted, with as many underscores as it needs."""
    while name in taken:
        name += "_"
    return name


def _owner(element) -> int:
    """Return what an element is of: the user's functions, the input, or known signals."""
    if isinstance(element, FunctionElement):
        return kernels.OF_FUNCTION
    return kernels.OF_INPUT if element.signal == INPUT else kernels.OF_KNOWN


def _program(equations: Sequence[Polynomial], channels: Sequence[str], horizon: int) -> Program:
    """Return polynomials as a program for `right_hand_side`, whose base is the row ``k + horizon``."""
    position = {signal: i for i, signal in enumerate(channels)}
    equation_start, group_start, factor_start, factor_step, coefficients = [0], [], [0], [], []
    for equation in equations:
        items = equation.items
        sizes = np.array([_group(len(term.expanded)) for term, _ in items], dtype=np.int64)
        order = np.argsort(sizes, kind="stable")
        group_start.append(equation_start[-1] + np.searchsorted(sizes[order], np.arange(4)))
        for t in order:
            term, value = items[t]
            factor_step += [position[v.signal] - (v.lag + horizon) * len(channels) for v in term.expanded]
            factor_start.append(len(factor_step))
            coefficients.append(value)
        equation_start.append(len(coefficients))
    return Program(
        np.array(equation_start, dtype=np.int64),
        np.array(group_start, dtype=np.int64).reshape(-1, 4),
        np.array(factor_start, dtype=np.int64),
        np.array(factor_step, dtype=np.int64),
        np.array(coefficients, dtype=float),
    )


def _group(n_factors: int) -> int:
    """Return the group of a term in `Program`: one factor, two, three, all others."""
    return n_factors - 1 if 1 <= n_factors <= 3 else 3
