"""The steps of an identification, from a record to a model: scale, compress, select, estimate.

`NARXRegressor` and `NARXRegressorCV` are state round these functions. ``compression`` makes the factor.
"""

import warnings
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from narx_sklearn._validation import check_magnitude
from narx_sklearn.exceptions import ExcitationWarning
from narx_sklearn.identification.one_step.criteria import information_criterion
from narx_sklearn.identification.one_step.estimation import least_squares
from narx_sklearn.identification.one_step.factor import Factor
from narx_sklearn.identification.one_step.selection import SelectionPath, search_terms
from narx_sklearn.identification.records.record import CHUNK_ROWS, Record
from narx_sklearn.identification.structure.constraints import LinearConstraints
from narx_sklearn.model.narx import NARXModel
from narx_sklearn.model.polynomials import Polynomial
from narx_sklearn.model.recording import Layout, lay_out
from narx_sklearn.model.terms import Term, TermLibrary


@dataclass(frozen=True)
class Problem:
    """What is to be identified: signals and candidate terms.

    Attributes
    ----------
    outputs, inputs : tuple of str
        Signal names.
    phi : tuple of Phi
        Named phi regressors.
    library : TermLibrary
        Candidate terms.
    """

    outputs: tuple[str, ...]
    inputs: tuple[str, ...]
    phi: tuple
    library: TermLibrary


@dataclass(frozen=True)
class Compressed:
    """Candidates and their compressed record, in shifted and scaled signals.

    Attributes
    ----------
    library : TermLibrary
        Candidate terms, the columns of the factor.
    layout : Layout
        Channels with the origin and scale of each signal.
    factor : Factor
        The compressed record.
    n_considered : int
        Number of candidate terms before screening.
    """

    library: TermLibrary
    layout: Layout
    factor: Factor
    n_considered: int

    @property
    def origin(self) -> dict[str, float]:
        """Origin of each output and input, where it is not zero."""
        pairs = zip(self.layout.channels, self.layout.origin, strict=True)
        return {name: float(value) for name, value in pairs if value != 0.0}

    def moved(self, origin: Mapping[str, float]) -> "Compressed | None":
        """Return the same record with other origins, None if the candidates do not allow it.

        A polynomial in shifted signals is a polynomial in the signals: moving the origin combines
        columns, as long as the library holds all lower powers.
        """
        layout = with_origin(self.layout, origin)
        steps = (layout.origin - self.layout.origin) / self.layout.scale
        T = translation(self.library, layout.outputs, dict(zip(layout.channels, steps, strict=True)))
        if T is None:
            return None
        return replace(self, layout=layout, factor=self.factor.combine(T))


def parameter_scales(layout: Layout, library: TermLibrary, output: int) -> np.ndarray:
    """Return what turns parameters of scaled signals into those of measured units."""
    scale = dict(zip(layout.channels, layout.scale, strict=True))
    return np.array(
        [layout.scale[output] / np.prod([scale[v.signal] for v in term.expanded]) for term in library]
    )


def translation(
    library: TermLibrary, outputs: tuple[str, ...], shift: Mapping[str, float]
) -> np.ndarray | None:
    """Return T with [Psi, Y] T the columns of the terms in s - shift; None if one is not in the library."""
    n_terms, n_outputs = len(library), len(outputs)
    T = np.zeros((n_terms + n_outputs, n_terms + n_outputs))
    for column, term in enumerate(library):
        for part, value in Polynomial({term: 1.0}).translate(shift).items:
            if part not in library:
                return None
            T[library.index(part), column] = value
    for i, output in enumerate(outputs):
        T[n_terms + i, n_terms + i] = 1.0
        if shift.get(output, 0.0) != 0.0:
            if Term() not in library:
                return None
            T[library.index(Term()), n_terms + i] = -shift[output]
    return T


