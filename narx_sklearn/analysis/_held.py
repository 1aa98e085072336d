"""A model with everything but its outputs held: where it can rest, and what its Jacobian says there.

Fixed points, static curves and quasi-static sets all ask this question; they differ only in the values at
which inputs and phi regressors are held.
"""

from collections.abc import Callable
from itertools import product
from typing import NamedTuple

import numpy as np
from scipy.optimize import linear_sum_assignment

from narx_sklearn.model import kernels
from narx_sklearn.model.narx import NARXModel
from narx_sklearn.model.phi import FunctionPhi
from narx_sklearn.model.polynomials import Polynomial
from narx_sklearn.model.terms import Variable

NEGLIGIBLE = 1e-11  # of the sum of magnitudes: coefficients that cancel to this are zero to rounding
REAL = 1e-6  # relative imaginary part under which a root is real; a double root is known to sqrt(eps)
SAME = 1e-6  # relative distance under which two solutions of the search are one
FOUND = 1e-9  # relative residual of a solution
PARTS = (0.2, 1.0)  # of those sizes at which the search starts
NEWTON_STEPS, HALVINGS = 60, 8
SLOPE_STEP = 6e-6  # relative step of a central difference, cbrt(eps)

ReadInput = Callable[[str, int], np.ndarray]  # (signal, lag) -> values at the points, in units


class Held(NamedTuple):
    """A model with its inputs and phi regressors held, at several points."""

    model: NARXModel
    n_points: int
    values: dict[Variable, np.ndarray]  # of everything but outputs and functions of outputs
    functions: dict[Variable, FunctionPhi]  # phi regressors that are functions of outputs
    read_input: ReadInput


class Solutions(NamedTuple):
    """Where a held model can rest."""

    y: np.ndarray  # (n_points, n_solutions, n_outputs) in units, NaN where a point has fewer
    eigenvalues: np.ndarray  # (n_points, n_solutions, n_eigenvalues) complex
    is_continuum: np.ndarray  # (n_points,) every output (of a line, of several outputs) is a solution
    is_exhaustive: bool  # whether there can be no other solutions

    @property
    def radius(self) -> np.ndarray:
        """Spectral radius of each solution, shape (n_points, n_solutions)."""
        return np.abs(self.eigenvalues).max(axis=2, initial=0.0, where=~np.isnan(self.eigenvalues)) + (
            0.0 * self.y[:, :, 0]
        )


def hold(model: NARXModel, n_points: int, read_input: ReadInput, read_phi, given=None) -> Held:
    """Hold a model's inputs and phi regressors.

    ``read_input(signal, lag)`` and ``read_phi(phi, lag)`` return values at the points; ``given`` maps names
    of phi regressors to values that come first. Outputs are equal at all lags, so a built-in phi of an
    output is zero, if it has no memory.
    """
    given = dict(given or {})
    by_name = {str(p.name): p for p in model.phi}
    unknown = given.keys() - by_name.keys()
    if unknown:
        raise ValueError(f"phi names {sorted(unknown)}; the phi regressors of the model are {list(by_name)}.")
    values, functions = {}, {}
    for variable in model.library.variables:
        signal = variable.signal
        if signal in model.outputs:
            continue
        if signal in given:
            values[variable] = np.full(n_points, float(given[signal]))
        elif signal in model.inputs:
            values[variable] = read_input(signal, variable.lag) - model.origin.get(signal, 0.0)
        elif signal not in model._output_phis:
            values[variable] = read_phi(by_name[signal], variable.lag)
        elif isinstance(phi := by_name[signal], FunctionPhi):
            functions[variable] = phi
        elif phi.has_memory:
            raise ValueError(
                f"{signal} is a {phi.describe()} and rests at a value that depends on the past; "
                f"pass that value as phi={{{signal!r}: value}}."
            )
        else:
            values[variable] = np.zeros(n_points)
    return Held(model, n_points, values, functions, read_input)


def hold_at_rest(model: NARXModel, X: np.ndarray, given=None) -> Held:
    """Hold the inputs of a model at the rows of ``X``, where they rest and never moved before."""

    def read_input(signal, lag):
        return X[:, model.inputs.index(signal)]

    return hold(model, X.shape[0], read_input, resting_phi(model, X), given)


def resting_phi(model: NARXModel, X: np.ndarray):
    """Return the reader of phi regressors whose inputs rest at the rows of ``X`` and never moved before."""

    def read_phi(phi, lag):
        columns = [X[:, model.inputs.index(s)] for s in dict.fromkeys(v.signal for v in phi.arguments)]
        return np.array([phi.run(*(np.full(2, c[p]) for c in columns))[-1] for p in range(X.shape[0])])

    return read_phi


