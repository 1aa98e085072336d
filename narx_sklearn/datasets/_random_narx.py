"""Random polynomial NARX systems, known exactly and bounded by construction."""

import warnings
from numbers import Integral

import numpy as np
import pandas as pd
from scipy.signal import lfilter
from sklearn.utils import check_random_state

from narx_sklearn._validation import check_choice
from narx_sklearn.datasets._plant import check_input, check_numbers
from narx_sklearn.datasets._results import PlantTruth, SyntheticPlant
from narx_sklearn.exceptions import DivergenceWarning
from narx_sklearn.model.narx import NARXModel
from narx_sklearn.model.polynomials import Polynomial
from narx_sklearn.model.simulation import free_run
from narx_sklearn.model.terms import Term, TermLibrary, count_candidates

__all__ = ["make_narx"]

FAR_OUTSIDE = 1e6  # of the unit box: from there no system comes back
NOISE_KINDS = ("equation", "output")
SMALLEST_WEIGHT = 0.5  # of a term's share, relative to the largest: no term is a bystander


def make_narx(
    n_samples: int = 1000,
    *,
    n_terms: int = 6,
    output_lags: int = 2,
    input_lags: int = 2,
    degree: int = 2,
    n_inputs: int = 1,
    delay: int = 1,
    memory: float = 0.8,
    u=None,
    noise: float = 0.0,
    noise_kind: str = "equation",
    noise_pole: float = 0.0,
    random_state=None,
) -> SyntheticPlant:
    r"""Make a random polynomial NARX system that no input within [-1, 1] can drive out of [-1, 1].

    Terms are drawn from all products up to `degree`, a linear one of the output and of each input always
    among them. With :math:`d_t` the number of output factors of term `t`, its parameters obey

    .. math:: \sum_t d_t |\theta_t| = \mathrm{memory} < 1, \qquad \sum_t |\theta_t| = 1,

    so that the right-hand side maps the box onto itself, and contracts: initial conditions are forgotten at
    least as fast as `memory` to the power ``k / output_lags``.

    Parameters
    ----------
    n_samples : int, default=1000
        Number of samples; not used where `u` is given.
    n_terms : int, default=6
        Number of terms.
    output_lags, input_lags : int, default=2
        Longest lags, in samples.
    degree : int, default=2
        Highest degree of a term.
    n_inputs : int, default=1
        Number of inputs.
    delay : int, default=1
        Smallest lag of the inputs; 0 lets the current input act.
    memory : float, default=0.8
        Share of the past outputs, above 0 and below 1.
    u : array-like of shape (n_samples, n_inputs), default=None
        Inputs; None for white ones, uniform in [-1, 1]. Beyond [-1, 1] nothing is promised.
    noise : float, default=0.0
        Standard deviation of the noise, relative to that of the noise-free output.
    noise_kind : {"equation", "output"}, default="equation"
        Whether noise enters the recursion, or is added to what is measured.
    noise_pole : float, default=0.0
        Pole of the noise, ``e[k] = noise_pole e[k-1] + white``; 0 for white noise.
    random_state : int, RandomState or None, default=None
        Seed of structure, parameters, input and noise.

    Returns
    -------
    SyntheticPlant
        ``truth.parameters`` maps terms to their parameters, and ``truth.equation`` can be handed to
        `NARXModel.from_equations`; ``truth.y`` is the noise-free output, ``truth.states["e"]`` the noise.
        The record starts from rest.

    Raises
    ------
    ValueError
        If a number is out of its range, there are fewer candidates than `n_terms`, `u` has a wrong shape,
        or noise drives the system out of the finite range.

    Examples
    --------
    >>> from narx_sklearn import NARXRegressor
    >>> from narx_sklearn.datasets import make_narx
    >>> plant = make_narx(400, n_terms=4, random_state=1)
    >>> found = NARXRegressor(2, 2, refine=False).fit(plant.X, plant.y)
    >>> sorted(found.terms_) == sorted(plant.truth.parameters)
    True
    >>> round(sum(abs(value) for value in plant.truth.parameters.values()), 6)
    1.0
    """
    check_choice(noise_kind, "noise_kind", NOISE_KINDS)
    check_numbers({"memory": memory}, {"noise": noise})
    if not memory < 1.0 or not abs(noise_pole) < 1.0:
        raise ValueError(
            f"memory={memory!r} and noise_pole={noise_pole!r} must lie below 1 (noise_pole above -1): from "
            "there on the past is never forgotten."
        )
    _check_lags(output_lags, input_lags, degree, n_inputs, delay)
    given = check_input(u, n_samples, n_inputs)
    rng = check_random_state(random_state)
    inputs = ("u",) if n_inputs == 1 else tuple(f"u{i + 1}" for i in range(n_inputs))
    terms = _draw_terms(inputs, n_terms, output_lags, input_lags, degree, delay, rng)
    equation = Polynomial(zip(terms, _draw_parameters(terms, memory, rng), strict=True))
    X = rng.uniform(-1.0, 1.0, (n_samples, n_inputs)) if given is None else given

    rest = np.zeros(max(output_lags, input_lags))
    clean = free_run(NARXModel.from_equations({"y": equation}, inputs=inputs), X, rest).y[:, 0]
    white = rng.standard_normal(len(X)) * np.sqrt(1.0 - noise_pole**2)
    e = noise * clean.std() * lfilter([1.0], [1.0, -noise_pole], white)
    y = clean + e
    if noise_kind == "equation":
        driven = NARXModel.from_equations({"y": equation + Polynomial.parse("e[k]")}, inputs=(*inputs, "e"))
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", DivergenceWarning)  # what it says is the error below
            y = free_run(driven, np.column_stack([X, e]), rest, bound=FAR_OUTSIDE).y[:, 0]
    if not np.isfinite(y).all():
        raise ValueError(
            f"noise={noise!r} drove the system out of the finite range. Take less noise or less memory."
        )
    truth = PlantTruth(
        equation=equation.to_text(17),
        parameters={str(term): float(value) for term, value in equation.items},
        y=pd.Series(clean, name="y"),
        states=pd.DataFrame({"e": e}),
    )
    return SyntheticPlant(
        name="narx",
        X=pd.DataFrame(X, columns=list(inputs)),
        y=pd.Series(y, name="y"),
        sampling_period=1.0,
        truth=truth,
        DESCR=f"A random polynomial NARX system of {n_terms} terms, known exactly: {equation}.",
    )