def scaled_layout(problem: Problem, record: Record) -> Layout:
    """Return the layout with every output and input shifted to its mean, every channel scaled to one.

    Raises
    ------
    ValueError
        If values of a signal are too small or too large to square.

    Warns
    -----
    ExcitationWarning
        If a signal is constant.
    """
    mean, spread = record.moments.mean, record.moments.deviation
    names = problem.outputs + problem.inputs
    for name, known, low, high in zip(
        names, record.moments.known, record.moments.low, record.moments.high, strict=True
    ):
        check_magnitude(max(abs(low), abs(high)) if known else 0.0, name)
    noise = 1e-13 * np.maximum(np.abs(mean), np.finfo(float).tiny)  # rounding of a constant's mean
    for name, value, level in zip(names, spread, noise, strict=True):
        if not value > level:
            warnings.warn(
                f"{name} is constant in this record, so nothing that depends on its variation can be "
                "identified; excite it, or leave its lags out.",
                ExcitationWarning,
                stacklevel=5,
            )
    scale = np.where(spread > noise, spread, np.where(np.abs(mean) > 0, np.abs(mean), 1.0))
    by_name = dict(zip(names, scale, strict=True))
    at = dict(zip(names, mean, strict=True))
    if problem.phi:
        head = slice(0, min(CHUNK_ROWS, record.n_samples))
        plain = Layout.of(problem.outputs, problem.inputs, problem.phi)
        columns = lay_out(plain, *record.take([head])).data[:, len(names) :]
        known = np.isfinite(columns)
        total = np.where(known, columns**2, 0.0).sum(axis=0)
        rms = np.sqrt(total / np.maximum(known.sum(axis=0), 1))
        by_name |= {str(p.name): (r if r > 0 else 1.0) for p, r in zip(problem.phi, rms, strict=True)}
    return Layout.of(problem.outputs, problem.inputs, problem.phi, at, by_name)


def origin_choices(
    origin, problem: Problem, layout: Layout, record: Record, constraints, structure, intercept
) -> list[dict[str, float]]:
    """Return the origins worth trying, as mappings from signals; the one compressed first stands first.

    "auto" tries the mean, and zero for the signals that come within their standard deviation of zero in
    this record: for the others, as a temperature in kelvin, zero is not an operating point. Constraints and
    structures speak of the signals as they are, and without a constant term an origin cannot be told
    apart from one; there "auto" is zero.

    Parameters
    ----------
    origin : {"auto", "zero", "mean"} or mapping
        The regressor's parameter.
    problem : Problem
        Signals and candidates.
    layout : Layout
        Layout with every output and input at its mean.
    record : Record
        The record.
    constraints, structure, intercept
        The regressor's constraints of each output, structure, and whether it fits a constant.
    """
    names = problem.outputs + problem.inputs
    if not isinstance(origin, str):
        unknown = set(origin) - set(names)
        if unknown:
            raise ValueError(f"origin names {sorted(unknown)}, which are neither outputs nor inputs.")
        return [{name: float(value) for name, value in origin.items()}]
    mean = {n: v for n, v in zip(layout.channels, layout.origin, strict=True) if n in names}
    bound = any(len(c) for c in constraints) or structure is not None or not intercept
    if origin == "mean":
        return [mean]
    if origin == "zero" or bound:
        return [{}]
    away = {}
    for i, name in enumerate(names):
        deviation = layout.scale[i]
        if record.moments.low[i] > deviation or record.moments.high[i] < -deviation:
            away[name] = mean[name]
    return [mean] if away.keys() == mean.keys() else [mean, away]


def compress_choices(
    problem: Problem,
    layout: Layout,
    origins: list[dict[str, float]],
    compress_at: Callable[[Layout], Compressed],
) -> list[Compressed]:
    """Compress a record at each origin; a second one costs no second pass where columns combine.

    Parameters
    ----------
    problem : Problem
        Signals and candidates.
    layout : Layout
        Any layout of the signals.
    origins : list of dict
        What `origin_choices` returned.
    compress_at : callable
        Takes a layout, returns the `Compressed` record.
    """
    found: list[Compressed] = []
    for origin in origins:
        moved = found[0].moved(origin) if found and found[0].library == problem.library else None
        found.append(moved if moved is not None else compress_at(with_origin(layout, origin)))
    return found