def solve(held: Held) -> Solutions:
    """Return all real solutions of ``y = F(y, ..., y)`` at each point, with their eigenvalues."""
    equations = held.model.equations.values()
    outputs = set(held.model.outputs)
    degree = max(
        (sum(e for v, e in t.factors if v.signal in outputs) for side in equations for t, _ in side.items),
        default=0,
    )
    if not held.functions and len(outputs) == 1:
        points, continuum = _roots(*_balance(held))
    elif not held.functions and degree <= 1:
        points, continuum = _linear_solutions(held)
    else:
        points, continuum = _searched_solutions(held)
    deviations = _track(points, len(outputs))
    origin = np.array([held.model.origin.get(output, 0.0) for output in held.model.outputs])
    eigenvalues = _eigenvalues(held, deviations)
    is_exhaustive = not held.functions and (len(outputs) == 1 or degree <= 1)
    return Solutions(deviations + origin, eigenvalues, continuum, is_exhaustive)


def _balance(held: Held) -> tuple[np.ndarray, np.ndarray]:
    """Return the coefficients of F(y, ..., y) - y in powers of y, and the sums of their magnitudes."""
    (output,) = held.model.outputs
    equation = held.model.equation()
    powers = [sum(e for v, e in term.factors if v.signal == output) for term, _ in equation.items]
    coefficients = np.zeros((held.n_points, max([1, *powers]) + 1))
    magnitudes = np.zeros_like(coefficients)
    for (term, value), power in zip(equation.items, powers, strict=True):
        amount = np.full(held.n_points, value)
        for variable, exponent in term.factors:
            if variable.signal != output:
                amount = amount * held.values[variable] ** exponent
        coefficients[:, power] += amount
        magnitudes[:, power] += np.abs(amount)
    coefficients[:, 1] -= 1.0
    magnitudes[:, 1] += 1.0
    return coefficients, magnitudes


def _roots(coefficients: np.ndarray, magnitudes: np.ndarray):
    """Return the real roots of each row, and which rows vanish altogether."""
    coefficients = np.where(np.abs(coefficients) <= NEGLIGIBLE * magnitudes, 0.0, coefficients)
    points = []
    for row in coefficients:
        used = np.trim_zeros(row, "b")
        if used.size == 2:
            points.append(np.array([[-used[0] / used[1]]]))
        elif used.size < 2:
            points.append(np.empty((0, 1)))
        else:
            roots = np.polynomial.polynomial.polyroots(used)
            points.append(np.sort(roots[np.abs(roots.imag) <= REAL * np.abs(roots)].real)[:, None])
    return points, ~coefficients.any(axis=1)


def _linear_solutions(held: Held):
    """Solve ``(I - A) y = b`` at each point, A and b being the sums of output coefficients and the rest."""
    n_outputs = len(held.model.outputs)
    zero = np.zeros((held.n_points, n_outputs))
    b = _right_hand_sides(held, zero)
    matrix = np.eye(n_outputs) - _slopes(held, zero).sum(axis=1)
    points, continuum = [], np.zeros(held.n_points, dtype=bool)
    for p in range(held.n_points):
        size = 1.0 + np.abs(matrix[p]).max()
        solution, _, rank, _ = np.linalg.lstsq(matrix[p], b[p], rcond=None)
        singular = np.linalg.svd(matrix[p], compute_uv=False)[-1] <= NEGLIGIBLE * size
        consistent = np.allclose(matrix[p] @ solution, b[p], rtol=0.0, atol=FOUND * np.abs(b[p]).max())
        continuum[p] = singular and consistent
        points.append(np.empty((0, n_outputs)) if singular or rank < n_outputs else solution[None])
    return points, continuum


def _searched_solutions(held: Held):
    """Solve by Newton steps from many starts, at all points at once."""
    n_outputs = len(held.model.outputs)
    starts = np.array(_starts(held))
    smallest = np.abs(starts[1:]).max(axis=1).min()  # the first start is zero
    copies = _at_points(held, np.repeat(np.arange(held.n_points), len(starts)))
    with np.errstate(all="ignore"):  # a step may leave the finite range; its answer is refused
        answers = _newton(copies, np.tile(starts, (held.n_points, 1)))
        size = np.maximum(np.abs(answers).max(axis=1), smallest)
        is_solution = _distance_from_rest(copies, answers) <= FOUND * size
    points = []
    for p in range(held.n_points):
        rows = slice(p * len(starts), (p + 1) * len(starts))
        found: list[np.ndarray] = []
        for answer, scale in zip(
            answers[rows][is_solution[rows]], size[rows][is_solution[rows]], strict=True
        ):
            if all(np.abs(answer - other).max() > SAME * scale for other in found):
                found.append(answer)
        points.append(np.array(sorted(found, key=tuple)).reshape(-1, n_outputs))
    return points, np.zeros(held.n_points, dtype=bool)


