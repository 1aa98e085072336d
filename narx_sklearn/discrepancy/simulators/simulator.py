"""What a simulator is: something that is stepped, with ports at which missing physics may enter."""

import warnings
from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from copy import copy
from typing import Any, NamedTuple, Self

import numpy as np

from narx_sklearn._validation import finite_rows, finite_slices, session_slices, split_unit
from narx_sklearn.discrepancy.columns import read_columns
from narx_sklearn.discrepancy.placed import PlacedEffect, in_turn
from narx_sklearn.discrepancy.simulators.addresses import equation_address, write_values
from narx_sklearn.discrepancy.simulators.applied import Sessions, applied
from narx_sklearn.discrepancy.simulators.kernels import simulate_windows
from narx_sklearn.discrepancy.simulators.slots import is_special, slots
from narx_sklearn.discrepancy.simulators.switches import Switches
from narx_sklearn.discrepancy.simulators.varied import varied
from narx_sklearn.exceptions import DivergenceWarning
from narx_sklearn.physics.effects import PARAMETER
from narx_sklearn.physics.effects._effect import MAX_MEMORY


class Signal(NamedTuple):
    """A named quantity with its unit."""

    name: str
    unit: str

    @classmethod
    def parse(cls, label: str) -> "Signal":
        """Read ``"position [m]"``."""
        name, unit = split_unit(label)
        return cls(name, unit or "")

    def __str__(self) -> str:
        return f"{self.name} [{self.unit}]" if self.unit else self.name


class Parameter(NamedTuple):
    """A parameter of a simulator: nominal value and physical bounds."""

    name: str
    unit: str
    value: float
    lower: float = -np.inf
    upper: float = np.inf


class Windows(NamedTuple):
    """Stretches of a record that are run each from its own initial state, in order of time."""

    first: np.ndarray  # (n_windows,) first sample
    last: np.ndarray  # (n_windows,) one past the last sample
    fresh: np.ndarray  # (n_windows,) bool: nothing is carried over from the window before
    began: np.ndarray  # (n_windows,) first sample of the session

    @property
    def count(self) -> int:  # type: ignore[override]
        """Number of windows."""
        return self.first.size

    @property
    def length(self) -> int:
        """How many samples a window has, the median."""
        return int(np.median(self.last - self.first))

    @classmethod
    def whole(cls, pieces: Sequence[slice]) -> "Windows":
        """Return one window a piece."""
        first = np.array([piece.start for piece in pieces], dtype=np.int64)
        last = np.array([piece.stop for piece in pieces], dtype=np.int64)
        return cls(first, last, np.ones(first.size, dtype=bool), first)


class Run(NamedTuple):
    """A simulation: outputs, states and the states of the effects at every sample."""

    y: np.ndarray  # (n_samples, n_outputs); NaN outside the windows and after the finite range was left
    x: np.ndarray  # (n_samples, n_states)
    z: np.ndarray  # (n_samples, n_forces * MAX_MEMORY)
    failed: int  # first sample outside the finite range, -1 when there is none


