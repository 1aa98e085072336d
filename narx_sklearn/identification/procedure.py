"""The steps of an identification, from measured arrays to a model: scale, compress, select, estimate.

`NARXRegressor` and `NARXRegressorCV` are state round these functions.
"""

import warnings
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import pairwise
from typing import Any

import numpy as np

from narx_sklearn._threads import single_threaded_blas
from narx_sklearn._validation import check_magnitude
from narx_sklearn.exceptions import ExcitationWarning
from narx_sklearn.identification.constraints import LinearConstraints
from narx_sklearn.identification.criteria import information_criterion
from narx_sklearn.identification.estimation import least_squares
from narx_sklearn.identification.factor import Checkpoint, Factor, compress
from narx_sklearn.identification.record import CHUNK_ROWS, Block, Record
from narx_sklearn.identification.regressors import Candidates, reach_of, remembers_all
from narx_sklearn.identification.screening import screen_terms
from narx_sklearn.identification.selection import SelectionPath, search_terms
from narx_sklearn.identification.uncertainty import OneStepScores, n_stretches
from narx_sklearn.model.narx import NARXModel
from narx_sklearn.model.polynomials import Polynomial
from narx_sklearn.model.recording import Layout, lay_out
from narx_sklearn.model.terms import Term, TermLibrary

# Above this many candidates the per-term pass screens them first, and the factor holds the survivors.
SCREENING_CANDIDATES = 500
FORWARD_CANDIDATES = 120  # the same for a forward search, to which nothing is lost by it
FEWEST_USABLE = 3  # samples with all lagged values; a criterion takes the logarithm of their logarithm
SCREENED_PER_TERM = 4  # candidates kept by screening for each term that may be selected


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


def on_screened(
    constraints: LinearConstraints, full: TermLibrary, kept: TermLibrary
) -> LinearConstraints | None:
    """Return constraints on all candidates as constraints on those that screening kept (all they name)."""
    if not len(constraints):
        return None
    return LinearConstraints(constraints.S[:, [full.index(term) for term in kept]], constraints.c)


def with_origin(layout: Layout, origin: Mapping[str, float]) -> Layout:
    """Return the layout with the origins given, zero elsewhere."""
    return layout._replace(
        origin=np.array([float(origin.get(name, 0.0)) for name in layout.channels], dtype=float)
    )


def compress_record(
    library: TermLibrary,
    layout: Layout,
    record: Record,
    *,
    max_terms: int,
    constraints: Sequence[LinearConstraints] = (),
    search: str = "exchange",
    screen: bool = True,
    checkpoint=None,
) -> Compressed:
    """Compress a record; large libraries are screened first.

    A forward search wants the first terms of the ERR order only, which the passes over the data give at
    less cost than the factor of all candidates, and exactly. The other searches are left several times as
    many candidates as they may select.

    Parameters
    ----------
    library : TermLibrary
        Candidate terms.
    layout : Layout
        Channels with origin and scale.
    record : Record
        The record.
    max_terms : int
        Largest number of terms that will be selected.
    constraints : sequence of LinearConstraints, default=()
        Constraints of each output, on parameters in measured units; their terms stay candidates.
    search : str, default="exchange"
        The search that will follow.
    screen : bool, default=True
        Whether candidates may be left out.
    checkpoint : path-like, default=None
        Folder of the factors that an interrupted pass left.

    Returns
    -------
    Compressed

    Raises
    ------
    ValueError
        If fewer than three samples have all lagged values.
    """
    full = len(library)
    forward = search == "forward" and not any(len(c) for c in constraints)
    if screen and len(library) > (FORWARD_CANDIDATES if forward else SCREENING_CANDIDATES):
        n_terms = max_terms if forward else SCREENED_PER_TERM * max_terms
        if record.in_memory:
            library = screened_library(library, layout, record, n_terms, constraints)
        else:
            factor = total_factor(library, layout, record, checkpoint)
            check_enough(factor.n_samples, library, layout, record.n_samples)
            library = screened_on_factor(library, layout, factor, n_terms, constraints)
    factor = total_factor(library, layout, record, checkpoint)
    check_enough(factor.n_samples, library, layout, record.n_samples)
    return Compressed(library, layout, factor, full)