def _newton(held: Held, y: np.ndarray) -> np.ndarray:
    """Return ``y`` after Newton steps on F(y, ..., y) = y, each halved until it comes nearer."""
    eye = np.eye(y.shape[1])
    distance = _distance_from_rest(held, y)
    for _ in range(NEWTON_STEPS):
        matrix = eye - _slopes(held, y).sum(axis=1)
        singular = ~(np.abs(np.linalg.det(matrix)) > 0.0)
        matrix[singular] = eye
        step = np.linalg.solve(matrix, (_right_hand_sides(held, y) - y)[..., None])[..., 0]
        waiting = np.ones(len(y), dtype=bool)
        for _ in range(HALVINGS):
            trial = np.where(waiting[:, None], y + step, y)
            nearer = waiting & (_distance_from_rest(held, trial) < distance)
            y = np.where(nearer[:, None], trial, y)
            waiting &= ~nearer
            step = step / 2.0
        before, distance = distance, _distance_from_rest(held, y)
        if not (distance < before).any():
            break
    return y


def _distance_from_rest(held: Held, y: np.ndarray) -> np.ndarray:
    """Return the largest |F(y, ..., y) - y| over the outputs, shape (n_points,)."""
    return np.abs(_right_hand_sides(held, y) - y).max(axis=1)


def _starts(held: Held) -> list[np.ndarray]:
    """Return starts of every sign pattern, at the sizes at which the terms of an equation balance."""
    sizes = {1.0}
    outputs = set(held.model.outputs)
    for equation in held.model.equations.values():
        for term, value in equation.items:
            power = sum(e for v, e in term.factors if v.signal in outputs)
            if power != 1:
                sizes.add(float(f"{abs(value) ** (1.0 / (1 - power)):.1g}"))
    patterns = [np.array(pattern) for pattern in product((0.0, 1.0, -1.0), repeat=len(outputs))]
    scaled = [pattern * size * part for size in sorted(sizes) for part in PARTS for pattern in patterns[1:]]
    return [patterns[0], *scaled]


def _at_points(held: Held, index: np.ndarray) -> Held:
    """Return the held model at some of its points, repeated as ``index`` says."""
    values = {variable: array[index] for variable, array in held.values.items()}

    def read_input(signal, lag):
        return held.read_input(signal, lag)[index]

    return Held(held.model, index.size, values, held.functions, read_input)


def _all_values(held: Held, y: np.ndarray) -> dict[Variable, np.ndarray]:
    """Return the value of every variable where the outputs rest at deviations ``y``."""
    values = dict(held.values)
    for variable in held.model.library.variables:
        if variable.signal in held.model.outputs:
            values[variable] = y[:, held.model.outputs.index(variable.signal)]
    for variable, phi in held.functions.items():
        values[variable] = phi.function(*_arguments(held, variable.lag, phi, y))
    return values


def _arguments(held: Held, lag: int, phi: FunctionPhi, y: np.ndarray) -> list[np.ndarray]:
    """Return the arguments of a user's function, in units."""
    model = held.model
    return [
        y[:, model.outputs.index(v.signal)] + model.origin.get(v.signal, 0.0)
        if v.signal in model.outputs
        else held.read_input(v.signal, lag + v.lag)
        for v in phi.of
    ]


def _right_hand_sides(held: Held, y: np.ndarray) -> np.ndarray:
    """Return F at rest in deviations ``y``, shape (n_points, n_outputs)."""
    values = _all_values(held, y)
    columns = [np.broadcast_to(side(values), held.n_points) for side in held.model.equations.values()]
    return np.stack(columns, axis=1)


def _slopes(held: Held, y: np.ndarray) -> np.ndarray:
    """Return dF_i / dy_j[k-lag] at rest in ``y``, shape (n_points, depth, n_outputs, n_outputs)."""
    model = held.model
    by_name = {str(p.name): p for p in model.phi}
    depth = max(
        (
            v.lag + (by_name[v.signal].reach if v.signal in by_name else 0)
            for v in model.library.variables
            if v.signal in model.outputs or v.signal in model._output_phis
        ),
        default=1,
    )
    slopes = np.zeros((y.shape[0], depth, len(model.outputs), len(model.outputs)))
    values = _all_values(held, y)
    for i, side in enumerate(model.equations.values()):
        for variable in side.variables:
            if variable.signal in model.outputs:
                j = model.outputs.index(variable.signal)
                slopes[:, variable.lag - 1, i, j] += side.derivative(variable)(values)
            elif variable.signal in model._output_phis:
                outer = side.derivative(variable)(values)
                for j, lag, inner in _phi_slopes(held, variable, by_name[variable.signal], y):
                    slopes[:, lag - 1, i, j] += outer * inner
    return slopes


