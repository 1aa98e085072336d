"""A simulation written as ordinary differential equations in Python."""

import warnings
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from numbers import Integral, Real
from typing import Any

import numpy as np

from narx_sklearn._validation import check_choice
from narx_sklearn.discrepancy.simulators.accelerations import (
    Acceleration,
    find_accelerations,
    with_accelerations,
)
from narx_sklearn.discrepancy.simulators.equations import compiled, picker, takes_rates
from narx_sklearn.discrepancy.simulators.linearise import Linearisation, linearise, steady_state, steps
from narx_sklearn.discrepancy.simulators.read_back import states_read
from narx_sklearn.discrepancy.simulators.simulator import Parameter, Signal, Simulator
from narx_sklearn.discrepancy.simulators.switches import Switches, find_switches
from narx_sklearn.exceptions import NarxWarning
from narx_sklearn.model.units import may_be_alike

STABLE = 2.78  # |eigenvalue| times step at which a Runge-Kutta step of order four loses stability
SETTLED = 1.5  # of it, at which a step is about right too
SHOWN = 8  # signals named in a representation
PASSING = 3  # of them may be stiff in passing
GRAVITY = "g"  # the unit of many accelerometers
LOOKED_AT = 16  # samples of a run at which eigenvalues are taken


class ODESimulator(Simulator):
    r"""Simulate :math:`\dot x = f(x, u, p)`, :math:`y = h(x, u, p, \dot x)` by Runge-Kutta of order four.

    Parameters
    ----------
    function : callable
        ``f(x, u, p)`` of three 1-D arrays (states, inputs, parameters), returning one rate a state as tuple,
        list or array. It is compiled when numba can; otherwise it runs as Python, many times slower,
        and a warning says so. Methods, callable objects and partial functions are taken too; attributes
        of objects and items of mappings with names are constants as they stand when a run begins, and
        tables of ``scipy.interpolate`` and polynomials are compiled. Inputs that it does not use are measured
        channels (a temperature, a load): they may turn out to matter.
    dt : float
        Sampling period, s.
    parameters : mapping of {str: float} or {str: (float, float, float)}
        Nominal values by name, with the unit in brackets; three numbers are value, lower and upper bound.
        A parameter without bounds keeps the sign of its nominal value when it is refitted.
    states, inputs : sequence of str or mapping of {str: str}
        Names with units in brackets, ``"position [m]"``, or units by name, ``{"position": "m"}``.
    outputs : sequence of str or mapping of {str: str}, optional
        Names of the measured outputs.
    output : sequence of int or callable, optional
        Indices of the states that are measured, or ``h(x, u, p)``. By default the states named as the
        outputs are, or else the first ones. What an accelerometer sees is ``h(x, u, p, rates)``: rates are
        dx/dt as they are, with all forces that were not in the simulation. An output that repeats the
        rate of a speed, times a constant and off by what no signal moves (a weight), is taken for one.
    substeps : int, default=1
        Integration steps in one sampling period. Where dry friction brings a motion to rest, or turns it
        about, a step is parted further, and what the equations have as a sign, an ``if`` or a steep tanh of
        a state, or of the difference of two states of one unit, sticks without chatter.
    hold : {"zero", "linear"}, default=None
        What the inputs do between samples: stay as they are, as a computer's commands, or go on in straight
        lines. With None they stay, unless a diagnosis finds that straight lines fit clearly better.
    x0 : mapping of {str: float} or sequence of float, optional
        States from which a run begins where neither the caller nor the recording tells: all in order, or
        some by name, the others zero. Equations that make no sense at zero (a gap in a denominator, an
        absolute temperature) need it for states that no output shows.

    Raises
    ------
    TypeError
        If an argument is of the wrong kind.
    ValueError
        If the function raises or returns the wrong number of rates, a name occurs twice, or a value does
        not fit.

    Examples
    --------
    >>> import numpy as np
    >>> from narx_sklearn.discrepancy import ODESimulator
    >>> def tank(x, u, p):
    ...     return (p[0] * u[0] - p[1] * x[0],)
    >>> sim = ODESimulator(tank, dt=0.1, parameters={"gain [m/s/V]": 1.0, "outflow [1/s]": 0.5},
    ...                    states=["level [m]"], inputs=["pump [V]"])
    >>> float(sim.simulate(np.ones(200))[-1, 0].round(3))
    2.0
    >>> sim.steady_state([2.0]).round(6).tolist()
    [4.0]
    """

    reads_parameters = True

    def __init__(
        self,
        function: Callable,
        *,
        dt: float,
        parameters: Mapping[str, Any],
        states: Sequence[str] | Mapping[str, str],
        inputs: Sequence[str] | Mapping[str, str],
        outputs: Sequence[str] | Mapping[str, str] | None = None,
        output: Sequence[int] | Callable | None = None,
        substeps: int = 1,
        hold: str | None = None,
        x0: Mapping[str, float] | Sequence[float] | None = None,
    ):
        if not callable(function):
            raise TypeError(f"function must be callable as f(x, u, p), got {function!r}.")
        if not isinstance(parameters, Mapping):
            raise TypeError(f"parameters must map names to values, got {type(parameters).__name__}.")
        self.function = function
        self.dt = check_period(dt)
        self.states = read_signals(states, "states")
        self.inputs = read_signals(inputs, "inputs")
        self.parameters = tuple(read_parameter(name, given) for name, given in parameters.items())
        check_distinct([p.name for p in self.parameters], "parameters")
        self._x0 = read_start(x0, self.states)
        self.output, self.outputs = self._read_output(output, outputs)
        if not isinstance(substeps, Integral) or isinstance(substeps, bool) or substeps < 1:
            raise ValueError(f"substeps must be an integer of at least 1, got {substeps!r}.")
        self.substeps = int(substeps)
        self.hold_is_told = hold is not None
        self.linear_hold = self.hold_is_told and check_choice(hold, "hold", ("zero", "linear")) == "linear"
        takes = callable(self.output) and takes_rates(self.output)
        self._try_out(takes)
        self._felt: tuple[Acceleration, ...] = () if takes else self._find_accelerations()
        self.sees_rates = takes or bool(self._felt)
        self._found: Switches = self._find_switches()

    def _read_output(self, output, labels):
        names = [state.name for state in self.states]
        signals = None if labels is None else read_signals(labels, "outputs")
        if output is None:
            if signals is None:
                output = (0,)
            elif all(signal.name in names for signal in signals):
                output = tuple(names.index(signal.name) for signal in signals)
            else:
                output = tuple(range(len(signals)))
        if callable(output):
            if signals is None:
                raise ValueError("output is a function, so name what it returns: outputs=['position [m]'].")
            return output, signals
        indices = np.atleast_1d(np.asarray(output))
        if indices.dtype.kind not in "iu":
            raise TypeError(
                f"output must be indices of states or a function h(x, u, p) or h(x, u, p, rates), "
                f"got {output!r}."
            )
        output = tuple(int(i) for i in indices)
        outside = [i for i in output if not 0 <= i < len(names)]
        if outside:
            raise ValueError(f"output names the states {outside}, there are only {len(names)}: {names}.")
        signals = signals or tuple(self.states[i] for i in output)
        if len(signals) != len(output):
            raise ValueError(f"output measures {len(output)} states, outputs names {len(signals)}.")
        check_distinct([signal.name for signal in signals], "outputs")
        return output, signals

    def _try_out(self, takes: bool) -> None:
        """Call the user's functions once, so that mistakes show here and not in a run."""
        _try(self.function, self, len(self.states), "function", "rates, one for each state")
        if callable(self.output):
            wanted = "values, one for each output"
            _try(self.output, self, len(self.outputs), "output", wanted, with_rates=takes)

    def _find_accelerations(self) -> tuple[Acceleration, ...]:
        if not callable(self.output):
            return ()
        sizes = len(self.states), len(self.inputs), len(self.outputs)
        with _far_away():
            found = find_accelerations(self._rates, self._read, sizes, self._about)
        units = ((one, self.states[one.state].unit, self.outputs[one.output].unit) for one in found)
        return tuple(
            one
            for one, speed, felt in units
            if not speed or felt == GRAVITY or may_be_alike(f"{speed}/s", felt)
        )

    def _find_switches(self) -> Switches:
        p, units = self._about, [state.unit for state in self.states]
        with _far_away():
            return find_switches(
                lambda x, u: self._rates(x, u, p.copy()), len(self.inputs), units, self.dt / self.substeps
            )

    @property
    def _about(self) -> np.ndarray:
        """What parameters may be, none of them nothing."""
        return np.where(self.nominal == 0, np.clip(1.0, *self.bounds.T), self.nominal)

    def _rates(self, x, u, p) -> np.ndarray:
        return np.asarray(self.function(x, u, p), dtype=float).reshape(len(self.states))

    def _read(self, x, u, p) -> np.ndarray:
        return np.asarray(self.output(x, u, p), dtype=float).reshape(len(self.outputs))

    @property
    def switches(self) -> Switches:
        return self._found

    def _equations(self):
        equation = compiled(self.function, len(self.states))
        output = compiled(self.output, len(self.outputs)) if callable(self.output) else picker(self.output)
        if self._felt:
            output = with_accelerations(output, self._felt, len(self.states))
        return equation, output

    @property
    def compiled(self) -> bool:
        """Whether the right-hand side runs compiled."""
        return not getattr(self._equations()[0], "runs_python", False)

    def known_states(self, u, y, samples, began=None):
        """Return a guess of the states at the given samples: the measured ones, NaN for the others."""
        if callable(self.output):
            return states_read(self, u[samples], y[samples])
        guess = np.full((samples.size, len(self.states)), np.nan)
        for column, state in enumerate(self.output):
            guess[:, state] = y[samples, column]
        return guess

    def jacobian(self, x, u, p=None) -> Linearisation:
        """Return the derivatives of the equations at one point, effects not counted.

        Parameters
        ----------
        x : array-like of shape (n_states,)
            States.
        u : array-like of shape (n_inputs,)
            Inputs.
        p : array-like of shape (n_parameters,), default=None
            Parameters, the nominal ones when None.

        Returns
        -------
        Linearisation
            ``A`` = df/dx, ``B`` = df/du, ``C`` = dh/dx, ``D`` = dh/du, by central differences.

        Raises
        ------
        ValueError
            If an argument has the wrong size.
        """
        return linearise(self, *self._point(x, u, p))

    def steady_state(self, u, p=None) -> np.ndarray:
        """Return states at which the simulator rests under constant inputs, effects not counted.

        Parameters
        ----------
        u : array-like of shape (n_inputs,)
            Constant inputs.
        p : array-like of shape (n_parameters,), default=None
            Parameters, the nominal ones when None.

        Returns
        -------
        ndarray of shape (n_states,)
            A stable rest where one was found, else an unstable one.

        Raises
        ------
        ValueError
            If none is found, as for an integrator that is driven.
        """
        _, u, p = self._point(np.zeros(len(self.states)), u, p)
        return steady_state(self, u, p)

    def _point(self, x, u, p):
        p = self.nominal if p is None else p
        wanted = {"x": len(self.states), "u": len(self.inputs), "p": len(self.parameters)}
        point = [np.atleast_1d(np.asarray(given, dtype=float)) for given in (x, u, p)]
        for (name, size), given in zip(wanted.items(), point, strict=True):
            if given.shape != (size,):
                raise ValueError(f"{name} has shape {given.shape}, wanted is ({size},).")
        return point

    def _warn_of_trouble(self, run, u, windows) -> None:
        super()._warn_of_trouble(run, u, windows)
        wanted = self.steps_wanted(run.x, u)
        if wanted:
            warnings.warn(
                f"The fastest eigenvalue of the equations is {self._fastest(run.x, u):.4g} 1/s, too fast for "
                f"integration steps of {self.dt / self.substeps:.4g} s: the run may be unstable or wrong. "
                f"Try substeps={wanted}.",
                NarxWarning,
                stacklevel=3,
            )

    def steps_wanted(self, x, u):
        """Return how many integration steps a sample takes at states of a run; 0 where those it has do."""
        fastest = self._fastest(x, u) * self.dt
        return int(np.ceil(fastest / SETTLED)) if fastest > STABLE * self.substeps else 0

    def _fastest(self, x, u) -> float:
        """Return the largest eigenvalue, 1/s, of the equations in a fifth of a run, growing modes left out.

        A single point does not count: at an empty tank the slope of a root is infinite.
        """
        good = np.flatnonzero(np.isfinite(x).all(axis=1) & np.isfinite(u).all(axis=1))
        fastest = [0.0] * (PASSING + 1)
        if good.size and self.states:
            for k in good[np.linspace(0, good.size - 1, LOOKED_AT).astype(int)]:
                A = linearise(self, self.switches.clear_of(x[k], steps(x[k])), u[k]).A
                if np.all(np.isfinite(A)):
                    eigenvalues = np.linalg.eigvals(A)
                    slow = eigenvalues.real <= 1e-6 * np.abs(eigenvalues)
                    fastest.append(float(np.abs(eigenvalues[slow]).max(initial=0.0)))
        return sorted(fastest)[-PASSING - 1]

    def __repr__(self) -> str:
        called = getattr(self.function, "__name__", type(self.function).__name__)
        return describe(self, f"ODESimulator of {called}, dt={self.dt:g} s")