def total_factor(library: TermLibrary, layout: Layout, record: Record, checkpoint=None) -> Factor:
    """Return the factor of a record: its blocks compressed where they are, and merged."""
    kept = None
    if checkpoint is not None:
        settings = {
            "outputs": layout.outputs,
            "inputs": layout.inputs,
            "phi": [str(p.to_dict()) for p in layout.phi],  # functions by name: their own text is an address
            "terms": library.names,
            "origin": layout.origin.tolist(),
            "scale": layout.scale.tolist(),
            "record": record.description(),
        }
        # one stage for each origin and each screening that a fit works at; of two origins the second
        # moves fewer signals
        moved = np.count_nonzero(layout.origin)
        kept = Checkpoint(checkpoint, f"{moved}-moved-{len(library)}-terms", settings)
    return record.total(
        partial(factor_of_block, library, layout),
        Factor.merge,
        reach=reach_of(library, layout),
        whole=remembers_all(layout),
        checkpoint=kept,
    )


def factor_of_block(library: TermLibrary, layout: Layout, block: Block) -> Factor:
    """Compress one block of a record."""
    with single_threaded_blas():
        return compress([Candidates.in_block(library, layout, block)])


def check_enough(n_usable: int, library: TermLibrary, layout: Layout, n_samples: int) -> None:
    """Raise a ValueError where fewer samples of a record have all lagged values than identify anything."""
    if n_usable < FEWEST_USABLE:
        longest = reach_of(library, layout)
        usable = f"only {n_usable}" if n_usable else "none"
        raise ValueError(
            f"Of n_samples = {n_samples} {usable} can be used: the longest lag is {longest}, so at least "
            f"{longest + FEWEST_USABLE} samples in a row, within one session and without a gap, are needed. "
            "Pass a longer record, or fewer lags."
        )


def screened_library(
    library: TermLibrary,
    layout: Layout,
    record: Record,
    n_terms: int,
    constraints: Sequence[LinearConstraints] = (),
) -> TermLibrary:
    """Return the candidates that forward ERR passes over the data put first, for all outputs."""
    candidates = Candidates.of(library, layout, lay_out(layout, *record.everything()))
    check_enough(candidates.n_rows, library, layout, record.n_samples)
    kept: set[int] = set()
    for output in range(len(layout.outputs)):
        scaled = None
        if constraints and len(constraints[output]):
            scaled = constraints[output].scaled(parameter_scales(layout, library, output))
            kept |= {int(j) for j in scaled.terms}
        kept |= set(screen_terms(candidates, n_terms, output=output, constraints=scaled).order)
    return library.subset(sorted(kept))


def screened_on_factor(
    library: TermLibrary,
    layout: Layout,
    factor: Factor,
    n_terms: int,
    constraints: Sequence[LinearConstraints] = (),
) -> TermLibrary:
    """Return what `screened_library` returns, for a record that is compressed already."""
    kept: set[int] = set()
    for output in range(len(layout.outputs)):
        rest, left = np.arange(len(library)), factor
        if constraints and len(constraints[output]):
            scaled = constraints[output].scaled(parameter_scales(layout, library, output))
            kept |= {int(j) for j in scaled.terms}
            rest, left = _without_named(factor, scaled, output)
        path = search_terms(left, n_terms, search="forward", output=output)
        kept |= {int(rest[j]) for j in path.supports[-1]}
    return library.subset(sorted(kept))