def total_criterion(selected: "list[Selected]", criterion: str) -> float:
    """Return the criterion of all outputs; an origin away from zero is estimated too and pays for it."""
    price_as = "bic" if criterion == "ebic" else criterion  # an origin is not chosen among candidates
    total = 0.0
    for one in selected:
        used = {s for term in one.library for s in term.signals} & one.compressed.origin.keys()
        n, k = one.path.n_samples, len(one.support)
        with_origin = information_criterion(price_as, n, n, k + len(used))
        total += one.criterion + float(with_origin - information_criterion(price_as, n, n, k))
    return total


def with_origin(layout: Layout, origin: Mapping[str, float]) -> Layout:
    """Return the layout with the origins given, zero elsewhere."""
    return layout._replace(
        origin=np.array([float(origin.get(name, 0.0)) for name in layout.channels], dtype=float)
    )


def merge_parts(one: dict[Any, Factor], other: dict[Any, Factor]) -> dict[Any, Factor]:
    """Return the factors of both, those of the same part merged."""
    return one | other | {key: one[key].merge(other[key]) for key in one.keys() & other.keys()}


@dataclass(frozen=True)
class Selected:
    """Terms chosen for one output, with their least-squares parameters in scaled signals."""

    compressed: Compressed
    path: SelectionPath
    support: tuple[int, ...]
    theta: np.ndarray
    rss: float
    criterion: float

    @property
    def library(self) -> TermLibrary:
        """The chosen terms."""
        return self.compressed.library.subset(self.support)


def select_terms(
    compressed: Compressed,
    output: int,
    *,
    search: str,
    criterion: str,
    n_terms: int | None,
    max_terms: int,
    constraints: LinearConstraints | None,
    alpha: float = 0.0,
) -> Selected:
    """Search, choose a size, estimate: everything on the factor."""
    scaled = scaled_constraints(compressed, output, constraints)
    longest = max(max_terms, n_terms or 0)  # looking past the size wanted improves what is found there
    path = search_terms(compressed.factor, longest, search=search, output=output, constraints=scaled)
    path = replace(path, n_considered=compressed.n_considered)
    size = min(n_terms, len(path.supports) - 1) if n_terms is not None else path.best_size(criterion)
    if not np.isfinite(path.rss[size]):
        possible = np.flatnonzero(np.isfinite(path.rss)).tolist()
        raise ValueError(
            f"n_terms={n_terms}, but no set of {size} terms satisfies the constraints; the smallest have "
            f"{', '.join(map(str, possible[:3]))} terms. Pass one of these, or fewer constraints."
        )
    return estimate_terms(compressed, output, path, size, criterion, constraints, alpha)


def estimate_terms(
    compressed: Compressed,
    output: int,
    path: SelectionPath,
    size: int,
    criterion: str,
    constraints: LinearConstraints | None,
    alpha: float = 0.0,
) -> Selected:
    """Estimate the set of ``size`` terms of a path."""
    support = tuple(sorted(path.supports[size]))
    scaled = scaled_constraints(compressed, output, constraints)
    inside = None if scaled is None else scaled.restrict(support)
    theta, rss = least_squares(
        compressed.factor.subset(support),
        output=output,
        constraints=inside,
        alpha=alpha * compressed.factor.n_samples,
    )
    return Selected(compressed, path, support, theta, rss, float(path.criterion(criterion)[size]))


def scaled_constraints(
    compressed: Compressed, output: int, constraints: LinearConstraints | None
) -> LinearConstraints | None:
    """Return constraints on measured-unit parameters as constraints on those of scaled signals."""
    if constraints is None or not len(constraints):
        return None
    return constraints.scaled(parameter_scales(compressed.layout, compressed.library, output))


def build_model(selected: list[Selected], problem: Problem, **fields: Any) -> NARXModel:
    """Return the model of the chosen terms in measured units."""
    compressed = selected[0].compressed
    sides = {}
    for i, (output, one) in enumerate(zip(problem.outputs, selected, strict=True)):
        scales = parameter_scales(compressed.layout, one.library, i)
        sides[output] = Polynomial(zip(one.library, one.theta * scales, strict=True))
    return NARXModel.from_equations(
        sides,
        outputs=problem.outputs,
        inputs=problem.inputs,
        phi=problem.phi,
        origin=compressed.origin,
        **fields,
    )