@contextmanager
def _far_away() -> Iterator[None]:
    """Say nothing of what equations do where the machine does not go."""
    with warnings.catch_warnings(), np.errstate(all="ignore"):
        warnings.simplefilter("ignore")
        yield


def describe(simulator: Simulator, head: str) -> str:
    """Return a simulator in a few lines: signals, parameters and effects."""
    lines = [head]
    for word in ("states", "inputs", "outputs"):
        signals = [str(signal) for signal in getattr(simulator, word)]
        more = f" and {len(signals) - SHOWN} more" if len(signals) > SHOWN else ""
        lines.append(f"  {word}: {', '.join(signals[:SHOWN])}{more}")
    values = (f"{p.name}={p.value:.6g}{f' {p.unit}' if p.unit else ''}" for p in simulator.parameters)
    lines.append(f"  parameters: {', '.join(values)}")
    if simulator.effects:
        acting = (f"{placed.effect.code} at {placed.port}" for placed in simulator.effects)
        lines.append(f"  effects: {', '.join(acting)}")
    return "\n".join(lines)


def check_period(dt) -> float:
    """Return a sampling period, s, or raise."""
    if not isinstance(dt, Real) or isinstance(dt, bool):
        raise TypeError(f"dt is the sampling period in seconds, a number; got {dt!r}.")
    if not 0 < float(dt) < np.inf:
        raise ValueError(f"dt is the sampling period in seconds and must be positive, got {dt!r}.")
    return float(dt)