class Simulator(ABC):
    """Base of all simulators: signals, parameters, effects, and the run over windows.

    A subclass gives ``_equations()``: the compiled right-hand side and output, both
    ``(x, u, p, written)``, where an output that ``sees_rates`` has them after the states in ``x``. Everything
    else is here.
    """

    dt: float
    states: tuple[Signal, ...]
    inputs: tuple[Signal, ...]
    outputs: tuple[Signal, ...]
    parameters: tuple[Parameter, ...]
    effects: tuple[PlacedEffect, ...] = ()
    substeps: int = 1
    linear_hold: bool = False
    hold_is_told: bool = True  # what inputs do between samples; else a diagnosis asks the record
    discrete: bool = False
    sees_rates: bool = False
    reads_parameters: bool = False  # its equations do, so that one may depend on a signal
    _x0: np.ndarray | None = None

    @abstractmethod
    def _equations(self) -> tuple[Any, Any]:
        """Return the compiled right-hand side and output."""

    @property
    def switches(self) -> Switches:
        """Where the equations jump: nowhere that is known of, but for equations in continuous time."""
        return Switches.none(len(self.states))

    def _coefficients(self, p: np.ndarray) -> np.ndarray:
        """Return what the equations read where parameters are ``p``: the parameters, but for stand-ins."""
        return p

    @property
    def free_states(self) -> np.ndarray:
        """Which initial states are unknown, shape (n_states,); the others follow from measured signals."""
        return np.ones(len(self.states), dtype=bool)

    def known_states(self, u: np.ndarray, y: np.ndarray, samples: np.ndarray, began=None) -> np.ndarray:
        """Return a guess of the states at the given samples, shape (n, n_states); NaN where there is none.

        ``began`` is the first sample of the session of each, by default that of the record. States that are
        not free must be given exactly.
        """
        return np.full((samples.size, len(self.states)), np.nan)

    @property
    def x0(self) -> np.ndarray:
        """States from which a run begins where nothing tells of others, shape (n_states,)."""
        return np.zeros(len(self.states)) if self._x0 is None else self._x0.copy()

    def told_states(self, u: np.ndarray, y: np.ndarray, samples: np.ndarray, began=None) -> np.ndarray:
        """Return the states at the given samples, shape (n, n_states): as measured, or else ``x0``."""
        known = self.known_states(u, y, samples, began)
        return np.where(np.isfinite(known), known, self.x0)

    @property
    def nominal(self) -> np.ndarray:
        """Parameter values, shape (n_parameters,)."""
        return np.array([parameter.value for parameter in self.parameters], dtype=float)

    @property
    def bounds(self) -> np.ndarray:
        """Bounds of the parameters, shape (n_parameters, 2)."""
        return np.array([(p.lower, p.upper) for p in self.parameters], dtype=float).reshape(-1, 2)

    def signals_at(self, kind: str) -> tuple[Signal, ...]:
        """Return what is at the ports of one kind: inputs, states, outputs or parameters."""
        if kind == PARAMETER:
            return tuple(Signal(p.name, p.unit) for p in self.parameters)
        return {"input": self.inputs, "state": self.states, "output": self.outputs}[kind]

    def with_parameters(self, values) -> Self:
        """Return a copy with other values: a mapping by names, with or without units, or all in order.

        Raises
        ------
        ValueError
            If a name is not known, or not as many values as parameters are given.
        """
        new = copy(self)
        if isinstance(values, Mapping):
            known = {p.name for p in self.parameters}  # a term such as y[k-1] only looks like a unit
            values = {k if k in known else split_unit(k)[0]: value for k, value in values.items()}
            unknown = sorted(set(values) - known)
            if unknown:
                raise ValueError(
                    f"Unknown parameters {unknown}; the simulator has {[p.name for p in self.parameters]}."
                )
            new.parameters = tuple(
                p._replace(value=float(values.get(p.name, p.value))) for p in self.parameters
            )
        else:
            values = list(values)
            if len(values) != len(self.parameters):
                raise ValueError(
                    f"Got {len(values)} values for {len(self.parameters)} parameters: "
                    f"{[p.name for p in self.parameters]}. Pass one for each, or a mapping by name."
                )
            new.parameters = tuple(
                p._replace(value=float(value)) for p, value in zip(self.parameters, values, strict=True)
            )
        return new

    def with_bounds(self, bounds: np.ndarray) -> Self:
        """Return a copy whose parameters may move within other bounds, (n_parameters, 2)."""
        new = copy(self)
        new.parameters = tuple(
            p._replace(lower=float(low), upper=float(high))
            for p, (low, high) in zip(self.parameters, bounds, strict=True)
        )
        return new

    def with_effects(self, effects: Sequence[PlacedEffect]) -> Self:
        """Return a copy in which these effects act (and no others)."""
        new = copy(self)
        new.effects = tuple(effects)
        return new

    def run(
        self,
        u: np.ndarray,
        windows: Windows,
        x0: np.ndarray,
        p: np.ndarray | None = None,
        effects: Sequence[PlacedEffect] | None = None,
        strength: Sequence[float] | None = None,
    ) -> Run:
        """Run the windows; arrays in, arrays out, nothing checked.

        ``strength`` scales each effect: 1 is the effect as it stands, a small number gives its tangent.
        """
        p = self.nominal if p is None else p
        effects = self.effects if effects is None else tuple(effects)
        share = np.ones(len(effects)) if strength is None else np.asarray(strength, dtype=float)
        u = np.require(u, dtype=float, requirements=["C", "W"])
        is_held = not (self.linear_hold or self.discrete)
        driven, tilt = _at_ports(u, "input", effects, share, None, self.dt, windows, is_held=is_held)
        n_samples = u.shape[0]
        y = np.full((n_samples, len(self.outputs)), np.nan)
        x = np.full((n_samples, len(self.states)), np.nan)
        forces = [(effects[i], share[i]) for i in in_turn(effects)]
        z = np.zeros((n_samples, len(forces) * MAX_MEMORY))
        bends = any(e.port.kind == "output" and e.effect.curved is not None for e in effects)
        within = np.full((2, n_samples if bends and not self.discrete else 0, y.shape[1]), np.nan)
        acting = zip(effects, share, strict=True)
        equations, p = self._equations(), self._coefficients(p)
        equation, output, p, timed = varied(equations, p, acting, len(self.states))
        p = np.require(p, dtype=float, requirements=["C", "W"])
        switches = self.switches
        special = self.discrete or len(switches.weights) > 0 or any(is_special(e) for e, _ in forces)
        try:
            failed = simulate_windows()(
                equation_address(equation),
                equation_address(output),
                *slots(forces, len(self.inputs), len(self.states)),
                *switches,
                p,
                timed,
                np.require(x0, dtype=float, requirements=["C", "W"]),
                driven,
                tilt,
                windows.first,
                windows.last,
                windows.fresh,
                windows.began,
                self.dt,
                self.substeps,
                self.linear_hold,
                self.discrete,
                self.sees_rates,
                special or None,
                y,
                x,
                z,
                *within,
            )
        except Exception as error:
            raise _stopped_by(error, x, windows, self.dt) from error
        y, _ = _at_ports(y, "output", effects, share, driven, self.dt, windows, within=within, x=x)
        return Run(y, x, z, failed)

    def steps_wanted(self, x: np.ndarray, u: np.ndarray) -> int:
        """Return how many integration steps a sample takes at states of a run; 0 where those it has do."""
        return 0

    def identified(self, u, *, sessions=None) -> "Simulator":
        """Return the simulator ready for runs from any state; one that is known by its equations is."""
        return self

    def centred(self, p: np.ndarray) -> "Simulator":
        """Return the simulator ready for runs near parameters; one that is known by its equations is."""
        return self

    def by_equations(self) -> "Simulator":
        """Return the simulator without what is added to the runs of a stand-in."""
        return self

    def simulate(self, X, x0=None, *, sessions=None):
        """Return the outputs for the inputs ``X``, one run a session.

        Parameters
        ----------
        X : array-like or DataFrame of shape (n_samples, n_inputs)
            Inputs, in the units of ``inputs``. Columns of a DataFrame are found by name where all inputs are
            among them, taken in order where none is. NaN marks gaps; the run starts anew after each.
        x0 : array-like of shape (n_states,) or (n_sessions, n_states), optional
            Initial states; when not given the simulator's ``x0``, or for a NARX model its rest at the first
            input.
        sessions : array-like of shape (n_samples,), optional
            One label a sample; each run of equal labels starts anew.

        Returns
        -------
        ndarray or DataFrame of shape (n_samples, n_outputs)
            Outputs; NaN in gaps and from where a run left the finite range. A DataFrame, with the labels of
            ``outputs`` and the index of ``X``, where ``X`` is one.

        Raises
        ------
        ValueError
            If ``X`` or ``x0`` does not fit the simulator.
        RuntimeError
            If its function raises during the run; says at which sample.

        Warns
        -----
        DivergenceWarning
            If the run leaves the finite range; says at which sample.
        """
        u = self._read_inputs(X)
        pieces = session_slices(sessions, u.shape[0])
        windows = Windows.whole(finite_slices(pieces, finite_rows(u)))
        session = np.searchsorted([piece.start for piece in pieces], windows.first, side="right") - 1
        if x0 is None:
            start = self._initial_states(u, windows)
        else:
            start = self._read_states(x0, len(pieces))[session]
        run = self.run(u, windows, start)
        self._warn_of_trouble(run, u, windows)
        if not hasattr(X, "columns"):
            return run.y
        import pandas as pd

        return pd.DataFrame(run.y, index=X.index, columns=[str(signal) for signal in self.outputs])

    def _initial_states(self, u: np.ndarray, windows: Windows) -> np.ndarray:
        """Return the states, (n_windows, n_states), that runs start from when none are given."""
        return np.tile(self.x0, (windows.count, 1))

    def _read_inputs(self, X) -> np.ndarray:
        """Return the inputs as an array; columns by name where the names are all there."""
        return read_columns(X, self.inputs, "X", "input")

    def _read_states(self, x0, n_sessions: int) -> np.ndarray:
        """Return initial states, shape (n_sessions, n_states)."""
        given = np.asarray(x0, dtype=float)
        shapes = ((len(self.states),), (n_sessions, len(self.states)))
        if given.shape not in shapes or not np.all(np.isfinite(given)):
            raise ValueError(
                f"x0 has shape {given.shape}; wanted are finite values of the states "
                f"{[str(s) for s in self.states]}, shape {shapes[0]}, or a row for each session, {shapes[1]}."
            )
        return np.broadcast_to(given, shapes[1])

    def _warn_of_trouble(self, run: Run, u: np.ndarray, windows: Windows) -> None:
        """Warn, with the sample, of what makes a run useless."""
        inside = covered(windows)
        lost = inside[~np.isfinite(run.y[inside]).all(axis=1)]
        if lost.size:
            k = int(lost[0])
            warnings.warn(
                f"The simulation left the finite range at sample {k} ({_time_of(k, windows, self.dt)}); it "
                "is NaN from there to the end of its session, or as long as the output is not defined. Check "
                "parameters, initial states and units.",
                DivergenceWarning,
                stacklevel=3,
            )


