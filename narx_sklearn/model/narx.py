"""The immutable NARX model: equations, signals and units, as a value that is printed, saved and compared."""

import json
import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np

from narx_sklearn.exceptions import ModelFormatError
from narx_sklearn.model.phi import FunctionPhi, Phi, phi_from_dict
from narx_sklearn.model.polynomials import Polynomial
from narx_sklearn.model.terms import TermLibrary, Variable, as_term

__all__ = ["NARXModel"]

FORMAT = "narx_sklearn.NARXModel"
VERSION = 1
LEFT_SIDE = re.compile(r"\s*([^\W\d]\w*)\s*\[\s*k\s*\]\s*=(?!=)")


@dataclass(frozen=True, eq=False)
class NARXModel:
    """A polynomial NARX model, ``y[k] = F(y[k-1], ..., u[k-delay], ..., phi[k-1], ...)`` (2.12).

    Hand-written, published and fitted models are the same kind of value. It is immutable; the functions
    `free_run`, `predict_one_step` and `predict_k_steps` simulate it, the analysis, compensation and
    discrepancy rooms take it.

    Parameters
    ----------
    library : TermLibrary or iterable of str
        Terms of the right-hand side.
    parameters : array-like of shape (n_terms,) or (n_terms, n_outputs)
        Their coefficients, in the order of ``library`` (its canonical order). Zero means that the output
        does not have the term. For terms in an order of your own use `from_equations`.
    outputs, inputs : sequence of str, default=("y",) and ("u",)
        Signal names, in the order of the columns of the data.
    phi : sequence of Phi, default=()
        phi regressors; unnamed ones become ``phi1``, ``phi2``, ... by position.
    sampling_period : float or None, default=None
        Seconds from sample to sample, None where unknown.
    units : mapping of {str: str}, optional
        Unit of each signal.
    origin : mapping of {str: float}, optional
        Operating point: inside the terms an input or output means its deviation from this value. Zero
        where not given.
    recorded : mapping of {str: (float, float, float)}, optional
        Least, mean and largest value of inputs and outputs in the record that the model was identified
        from, in their units; beyond them nothing is known of the machine. A signal may lack. Where a model
        comes from does not count when models are compared.
    recorded_change : mapping of {str: float}, optional
        Largest change of each of them from one sample to the next there, its noise included.

    Examples
    --------
    >>> from narx_sklearn.model import NARXModel
    >>> model = NARXModel.from_equations("0.5*y[k-1] + 0.2*u[k-1]^2")
    >>> print(model)
    y[k] = 0.5*y[k-1] + 0.2*u[k-1]^2
    >>> model.max_lag
    1
    """

    library: TermLibrary
    parameters: np.ndarray
    outputs: tuple[str, ...] = ("y",)
    inputs: tuple[str, ...] = ("u",)
    phi: tuple[Phi, ...] = ()
    sampling_period: float | None = None
    units: Mapping[str, str] = field(default_factory=dict)
    origin: Mapping[str, float] = field(default_factory=dict)
    recorded: Mapping[str, tuple[float, float, float]] = field(default_factory=dict)
    recorded_change: Mapping[str, float] = field(default_factory=dict)

    def __post_init__(self):
        given = self.library if isinstance(self.library, TermLibrary) else list(self.library)
        library = TermLibrary(given)
        if not isinstance(given, TermLibrary) and library.terms != tuple(as_term(t) for t in given):
            raise ValueError(
                "The terms are not in canonical order, so their parameters could be mistaken; build the "
                "TermLibrary first and order the parameters by it, or use NARXModel.from_equations."
            )
        parameters = (
            np.array(self.parameters, dtype=float) + 0.0
        )  # one zero: -0.0 equals 0.0, their bytes differ
        if parameters.ndim == 1:
            parameters = parameters.reshape(-1, 1)
        outputs, inputs = tuple(self.outputs), tuple(self.inputs)
        if parameters.shape != (len(library), len(outputs)):
            raise ValueError(
                f"parameters must have shape ({len(library)}, {len(outputs)}): one row for each term, one "
                f"column for each output; got shape {parameters.shape}."
            )
        if not np.all(np.isfinite(parameters)):
            raise ValueError("parameters hold values that are not finite.")
        parameters.setflags(write=False)
        phi = tuple(
            p if p.name is not None else replace_name(p, f"phi{i + 1}") for i, p in enumerate(self.phi)
        )
        set_field = object.__setattr__
        set_field(self, "library", library)
        set_field(self, "parameters", parameters)
        set_field(self, "outputs", outputs)
        set_field(self, "inputs", inputs)
        set_field(self, "phi", phi)
        set_field(self, "units", MappingProxyType(dict(self.units)))
        set_field(self, "origin", MappingProxyType({s: float(v) for s, v in self.origin.items() if v != 0}))
        recorded = {s: tuple(float(v) for v in values) for s, values in self.recorded.items()}
        set_field(self, "recorded", MappingProxyType(recorded))
        changes = {s: float(v) for s, v in self.recorded_change.items()}
        set_field(self, "recorded_change", MappingProxyType(changes))
        self._check()

    def _check(self) -> None:
        names = self.channels
        for name in names:
            Variable(name, 0)  # refuses what could not be read back from a term
        repeated = {name for name in names if names.count(name) > 1}
        if repeated:
            raise ValueError(f"The signal names {sorted(repeated)} are used twice; names must differ.")
        unknown = self.library.signals - set(names)
        if unknown:
            raise ValueError(
                f"The terms use {sorted(unknown)}, which are neither outputs {list(self.outputs)}, inputs "
                f"{list(self.inputs)} nor phi regressors {[p.name for p in self.phi]}. Say what they are, as "
                f"with inputs={sorted(unknown)[:1]} or outputs={sorted(unknown)[-1:]}."
            )
        for phi in self.phi:
            if not phi.signals <= set(self.outputs + self.inputs):
                raise ValueError(
                    f"{phi.name} is a function of {sorted(phi.signals)}; it can use only the outputs "
                    f"{list(self.outputs)} and inputs {list(self.inputs)}."
                )
        signals = self.outputs + self.inputs
        for word, known in (
            ("units", names),
            ("origin", signals),
            ("recorded", signals),
            ("recorded_change", signals),
        ):
            outside = getattr(self, word).keys() - set(known)
            if outside:
                raise ValueError(f"{word} names {sorted(outside)}, which are not among {list(known)}.")
        if not np.all(np.isfinite(list(self.origin.values()))):
            raise ValueError(f"origin holds values that are not finite: {dict(self.origin)}.")
        for name, values in self.recorded.items():
            if len(values) != 3 or not -np.inf < values[0] <= values[1] <= values[2] < np.inf:
                raise ValueError(
                    f"recorded must hold three finite values of each signal, the least, the mean and the "
                    f"largest in this order; of {name!r} it holds {values}."
                )
        for name, change in self.recorded_change.items():
            if not 0.0 <= change < np.inf:
                raise ValueError(
                    f"recorded_change must hold the largest change of each signal in one sample, finite and "
                    f"not negative; of {name!r} it holds {change!r}."
                )
        for term in self.library:
            for variable in term.variables:
                depends_on_output = variable.signal in self.outputs or variable.signal in self._output_phis
                if variable.lag < (1 if depends_on_output else 0):
                    raise ValueError(
                        f"The term {term} reads {variable}, which is not known when y[k] is computed; "
                        "outputs (and phi regressors of outputs) need lag 1 or more, inputs lag 0 or more."
                    )
        if self.sampling_period is not None and not 0 < self.sampling_period < np.inf:
            raise ValueError(f"sampling_period must be positive and finite, got {self.sampling_period!r}.")

    @classmethod
    def from_equations(cls, equations: "str | Polynomial | Mapping", **fields) -> "NARXModel":
        """Build a model from its equations.

        Parameters
        ----------
        equations : str, Polynomial, or mapping
            The right-hand side of the only output, or whole equations as they are printed, ``"y[k] = ..."``,
            one a line; or a mapping from output names to right-hand sides; or a mapping from terms to
            coefficients.
        **fields
            Further arguments of the model (``outputs``, ``inputs``, ``phi``, ``origin``, ...). Where the
            signals are called otherwise than y and u, ``inputs`` names the inputs, and ``outputs`` the
            outputs that no equation names.

        Returns
        -------
        NARXModel

        Raises
        ------
        ValueError
            If a text cannot be read, an equation is of another output than it is given for, or a signal is
            neither output, input nor phi regressor.

        Examples
        --------
        >>> from narx_sklearn.model import Difference, DifferenceSign, NARXModel
        >>> print(NARXModel.from_equations(
        ...     {"y[k-1]": 1.0, "phi1[k-1]": 0.77, "phi2[k-1]*phi1[k-1]*u[k-1]": 0.0142},
        ...     phi=[Difference("u"), DifferenceSign("u")]))
        y[k] = y[k-1] + 0.77*phi1[k-1] + 0.0142*u[k-1]*phi1[k-1]*phi2[k-1]
          phi1[k] = u[k] - u[k-1]
          phi2[k] = sign(u[k] - u[k-1])
        >>> print(NARXModel.from_equations("speed[k] = drive[k-1] + 0.5*speed[k-1]", inputs=["drive"]))
        speed[k] = drive[k-1] + 0.5*speed[k-1]
        """
        outputs = fields.pop("outputs", None)
        if isinstance(equations, str) and "=" in equations:
            equations = equations_of(equations)
        if isinstance(equations, Mapping):
            values = list(equations.values())
            if all(isinstance(v, str | Polynomial | Mapping) for v in values) and values:
                sides = {str(name): as_polynomial(side, str(name)) for name, side in equations.items()}
            else:
                sides = {outputs[0] if outputs else "y": Polynomial(equations)}
        else:
            sides = {outputs[0] if outputs else "y": as_polynomial(equations)}
        outputs = tuple(outputs) if outputs else tuple(sides)
        if set(outputs) != set(sides):
            raise ValueError(f"Equations are given for {sorted(sides)}, the outputs are {list(outputs)}.")
        library = TermLibrary(term for side in sides.values() for term in side.library)
        parameters = np.array([[sides[output][term] for output in outputs] for term in library])
        return cls(library, parameters.reshape(len(library), len(outputs)), outputs=outputs, **fields)

    @property
    def channels(self) -> tuple[str, ...]:
        """Names of all signals: outputs, inputs, phi regressors."""
        return self.outputs + self.inputs + tuple(str(p.name) for p in self.phi)

    @cached_property
    def _output_phis(self) -> frozenset[str]:
        return frozenset(str(p.name) for p in self.phi if p.signals & set(self.outputs))

    @property
    def n_terms(self) -> int:
        """Number of parameters that are not zero, over all outputs."""
        return int(np.count_nonzero(self.parameters))

    @property
    def degree(self) -> int:
        """Nonlinearity degree."""
        return self.library.degree

    @cached_property
    def max_lag(self) -> int:
        """Samples of the past that ``y[k]`` depends on, those inside phi regressors included."""
        reach = {p.name: p.reach for p in self.phi}
        lags = (v.lag + reach.get(v.signal, 0) for v in self.library.variables)
        return max(lags, default=0)

    @property
    def equations(self) -> dict[str, Polynomial]:
        """Right-hand side of each output as a polynomial."""
        return {
            output: Polynomial(zip(self.library, column, strict=True))
            for output, column in zip(self.outputs, self.parameters.T, strict=True)
        }

    def equation(self, output: str | None = None) -> Polynomial:
        """Return the right-hand side of ``output`` (the first one by default)."""
        return self.equations[self.outputs[0] if output is None else output]

    def with_parameters(self, parameters) -> "NARXModel":
        """Return the same structure with other parameters."""
        return replace(self, parameters=np.asarray(parameters, dtype=float))

    def expanded(self) -> "NARXModel":
        """Return the same model in signals as measured: no origin, powers of deviations multiplied out.

        Examples
        --------
        >>> from narx_sklearn.model import NARXModel
        >>> model = NARXModel.from_equations("0.5*y[k-1] + u[k-1]^2", origin={"y": 300.0, "u": 1.0})
        >>> print(model.expanded())
        y[k] = 151 + 0.5*y[k-1] - 2*u[k-1] + u[k-1]^2
        """
        if not self.origin:
            return self
        sides = {
            output: side.translate(self.origin) + self.origin.get(output, 0.0)
            for output, side in self.equations.items()
        }
        return NARXModel.from_equations(
            sides,
            outputs=self.outputs,
            inputs=self.inputs,
            phi=self.phi,
            sampling_period=self.sampling_period,
            units=self.units,
            recorded=self.recorded,
            recorded_change=self.recorded_change,
        )

    def __eq__(self, other) -> bool:
        if not isinstance(other, NARXModel):
            return NotImplemented
        return (
            self.library == other.library
            and np.array_equal(self.parameters, other.parameters)
            and (self.outputs, self.inputs, self.phi) == (other.outputs, other.inputs, other.phi)
            and self.sampling_period == other.sampling_period
            and dict(self.units) == dict(other.units)
            and dict(self.origin) == dict(other.origin)
        )

    def __hash__(self) -> int:
        return hash((self.library.terms, self.parameters.tobytes(), self.outputs, self.inputs, self.phi))

    def __reduce__(self):
        fields = (self.library, np.array(self.parameters), self.outputs, self.inputs, self.phi)
        about = (dict(self.units), dict(self.origin), dict(self.recorded), dict(self.recorded_change))
        return NARXModel, (*fields, self.sampling_period, *about)

    def to_text(self, digits: int = 5) -> str:
        """Return equations, phi definitions and operating point as text."""
        lines = [f"{output}[k] = {side.to_text(digits)}" for output, side in self.equations.items()]
        lines += [f"  {p.name}[k] = {p.describe()}" for p in self.phi if p.name in self.library.signals]
        if self.origin:
            points = ", ".join(
                f"{signal} {'-' if value > 0 else '+'} {abs(value):.{digits}g}{self._unit_suffix(signal)}"
                for signal, value in self.origin.items()
            )
            lines.append(f"  in deviations from the operating point: {points}")
        return "\n".join(lines)

    def _unit_suffix(self, signal: str) -> str:
        return f" {self.units[signal]}" if signal in self.units else ""

    def __str__(self) -> str:
        return self.to_text()

    def __repr__(self) -> str:
        return f"<NARXModel: {self.n_terms} terms, outputs {self.outputs}, inputs {self.inputs}>"

    def latex(self, digits: int = 5) -> str:
        """Return the equations in LaTeX, one a line; names beyond ASCII stand in ``\\text`` of amsmath."""
        return " \\\\\n".join(
            f"{next(iter(TermLibrary([output + '[k]']))).latex()} = {side.latex(digits)}"
            for output, side in self.equations.items()
        )

    def to_dict(self) -> dict[str, Any]:
        """Return the model as JSON-ready values."""
        return {
            "format": FORMAT,
            "version": VERSION,
            "outputs": list(self.outputs),
            "inputs": list(self.inputs),
            "sampling_period": self.sampling_period,
            "units": dict(self.units),
            "origin": dict(self.origin),
            "recorded": {signal: list(values) for signal, values in self.recorded.items()},
            "recorded_change": dict(self.recorded_change),
            "phi": [p.to_dict() for p in self.phi],
            "equations": {
                output: {str(term): value for term, value in side.items}
                for output, side in self.equations.items()
            },
        }

    @classmethod
    def from_dict(
        cls, content: Mapping[str, Any], functions: dict[str, Callable] | None = None
    ) -> "NARXModel":
        """Return the model that `to_dict` wrote.

        Parameters
        ----------
        content : mapping
            What `to_dict` returned.
        functions : dict of {str: callable}, optional
            Functions of the user's phi regressors, by name.

        Raises
        ------
        ModelFormatError
            If the content is not a model, of a later version, or inconsistent.
        """
        if not isinstance(content, Mapping) or content.get("format") != FORMAT:
            raise ModelFormatError(f"This is not a saved model: its 'format' is not {FORMAT!r}.")
        if content.get("version") != VERSION:
            raise ModelFormatError(
                f"The model is of format version {content.get('version')!r}; this release reads version "
                f"{VERSION}. Save it again with a matching release."
            )
        missing = {"outputs", "inputs", "equations"} - content.keys()
        if missing:
            raise ModelFormatError(f"The model lacks the entries {sorted(missing)}.")
        try:
            return cls.from_equations(
                {output: Polynomial(side) for output, side in content["equations"].items()},
                outputs=content["outputs"],
                inputs=content["inputs"],
                phi=[phi_from_dict(p, functions) for p in content.get("phi", ())],
                sampling_period=content.get("sampling_period"),
                units=content.get("units", {}),
                origin=content.get("origin", {}),
                recorded=content.get("recorded", {}),
                recorded_change=content.get("recorded_change", {}),
            )
        except (ValueError, TypeError, AttributeError) as error:
            raise ModelFormatError(f"The model cannot be read: {error}") from error

    def save(self, path) -> None:
        """Write the model to ``path`` as JSON."""
        Path(path).write_text(json.dumps(self.to_dict(), indent=2) + "\n", encoding="utf-8")

    @classmethod
    def load(cls, path, functions: dict[str, Callable] | None = None) -> "NARXModel":
        """Read a model that `save` wrote; see `from_dict` for ``functions`` and errors."""
        try:
            content = json.loads(Path(path).read_text(encoding="utf-8"))
        except (json.JSONDecodeError, UnicodeDecodeError) as error:
            raise ModelFormatError(f"{path} is not JSON: {error}.") from error
        try:
            return cls.from_dict(content, functions)
        except ModelFormatError as error:
            raise ModelFormatError(f"{path}: {error}") from error