def read_signals(labels: Sequence[str] | Mapping[str, str], name: str) -> tuple[Signal, ...]:
    """Return labels such as ``"position [m]"``, or units by name, as signals with different names."""
    if isinstance(labels, Mapping):
        if not all(isinstance(unit, str) for unit in labels.values()):
            raise TypeError(f"{name} must be units by name like {{'position': 'm'}}, got {labels!r}.")
        labels = [f"{label} [{unit}]" if unit else label for label, unit in labels.items()]
    if isinstance(labels, str) or not all(isinstance(label, str) for label in labels):
        raise TypeError(f"{name} must be a list of names like ['position [m]'], got {labels!r}.")
    signals = tuple(Signal.parse(label) for label in labels)
    check_distinct([signal.name for signal in signals], name)
    return signals


def check_distinct(names: Sequence[str], what: str) -> None:
    """Raise a ValueError if a name occurs twice."""
    repeated = sorted({name for name in names if list(names).count(name) > 1})
    if repeated:
        raise ValueError(f"{what} names {repeated} twice; every name must be given once.")


def read_start(given, states: Sequence[Signal]) -> np.ndarray:
    """Return the states from which runs begin, given in order or some of them by name; zero by default."""
    if given is None:
        return np.zeros(len(states))
    names = [state.name for state in states]
    if isinstance(given, Mapping):
        by_name = {Signal.parse(label).name: value for label, value in given.items()}
        unknown = sorted(set(by_name) - set(names))
        if unknown:
            raise ValueError(f"x0 names {unknown}; the states are {names}.")
        given = [by_name.get(name, 0.0) for name in names]
    try:
        values = np.array(given, dtype=float)
    except (TypeError, ValueError):
        values = np.empty(0)
    if values.shape != (len(states),) or not np.all(np.isfinite(values)):
        raise ValueError(f"x0 is {given!r}; wanted is a finite value for each of the states {names}.")
    return values