def _without_named(factor: Factor, constraints: LinearConstraints, output: int) -> tuple[np.ndarray, Factor]:
    """Return the columns that constraints do not name, and their factor with the named ones projected out."""
    named = list(constraints.terms)
    fixed, free = constraints.restrict(named).solution_space()
    rest = np.setdiff1d(np.arange(factor.n_terms), named)
    n_free, width = free.shape[1], factor.R.shape[1]
    # columns of T: the directions that the constraints leave free, the other terms, the outputs
    T = np.zeros((width, n_free + rest.size + factor.n_outputs))
    T[named, :n_free] = free
    T[rest, n_free + np.arange(rest.size)] = 1.0
    T[factor.n_terms + np.arange(factor.n_outputs), n_free + rest.size + np.arange(factor.n_outputs)] = 1.0
    T[named, n_free + rest.size + output] = -fixed
    # the rows of a triangular factor below its first columns are orthogonal to those columns
    R = factor.combine(T).R[n_free:, n_free:]
    return rest, Factor(R, factor.n_outputs, factor.n_samples)


def stretch_factors(
    library: TermLibrary, layout: Layout, record: Record, *, shortest: float | None = None
) -> list[Factor]:
    """Return the factors of a few long stretches of the record, equal in usable samples.

    With ``shortest`` given there are fewer where they would be shorter than that, one at least.
    """
    reach, whole = reach_of(library, layout), remembers_all(layout)
    found = record.map(partial(usable_in_block, library, layout), reach=reach, whole=whole)
    usable = np.array([n for _, n in found], dtype=int)
    n_samples = int(usable.sum())
    count = n_stretches(n_samples)
    if shortest is not None:
        count = max(min(count, int(n_samples / shortest)), 1)
    # stretch w holds the usable samples i with i * count // n_samples == w
    edges = [-(-w * n_samples // count) for w in range(count + 1)]
    done = {first: int(d) for (first, _), d in zip(found, np.cumsum(usable) - usable, strict=True)}
    parts = record.total(
        partial(stretches_of_block, library, layout, edges, done), merge_parts, reach=reach, whole=whole
    )
    empty = Factor.empty(len(library), len(layout.outputs))
    return [parts.get(w, empty) for w in range(count)]


def usable_in_block(library: TermLibrary, layout: Layout, block: Block) -> tuple[int, int]:
    """Return where a block begins and how many of its samples have all lagged values."""
    return block.first, Candidates.in_block(library, layout, block).n_rows


def stretches_of_block(
    library: TermLibrary, layout: Layout, edges: list[int], done: dict[int, int], block: Block
) -> dict[int, Factor]:
    """Return the factors of the parts of stretches that lie in a block."""
    candidates = Candidates.in_block(library, layout, block)
    begin = done[block.first]
    found = {}
    with single_threaded_blas():
        for w, (a, b) in enumerate(pairwise(edges)):
            rows = candidates.rows[max(a - begin, 0) : max(b - begin, 0)]
            if rows.size:
                found[w] = compress([replace(candidates, rows=rows)])
    return found


def merge_parts(one: dict[Any, Factor], other: dict[Any, Factor]) -> dict[Any, Factor]:
    """Return the factors of both, those of the same part merged."""
    return one | other | {key: one[key].merge(other[key]) for key in one.keys() & other.keys()}


def scores_on_factors(
    factors: Sequence[Factor], theta: np.ndarray, output: int, n_samples: int
) -> OneStepScores:
    """Return what `one_step_scores` sums over stretches, from the stretches' factors.

    A factor has the inner products of its samples: Psi'Psi = R'R, and Psi'xi = R'(r - R theta) with r the
    output's column. ``n_samples`` is how many samples they stand for together.
    """
    left = [f.target(output) - f.Psi @ theta for f in factors]
    power = sum(float(r @ r) for r in left)
    return OneStepScores(
        np.array([f.Psi.T @ f.Psi for f in factors]),
        np.array([f.Psi.T @ r for f, r in zip(factors, left, strict=True)]),
        float(np.sqrt(power / max(n_samples - theta.size, 1))),
    )


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


def on_library(
    constraints: LinearConstraints | None, full: TermLibrary, part: TermLibrary
) -> LinearConstraints | None:
    """Return constraints on ``full`` as constraints on the terms of ``part``."""
    if constraints is None or not len(constraints):
        return None
    return constraints.restrict([full.index(term) for term in part])


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