def evaluate(simulator: Simulator, x, u, p=None) -> tuple[np.ndarray, np.ndarray]:
    """Return right-hand side (n_states,) and output (n_outputs,) at one point, effects not counted."""
    p = simulator._coefficients(simulator.nominal if p is None else np.asarray(p, dtype=float))
    x, u, p = (np.array(v, dtype=float) for v in (x, u, p))
    rates, outputs = np.empty(len(simulator.states)), np.empty(len(simulator.outputs))
    equation, output = simulator._equations()
    write_values(equation_address(equation), x, u, p, rates)
    seen = np.concatenate([x, rates]) if simulator.sees_rates else x
    write_values(equation_address(output), seen, u, p, outputs)
    return rates, outputs


def _time_of(k: int, windows: Windows, dt: float) -> str:
    """Return a sample's time since its session began, as text."""
    w = max(int(np.searchsorted(windows.first, k, side="right")) - 1, 0)
    return f"t = {(k - windows.began[w]) * dt:.6g} s"


def _stopped_by(error: Exception, x: np.ndarray, windows: Windows, dt: float) -> RuntimeError:
    """Return the error of a run in which the user's function raised, with the sample."""
    reached = np.flatnonzero(~np.isnan(x).all(axis=1))  # states are written as the run goes
    k = int(reached[-1]) if reached.size else int(windows.first[0])
    state = np.array2string(x[k], precision=6, separator=", ")
    return RuntimeError(
        f"The simulator's function raised {type(error).__name__}: {error}, at sample {k} "
        f"({_time_of(k, windows, dt)}), with the states {state} there."
    )


def transformed(signals, kind, effects, strength, driven, dt, windows: Windows, x=None) -> np.ndarray:
    """Return signals with the effects at ports of one kind applied, session by session."""
    return _at_ports(signals, kind, effects, strength, driven, dt, windows, x=x)[0]


def _at_ports(signals, kind, effects, strength, driven, dt, windows: Windows, **along):
    """Return what ``applied`` does, of the effects at ports of one kind."""
    acting = [(e, scale) for e, scale in zip(effects, strength, strict=True) if e.port.kind == kind]
    if not acting:
        return signals, np.empty((0, signals.shape[1]))
    return applied(signals, acting, driven, dt, Sessions.of(windows.began, windows.last), **along)


def covered(windows: Windows) -> np.ndarray:
    """Return the samples inside the windows, in order."""
    if windows.count == 0:
        return np.arange(0)
    if windows.count == 1:
        return np.arange(windows.first[0], windows.last[0])
    return np.concatenate([np.arange(a, b) for a, b in zip(windows.first, windows.last, strict=True)])