def read_parameter(label: str, given) -> Parameter:
    """Return a parameter from its label and value, or value, lower and upper bound."""
    name, unit = Signal.parse(label)
    try:
        values = np.atleast_1d(np.asarray(given, dtype=float))
    except (TypeError, ValueError):
        values = np.empty(0)
    if values.size not in (1, 3) or not np.isfinite(values[0]):
        raise ValueError(f"Parameter {name!r} needs a finite value or (value, lower, upper), got {given!r}.")
    if values.size == 3:
        value, lower, upper = values
        if not lower <= value <= upper:
            raise ValueError(
                f"Parameter {name!r}: {value} does not lie between its bounds {lower} and {upper}."
            )
        return Parameter(name, unit, float(value), float(lower), float(upper))
    value = float(values[0])
    lower, upper = (0.0, np.inf) if value > 0 else (-np.inf, 0.0) if value < 0 else (-np.inf, np.inf)
    return Parameter(name, unit, value, lower, upper)


def _try(function, simulator: ODESimulator, n: int, name: str, wanted: str, with_rates: bool = False) -> None:
    """Call a function with ones, or with zeros where it does not like ones, and check what it returns."""
    name += "(x, u, p, rates)" if with_rates else "(x, u, p)"
    n_states, n_inputs = len(simulator.states), len(simulator.inputs)

    def called(value):
        rates = [np.full(n_states, value)] if with_rates else []
        with np.errstate(all="ignore"):  # such numbers may make no sense together
            return function(np.full(n_states, value), np.full(n_inputs, value), simulator.nominal, *rates)

    try:
        result = called(1.0)
    except Exception as error:
        try:
            result = called(0.0)
        except Exception:
            raise ValueError(
                f"{name} raised {type(error).__name__}: {error}, called with all states and inputs 1 (and "
                f"again with 0). Its arguments are arrays, to be taken by place: {_by_place(simulator)}."
            ) from error
    if isinstance(result, tuple | list):
        result = np.concatenate([np.empty(0), *(np.asarray(value).reshape(-1) for value in result)])
    values = np.asarray(result)
    if values.dtype.kind not in "biuf":
        raise ValueError(f"{name} returned {result!r}; wanted are {n} numbers.")
    if values.size != n:
        raise ValueError(f"{name} returned {values.size} values; wanted are {n} {wanted}.")


def _by_place(simulator: ODESimulator) -> str:
    """Return what stands where in the arguments of a simulator's functions, as text."""
    told = []
    for letter, kind in zip("xup", ("states", "inputs", "parameters"), strict=True):
        names = [one.name for one in getattr(simulator, kind)]
        told += [f"{letter}[{i}] is {name}" for i, name in enumerate(names[:SHOWN])]
        told += [f"and {len(names) - SHOWN} more in {letter}"] * (len(names) > SHOWN)
        told += [f"{letter} is empty"] * (not names)
    return ", ".join(told)
