"""A record compressed: its factor, of all candidates or of those that screening leaves."""

from collections.abc import Sequence
from functools import partial

import numpy as np

from narx_sklearn._threads import single_threaded_blas
from narx_sklearn.identification.one_step.factor import Checkpoint, Factor, compress
from narx_sklearn.identification.one_step.procedure import Compressed, parameter_scales
from narx_sklearn.identification.one_step.regressors import Candidates, reach_of, remembers_all
from narx_sklearn.identification.one_step.screening import screen_terms
from narx_sklearn.identification.one_step.selection import search_terms
from narx_sklearn.identification.records.record import Block, Record
from narx_sklearn.identification.structure.constraints import LinearConstraints
from narx_sklearn.model.recording import Layout, lay_out
from narx_sklearn.model.terms import TermLibrary

# Above this many candidates the per-term pass screens them first, and the factor holds the survivors.
SCREENING_CANDIDATES = 500
FORWARD_CANDIDATES = 120  # the same for a forward search, to which nothing is lost by it
FEWEST_USABLE = 3  # samples with all lagged values; a criterion takes the logarithm of their logarithm
SCREENED_PER_TERM = 4  # candidates kept by screening for each term that may be selected


def compress_record(
    library: TermLibrary,
    layout: Layout,
    record: Record,
    *,
    max_terms: int,
    constraints: Sequence[LinearConstraints] = (),
    search: str = "exchange",
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
    if len(library) > (FORWARD_CANDIDATES if forward else SCREENING_CANDIDATES):
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
