"""phi regressors: functions of lagged inputs and outputs that enter a model like signals (2.12).

Each is a small value: the signal it is a function of, a name, and what it becomes at rest and in
quasi-static loading and unloading. The functions themselves are kernels, so that one definition serves
identification, free run and compensation.
"""

from collections.abc import Callable, Sequence
from dataclasses import KW_ONLY, dataclass, field, fields
from numbers import Real
from typing import Any, ClassVar

import numpy as np

from narx_sklearn.model import kernels
from narx_sklearn.model.polynomials import Polynomial
from narx_sklearn.model.terms import Variable

__all__ = [
    "AbsoluteDifference",
    "AsymmetricSign",
    "Difference",
    "DifferenceSign",
    "FunctionPhi",
    "HystereticOperator",
    "Phi",
    "Play",
    "SmoothSign",
    "phi_from_dict",
]


@dataclass(frozen=True)
class Phi:
    """Base of the phi regressors.

    Parameters
    ----------
    signal : str
        Name of the input or output it is a function of.
    name : str or None, default=None
        Its name in terms, ``phi1``, ``phi2``, ... by position when None.
    """

    signal: str
    _: KW_ONLY
    name: str | None = None

    kind: ClassVar[int]
    #: Samples before the present that its value depends on, other than through a memory of its own.
    reach: ClassVar[int] = 1
    #: Whether it remembers more than ``reach`` samples.
    has_memory: ClassVar[bool] = False

    @property
    def arguments(self) -> tuple[Variable, ...]:
        """Variables it is a function of, at the present sample ``k``."""
        return tuple(Variable(self.signal, lag) for lag in range(self.reach + 1))

    @property
    def signals(self) -> frozenset[str]:
        """Names of the signals it is a function of."""
        return frozenset(variable.signal for variable in self.arguments)

    @property
    def kernel_parameters(self) -> np.ndarray:
        """Numbers the kernel of this kind takes, shape (n,)."""
        return np.zeros(1)

    def run(self, *sources: np.ndarray) -> np.ndarray:
        """Return its values along one recording; before the first sample the signal is held.

        Parameters
        ----------
        *sources : ndarray of shape (n_samples,)
            The signal (for `FunctionPhi`: one for each argument's signal, in order of first use).

        Returns
        -------
        ndarray of shape (n_samples,)
        """
        values, _ = self.run_with_state(np.ascontiguousarray(sources[0], dtype=float))
        return values

    def run_with_state(self, source: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return its values along one recording and its state at the end."""
        values = np.empty(source.size)
        state = np.zeros(kernels.STATE_SIZE)
        if source.size:
            kernels.phi_run(self.kind, self.kernel_parameters, source, state, values)
        return values, state

    def expansion(self, direction: int) -> Polynomial | None:
        """Return it as a polynomial in lagged signals while the signal moves one way, None if it is none.

        Parameters
        ----------
        direction : {-1, 0, 1}
            Unloading, rest, loading.
        """
        return Polynomial() if direction == 0 else None

    def quasi_static(self, level, rate):
        """Return its value when the signal passes ``level`` with a small difference ``rate`` a sample."""
        raise NotImplementedError

    def describe(self) -> str:
        """Return the definition as text, at sample k."""
        raise NotImplementedError

    def to_dict(self) -> dict[str, Any]:
        """Return type and fields, for JSON."""
        return {"type": type(self).__name__} | {f.name: getattr(self, f.name) for f in fields(self)}

    def _difference(self) -> Polynomial:
        return Polynomial({Variable(self.signal, 0): 1.0, Variable(self.signal, 1): -1.0})


@dataclass(frozen=True)
class Difference(Phi):
    """First difference, ``s[k] - s[k-1]`` (4.2).

    Parameters
    ----------
    signal : str
        The signal.
    name : str or None, default=None
        Its name in terms.

    Examples
    --------
    >>> from narx_sklearn.model import Difference
    >>> Difference("u").run([0.0, 2.0, 1.0]).tolist()
    [0.0, 2.0, -1.0]
    """

    kind = kernels.DIFFERENCE

    def expansion(self, direction):
        return self._difference() if direction else Polynomial()

    def quasi_static(self, level, rate):
        return rate + 0.0 * level

    def describe(self):
        return f"{self.signal}[k] - {self.signal}[k-1]"


@dataclass(frozen=True)
class DifferenceSign(Phi):
    """Sign of the first difference: 1 in loading, -1 in unloading, 0 at rest (4.2).

    Parameters
    ----------
    signal : str
        The signal.
    name : str or None, default=None
        Its name in terms.

    Examples
    --------
    >>> from narx_sklearn.model import DifferenceSign
    >>> DifferenceSign("u").run([0.0, 2.0, 2.0, 1.0]).tolist()
    [0.0, 1.0, 0.0, -1.0]
    """

    kind = kernels.DIFFERENCE_SIGN

    def expansion(self, direction):
        return Polynomial.constant(float(direction))

    def quasi_static(self, level, rate):
        return np.sign(rate) + 0.0 * level

    def describe(self):
        return f"sign({self.signal}[k] - {self.signal}[k-1])"


@dataclass(frozen=True)
class AbsoluteDifference(Phi):
    """Absolute first difference, ``|s[k] - s[k-1]|``.

    Parameters
    ----------
    signal : str
        The signal.
    name : str or None, default=None
        Its name in terms.

    Examples
    --------
    >>> from narx_sklearn.model import AbsoluteDifference
    >>> AbsoluteDifference("u").run([0.0, 2.0, 1.0]).tolist()
    [0.0, 2.0, 1.0]
    """

    kind = kernels.ABSOLUTE_DIFFERENCE

    def expansion(self, direction):
        return float(direction) * self._difference()

    def quasi_static(self, level, rate):
        return np.abs(rate) + 0.0 * level

    def describe(self):
        return f"|{self.signal}[k] - {self.signal}[k-1]|"


@dataclass(frozen=True)
class SmoothSign(Phi):
    """Sign of the first difference without its jump, ``tanh((s[k] - s[k-1]) / width)``.

    Parameters
    ----------
    signal : str
        The signal.
    width : float
        Difference over which the sign turns, in the unit of the signal; positive.
    name : str or None, default=None
        Its name in terms.

    Examples
    --------
    >>> from narx_sklearn.model import SmoothSign
    >>> SmoothSign("u", width=0.5).run([0.0, 0.0, 0.25]).round(3).tolist()
    [0.0, 0.0, 0.462]
    """

    width: float = 1.0
    kind = kernels.SMOOTH_SIGN

    def __post_init__(self):
        _check_positive(self, "width")

    @property
    def kernel_parameters(self):
        return np.array([self.width])

    def quasi_static(self, level, rate):
        return np.tanh(rate / self.width) + 0.0 * level

    def describe(self):
        return f"tanh(({self.signal}[k] - {self.signal}[k-1])/{self.width:g})"


@dataclass(frozen=True)
class AsymmetricSign(Phi):
    """Multi-valued function: one polynomial of the signal in loading, another in unloading (2.66).

    Parameters
    ----------
    signal : str
        The signal.
    rising, falling : sequence of float
        Coefficients of the powers 0, 1, 2, ... of ``s[k]`` while it rises and while it falls. The
        thesis's example (2.66) is ``rising=(0, 1), falling=(-1,)``.
    name : str or None, default=None
        Its name in terms.

    Examples
    --------
    >>> from narx_sklearn.model import AsymmetricSign
    >>> AsymmetricSign("u", rising=(0, 1), falling=(-1,)).run([0.0, 2.0, 2.0, 1.0]).tolist()
    [0.0, 2.0, 0.0, -1.0]
    """

    rising: tuple[float, ...] = (1.0,)
    falling: tuple[float, ...] = (-1.0,)
    kind = kernels.ASYMMETRIC_SIGN

    def __post_init__(self):
        for side in ("rising", "falling"):
            coefficients = tuple(float(c) for c in getattr(self, side))
            if not coefficients or not np.all(np.isfinite(coefficients)):
                raise ValueError(
                    f"{side} needs at least one finite coefficient (of the powers 0, 1, ... of the "
                    f"signal), got {getattr(self, side)!r}."
                )
            object.__setattr__(self, side, coefficients)

    @property
    def kernel_parameters(self):
        return np.array([len(self.rising), *self.rising, *self.falling])

    def expansion(self, direction):
        if direction == 0:
            return Polynomial()
        level = Polynomial.variable(Variable(self.signal, 0))
        branch = self.rising if direction > 0 else self.falling
        return sum((c * level**p for p, c in enumerate(branch)), Polynomial())

    def quasi_static(self, level, rate):
        rising = np.polynomial.polynomial.polyval(level, self.rising)
        falling = np.polynomial.polynomial.polyval(level, self.falling)
        return np.where(rate > 0, rising, np.where(rate < 0, falling, 0.0))

    def describe(self):
        rising, falling = self.expansion(1), self.expansion(-1)
        return f"({rising}) while {self.signal} rises, ({falling}) while it falls, else 0"


@dataclass(frozen=True)
class Play(Phi):
    """Play operator: follows the signal at a distance ``radius``, holds on reversal (2.7).

    Weighted plays of several radii remember every dominant reversal (non-local memory).

    Parameters
    ----------
    signal : str
        The signal.
    radius : float
        Half the lost motion, in the unit of the signal; positive.
    name : str or None, default=None
        Its name in terms.

    Examples
    --------
    >>> from narx_sklearn.model import Play
    >>> Play("u", radius=1.0).run([0.0, 3.0, 2.0, 0.0]).tolist()
    [0.0, 2.0, 2.0, 1.0]
    """

    radius: float = 1.0
    kind = kernels.PLAY
    reach = 0
    has_memory = True

    def __post_init__(self):
        _check_positive(self, "radius")

    @property
    def kernel_parameters(self):
        return np.array([self.radius])

    def expansion(self, direction):
        if direction == 0:
            return None
        return Polynomial.variable(Variable(self.signal, 0)) - float(direction) * self.radius

    def quasi_static(self, level, rate):
        return level - np.sign(rate) * self.radius

    def describe(self):
        return f"play of {self.signal} with radius {self.radius:g}"


@dataclass(frozen=True)
class HystereticOperator(Phi):
    """Deng and Tan's hysteretic operator with its memory of the dominant extremum (2.55).

    Parameters
    ----------
    signal : str
        The signal.
    name : str or None, default=None
        Its name in terms.

    Examples
    --------
    >>> from narx_sklearn.model import HystereticOperator
    >>> HystereticOperator("u").run([0.0, 1.0, 0.0]).tolist()
    [0.0, 0.7853981633974483, 0.0]
    """

    kind = kernels.HYSTERETIC
    reach = 0
    has_memory = True

    def expansion(self, direction):
        return None

    def quasi_static(self, level, rate):
        level = np.asarray(level, dtype=float)
        start = level.min() if np.all(np.asarray(rate) >= 0) else level.max()
        return np.abs(np.arctan(level - start)) * (level - start)

    def describe(self):
        return f"hysteretic operator of {self.signal}"


@dataclass(frozen=True)
class FunctionPhi(Phi):
    """A function of the user's, of any lagged inputs and outputs.

    Parameters
    ----------
    function : callable
        ``function(*arguments) -> value``, elementwise on arrays.
    arguments : sequence of Variable or str
        What it is called with, at sample k: texts like ``"y[k]"``, ``"u[k-1]"``.
    name : str or None, default=None
        Its name in terms.

    Examples
    --------
    >>> import numpy as np
    >>> from narx_sklearn.model import FunctionPhi
    >>> FunctionPhi(np.abs, ["u[k]"], name="phi1").run(np.array([-1.0, 2.0])).tolist()
    [1.0, 2.0]
    """

    signal: str = field(init=False, repr=False, default="")
    function: Callable = field(default=np.abs, kw_only=False)
    of: tuple[Variable, ...] = field(default=(), kw_only=False)

    def __init__(self, function: Callable, arguments: Sequence[Variable | str], *, name: str | None = None):
        if not callable(function):
            raise TypeError(f"function must be callable, got {type(function).__name__}.")
        of = tuple(Variable.parse(a) if isinstance(a, str) else a for a in arguments)
        if not of or any(variable.lag < 0 for variable in of):
            raise ValueError(
                f"arguments must name at least one variable at lag 0 or more, got {arguments!r}; "
                "write them like ['y[k]', 'u[k-1]']."
            )
        for attribute, value in (
            ("function", function),
            ("of", of),
            ("name", name),
            ("signal", of[0].signal),
        ):
            object.__setattr__(self, attribute, value)

    @property
    def arguments(self):
        return self.of

    @property
    def reach(self):  # type: ignore[override]
        return max(variable.lag for variable in self.of)

    def run(self, *sources):
        signals = list(dict.fromkeys(variable.signal for variable in self.of))
        if len(sources) != len(signals):
            raise ValueError(f"run needs one array for each of the signals {signals}, got {len(sources)}.")
        by_name = {s: np.asarray(a, dtype=float) for s, a in zip(signals, sources, strict=True)}
        lagged = (_hold_shift(by_name[variable.signal], variable.lag) for variable in self.of)
        values = np.asarray(self.function(*lagged), dtype=float)
        n_samples = by_name[signals[0]].shape[0]
        if values.shape != (n_samples,):
            raise ValueError(
                f"The function of {self.describe()} returned shape {values.shape} for {n_samples} samples; "
                "it must work elementwise and return one value a sample."
            )
        return values

    def quasi_static(self, level, rate):
        return self.function(*(level - variable.lag * rate for variable in self.of))

    def expansion(self, direction):
        return None

    def describe(self):
        called = getattr(self.function, "__name__", type(self.function).__name__)
        return f"{called}({', '.join(map(str, self.of))})"

    def to_dict(self):
        called = getattr(self.function, "__name__", type(self.function).__name__)
        return {
            "type": "FunctionPhi",
            "name": self.name,
            "function": called,
            "arguments": [str(variable) for variable in self.of],
        }


_TYPES = {
    cls.__name__: cls
    for cls in (
        Difference,
        DifferenceSign,
        AbsoluteDifference,
        SmoothSign,
        AsymmetricSign,
        Play,
        HystereticOperator,
    )
}


def phi_from_dict(content: dict[str, Any], functions: dict[str, Callable] | None = None) -> Phi:
    """Return the phi regressor that `Phi.to_dict` wrote.

    Parameters
    ----------
    content : dict
        Type and fields.
    functions : dict of {str: callable}, optional
        The functions of `FunctionPhi`, by name: code is never read from a file.

    Raises
    ------
    ValueError
        If the type is unknown, a field is missing or a function is not given.
    """
    content = dict(content)
    kind = content.pop("type", None)
    if kind == "FunctionPhi":
        called = content.get("function")
        if not functions or called not in functions:
            raise ValueError(
                f"The phi regressor {content.get('name')!r} calls the function {called!r}, which a file "
                f"cannot hold; pass it as functions={{{called!r}: ...}}."
            )
        return FunctionPhi(functions[called], content.get("arguments", ()), name=content.get("name"))
    if kind not in _TYPES:
        raise ValueError(f"Unknown type of phi regressor {kind!r}; known are {sorted(_TYPES)}, FunctionPhi.")
    try:
        return _TYPES[kind](**content)
    except TypeError as error:
        raise ValueError(f"The fields of the phi regressor {kind} do not fit: {error}.") from error


def _check_positive(phi: Phi, attribute: str) -> None:
    value = getattr(phi, attribute)
    if not isinstance(value, Real) or not 0 < float(value) < np.inf:
        raise ValueError(f"{attribute} of {type(phi).__name__} must be a positive number, got {value!r}.")
    object.__setattr__(phi, attribute, float(value))


def _hold_shift(values: np.ndarray, lag: int) -> np.ndarray:
    """Delay by ``lag`` samples, holding the first value."""
    if lag == 0:
        return values
    return np.concatenate([np.full(min(lag, values.size), values[0]), values[:-lag]])[: values.size]