def _check_lags(output_lags, input_lags, degree, n_inputs, delay) -> None:
    numbers = {"output_lags": output_lags, "degree": degree, "n_inputs": n_inputs}
    for name, value in numbers.items():
        if not isinstance(value, Integral) or value < 1:
            raise ValueError(f"{name} is {value!r}, but must be an integer of at least 1.")
    for name, value, least in (("delay", delay, 0), ("input_lags", input_lags, delay)):
        if not isinstance(value, Integral) or value < least:
            raise ValueError(f"{name} is {value!r}, but must be an integer of at least {least}.")


def _draw_terms(inputs, n_terms, output_lags, input_lags, degree, delay, rng) -> list[Term]:
    """Draw distinct terms: a linear one of the output and of each input, the others from all candidates."""
    past = [f"y[k-{lag}]" for lag in range(1, output_lags + 1)]
    driven = [[_variable(name, lag) for lag in range(delay, input_lags + 1)] for name in inputs]
    n_variables = len(past) + sum(len(lags) for lags in driven)
    available = count_candidates(n_variables, degree) - 1
    if not isinstance(n_terms, int | np.integer) or not len(inputs) + 1 <= n_terms <= available:
        raise ValueError(
            f"n_terms is {n_terms!r}, but must be an integer from {len(inputs) + 1} (one linear term of each "
            f"signal) to {available}, the number of candidates. Longer lags or a higher degree give more."
        )
    chosen = [Term.parse(group[rng.randint(len(group))]) for group in (past, *driven)]
    variables = past + [variable for group in driven for variable in group]
    others = [
        term
        for term in TermLibrary.polynomial(variables, degree, include_constant=False)
        if term not in chosen
    ]
    more = rng.choice(len(others), n_terms - len(chosen), replace=False)
    return [*chosen, *(others[i] for i in more)]


def _variable(signal: str, lag: int) -> str:
    return f"{signal}[k-{lag}]" if lag else f"{signal}[k]"


def _draw_parameters(terms: list[Term], memory: float, rng) -> np.ndarray:
    """Draw parameters of either sign; outputs share `memory`, inputs alone take what is left of one."""
    weights = rng.uniform(SMALLEST_WEIGHT, 1.0, len(terms))
    factors = np.array([sum(v.signal == "y" for v in term.expanded) for term in terms])
    size = np.where(factors > 0, memory * weights / (weights @ factors), 0.0)
    alone = factors == 0
    size[alone] = (1.0 - size.sum()) * weights[alone] / weights[alone].sum()
    return size * rng.choice([-1.0, 1.0], len(terms))