def replace_name(phi: Phi, name: str) -> Phi:
    """Return ``phi`` under another name."""
    if isinstance(phi, FunctionPhi):
        return FunctionPhi(phi.function, phi.of, name=name)
    return replace(phi, name=name)


def as_polynomial(side: "str | Polynomial | Mapping", output: str | None = None) -> Polynomial:
    """Return a right-hand side, or the equation of an output, as a polynomial, reading texts."""
    if isinstance(side, Polynomial):
        return side
    if not isinstance(side, str):
        return Polynomial(side)
    if "=" in side:
        ((named, side),) = equations_of(" ".join(side.split())).items()
        if output is not None and named != output:
            raise ValueError(
                f"The equation given for {output!r} is that of {named!r}; name one of them anew."
            )
    return Polynomial.parse(side)


def equations_of(text: str) -> dict[str, str]:
    """Return right-hand sides by output of equations as they are printed, one a line."""
    found: dict[str, str] = {}
    for line in filter(str.strip, text.strip().splitlines()):
        match = LEFT_SIDE.match(line)
        if match is None or line[0].isspace():
            raise ValueError(
                f"Cannot read {line.strip()!r} as an equation; write it like 'y[k] = 0.5*y[k-1] + u[k-1]', "
                "one a line. What print writes below the equations is passed as phi and origin; save and "
                "load keep all of a model."
            )
        if match[1] in found:
            raise ValueError(f"There are two equations of {match[1]!r}; an output has one.")
        found[match[1]] = line[match.end() :]
    return found
