"""Which candidate terms a model may have: lags, degree, clusters left out, named structures."""

import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from numbers import Integral

from narx_sklearn._validation import check_lags
from narx_sklearn.model.narx import replace_name
from narx_sklearn.model.phi import Phi
from narx_sklearn.model.terms import Term, TermLibrary, Variable, count_candidates, signal_order

__all__ = ["STRUCTURES", "cluster_text", "exclude_clusters", "named_phi", "structure_filter"]

MOST_CANDIDATES = 1_000_000  # terms of a library: beyond, its terms alone take minutes and gigabytes

Keep = Callable[[Term], bool]

Structure = Callable[[Sequence[str], Sequence[str], Sequence[Phi]], Keep]

#: Named structures: each is called with outputs, inputs and phi regressors and returns a filter of terms.
STRUCTURES: dict[str, Structure] = {}

_CLUSTER_FACTOR = re.compile(r"\s*([^\W\d]\w*)\s*(?:(?:\^|\*\*)\s*(\d+))?\s*")


def cluster_text(cluster: Iterable[tuple[str, int]]) -> str:
    """Return a term cluster (Def. 2.2) as text, ``y^2*u``; the constant's is ``1``."""
    return "*".join(f"{s}^{e}" if e > 1 else s for s, e in cluster) or "1"


def parse_cluster(text: str) -> tuple[tuple[str, int], ...]:
    """Read a term cluster such as ``y^2*u``."""
    if text.strip() == "1":
        return ()
    exponents: dict[str, int] = {}
    for part in re.split(r"(?<!\*)\*(?!\*)", text):
        match = _CLUSTER_FACTOR.fullmatch(part)
        if match is None:
            raise ValueError(f"Cannot read {text!r} as a term cluster; write it like 'y^2*u', without lags.")
        signal, exponent = match.groups()
        exponents[signal] = exponents.get(signal, 0) + int(exponent or 1)
    return tuple(sorted(exponents.items(), key=lambda item: signal_order(item[0])))


def exclude_clusters(clusters: str | Iterable[str]) -> Keep:
    """Return a filter that keeps all terms outside the given clusters.

    Parameters
    ----------
    clusters : str or iterable of str
        Texts such as ``"y^2"`` or ``"y*u"``.

    Examples
    --------
    >>> from narx_sklearn.identification import exclude_clusters
    >>> from narx_sklearn.model import TermLibrary
    >>> library = TermLibrary.polynomial(["y[k-1]", "u[k-1]"], degree=2)
    >>> print(library.filter(exclude_clusters(["y^2", "y*u"])))
    1, y[k-1], u[k-1], u[k-1]^2
    """
    excluded = {parse_cluster(c) for c in ([clusters] if isinstance(clusters, str) else clusters)}
    return lambda term: term.cluster not in excluded


def structure_filter(
    structure, exclude, outputs: Sequence[str], inputs: Sequence[str], phi: Sequence[Phi]
) -> Keep:
    """Return the filter that a regressor's ``structure`` and ``exclude`` stand for.

    Raises
    ------
    ValueError
        If the structure is not known, or ``exclude`` names a signal that is none.
    """
    signals = {*outputs, *inputs, *(str(p.name) for p in phi)}
    for cluster in [exclude] if isinstance(exclude, str) else exclude:
        unknown = sorted({signal for signal, _ in parse_cluster(cluster)} - signals)
        if unknown:
            raise ValueError(f"exclude={cluster!r} names {unknown}; the signals are {sorted(signals)}.")
    if structure is None:
        keep: Keep = lambda term: True  # noqa: E731 - a filter like the others
    elif callable(structure):
        keep = structure
    elif structure in STRUCTURES:
        keep = STRUCTURES[structure](outputs, inputs, phi)
    else:
        known = ", ".join(repr(name) for name in STRUCTURES) or "none so far"
        raise ValueError(
            f"structure={structure!r} is not known; pass None, a function of a Term, or a name ({known})."
        )
    outside = exclude_clusters(exclude)
    return lambda term: keep(term) and outside(term)