def _phi_slopes(held: Held, variable: Variable, phi, y: np.ndarray):
    """Yield (output, lag, slope) of a phi regressor of outputs at rest; jumps, kinks and plays have none."""
    outputs = held.model.outputs
    if variable in held.functions:
        arguments = _arguments(held, variable.lag, phi, y)
        for a, argument in enumerate(phi.of):
            if argument.signal in outputs:
                step = SLOPE_STEP * np.where(arguments[a] == 0.0, 1.0, np.abs(arguments[a]))
                up, down = (
                    phi.function(*arguments[:a], arguments[a] + s, *arguments[a + 1 :]) for s in (step, -step)
                )
                yield outputs.index(argument.signal), variable.lag + argument.lag, (up - down) / (2.0 * step)
    elif not phi.has_memory and not isinstance(phi, FunctionPhi):
        slopes = np.zeros(3)
        kernels.phi_slopes(phi.kind, phi.kernel_parameters, 0.0, 0.0, np.zeros(kernels.STATE_SIZE), slopes)
        for back in (0, 1):
            yield outputs.index(phi.signal), variable.lag + back, slopes[back]


def _eigenvalues(held: Held, y: np.ndarray) -> np.ndarray:
    """Return the eigenvalues of the Jacobian (2.31) at every solution; complex, NaN where there is none."""
    n_points, n_solutions, _ = y.shape
    per_solution = [_slopes(held, y[:, s]) for s in range(n_solutions)]
    if not per_solution:
        return np.empty((n_points, 0, 0), dtype=complex)
    eigenvalues = [companion_eigenvalues(slopes) for slopes in per_solution]
    return np.stack(eigenvalues, axis=1)


def output_slopes(held: Held) -> np.ndarray:
    """Return the slopes at the operating point of the first point, shape (depth, n_outputs, n_outputs)."""
    return _slopes(held, np.zeros((held.n_points, len(held.model.outputs))))[0]


def companion_eigenvalues(slopes: np.ndarray) -> np.ndarray:
    """Return the eigenvalues of the block companion matrices of slopes, shape (n_points, depth, n, n)."""
    n_points, depth, n_outputs, _ = slopes.shape
    size = depth * n_outputs
    companion = np.zeros((n_points, size, size))
    companion[:, :n_outputs] = slopes.transpose(0, 2, 1, 3).reshape(n_points, n_outputs, size)
    companion[:, n_outputs:, : size - n_outputs] = np.eye(size - n_outputs)
    finite = np.isfinite(companion).all(axis=(1, 2))
    eigenvalues = np.full((n_points, size), np.nan, dtype=complex)
    eigenvalues[finite] = np.linalg.eigvals(companion[finite])
    return eigenvalues


def _track(points: list[np.ndarray], n_outputs: int) -> np.ndarray:
    """Put solutions of neighbouring points into the same column; NaN where a column has none.

    A solution joins the column whose last solution is nearest (least total distance); what is left over
    takes a free column.
    """
    width = max((len(found) for found in points), default=0)
    columns = np.full((len(points), width, n_outputs), np.nan)
    last = np.full((width, n_outputs), np.nan)
    for row, found in zip(columns, points, strict=True):
        if not len(found):
            continue
        distance = np.linalg.norm(found[:, None] - last[None], axis=2)
        distance[np.isnan(distance)] = 2.0 * np.nanmax(distance, initial=1.0)
        which, column = linear_sum_assignment(distance)
        row[column] = last[column] = found[which]
    return columns


def rest_polynomials(model: NARXModel, at_rest: dict[str, float]) -> dict[str, Polynomial]:
    """Return each equation with lags forgotten and the phi regressors in ``at_rest`` replaced by values.

    Coefficients that cancel are dropped.
    """
    sides = {}
    for output, side in model.equations.items():
        total: dict = {}
        size: dict = {}
        for term, value in side.items:
            rest = Polynomial.constant(value)
            for signal, exponent in term.cluster:
                factor = at_rest.get(signal, Polynomial.variable(Variable(signal, 0)))
                rest = rest * factor**exponent
            for key, amount in rest.items:
                total[key] = total.get(key, 0.0) + amount
                size[key] = size.get(key, 0.0) + abs(amount)
        sides[output] = Polynomial({k: v for k, v in total.items() if abs(v) > NEGLIGIBLE * size[k]})
    return sides