def named_phi(phi: Sequence[Phi], signals: Sequence[str]) -> tuple[Phi, ...]:
    """Return phi regressors with names, checked against the signals they are functions of.

    Raises
    ------
    TypeError, ValueError
        If it is no sequence, or one is no `Phi`, is a function of an unknown signal, the same as another,
        or has the name of something else.
    """
    if isinstance(phi, Phi | str) or not isinstance(phi, Iterable):
        raise TypeError(f"phi must be a sequence of phi regressors, such as [Difference('u')], got {phi!r}.")
    named: list[Phi] = []
    for i, one in enumerate(phi):
        if not isinstance(one, Phi):
            raise TypeError(f"phi must hold phi regressors such as Difference('u'), got {one!r}.")
        missing = one.signals - set(signals)
        if missing:
            raise ValueError(
                f"phi[{i}] is a function of {sorted(missing)}; the signals here (n_features={len(signals)}) "
                f"are {list(signals)}."
            )
        alike = [j for j, other in enumerate(named) if replace_name(other, "") == replace_name(one, "")]
        if alike:
            raise ValueError(
                f"phi[{i}] is phi[{alike[0]}] again, {one.describe()}; no record tells the two apart. Leave "
                "one out."
            )
        named.append(one if one.name is not None else replace_name(one, f"phi{i + 1}"))
    names = [*signals, *(str(p.name) for p in named)]
    repeated = sorted({name for name in names if names.count(name) > 1})
    if repeated:
        raise ValueError(
            f"The name {repeated[0]!r} is given twice, to signals or phi regressors; rename one."
        )
    return tuple(named)


def candidate_library(
    outputs: Sequence[str],
    inputs: Sequence[str],
    phi: Sequence[Phi],
    *,
    output_lags,
    input_lags,
    phi_lags,
    delay,
    degree: int,
    include_constant: bool,
    keep: Keep,
    lags_name: str = "input_lags",
) -> TermLibrary:
    """Return the candidate terms that lags, degree and structure allow.

    Lags are an integer, a list, or a mapping or list with one of these for each signal. ``lags_name`` is
    what the caller's user knows ``input_lags`` by.

    Raises
    ------
    ValueError, TypeError
        If lags or degree are out of range, or no term is left.
    """
    if not isinstance(degree, Integral) or isinstance(degree, bool) or degree < 1:
        raise ValueError(f"degree must be an integer of at least 1, got {degree!r}.")
    shortest = _per_signal(delay, inputs, "delay")
    for signal, value in shortest.items():
        if not isinstance(value, Integral) or isinstance(value, bool) or value < 0:
            raise ValueError(f"delay must be a non-negative integer, got {value!r} for {signal}.")
    variables: list[Variable] = []
    for signal, lags in _per_signal(output_lags, outputs, "output_lags").items():
        variables += [Variable(signal, lag) for lag in check_lags(lags, "output_lags", smallest=1)]
    for signal, lags in _per_signal(input_lags, inputs, lags_name).items():
        variables += [Variable(signal, lag) for lag in _input_lags(lags, lags_name, shortest[signal])]
    names = [str(p.name) for p in phi]
    for (name, lags), one in zip(_per_signal(phi_lags, names, "phi_lags").items(), phi, strict=True):
        of_output = bool(one.signals & set(outputs))
        first = 1 if of_output else min((shortest[s] for s in one.signals), default=1)
        chosen = (
            check_lags(lags, "phi_lags", smallest=1) if of_output else _input_lags(lags, "phi_lags", first)
        )
        variables += [Variable(name, lag) for lag in chosen]
    count = count_candidates(len(variables), int(degree))
    if count > MOST_CANDIDATES:
        raise ValueError(
            f"degree={degree} with {len(variables)} lagged variables makes {count:,} candidate terms; at "
            f"most {MOST_CANDIDATES:,} can be searched. Lower degree, output_lags or {lags_name}."
        )
    library = TermLibrary.polynomial(variables, int(degree), include_constant=include_constant).filter(keep)
    if not len(library):
        raise ValueError(
            "No candidate term is left: give output_lags, input_lags or phi, or loosen structure and exclude."
        )
    return library


def _input_lags(lags, name: str, delay: int) -> tuple[int, ...]:
    """An integer n means delay to n; explicit lists may hold any lag from 0."""
    if isinstance(lags, Integral) and not isinstance(lags, bool):
        return check_lags(lags, name, smallest=int(delay))
    return check_lags(lags, name, smallest=0)


def _per_signal(value, signals: Sequence[str], name: str) -> dict:
    """Spread a value over signals; a mapping or a list of lists gives one each."""
    if isinstance(value, Mapping):
        unknown = set(value) - set(signals)
        if unknown:
            raise ValueError(f"{name} names {sorted(unknown)}; the signals here are {list(signals)}.")
        return {signal: value.get(signal, ()) for signal in signals}
    nested = isinstance(value, Sequence) and not isinstance(value, str)
    if nested and any(isinstance(item, Sequence) for item in value):
        if len(value) != len(signals):
            raise ValueError(
                f"{name} has {len(value)} entries for the {len(signals)} signals {list(signals)}."
            )
        return dict(zip(signals, value, strict=True))
    return dict.fromkeys(signals, value)
