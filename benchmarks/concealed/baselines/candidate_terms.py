"""A catalogue as a library of functions: what regressions choose from, and what their answers are called."""

import numpy as np

from benchmarks.concealed.plants.codes import Code

__all__ = ["evaluate", "features", "name_of"]

SMOOTH_SIGN = 0.02  # of the largest rate
ALIKE = 0.95  # correlation from which a curve bears a feature's name


def features(bench, state: int) -> list[tuple[Code, str, object]]:
    """Return (code, text, function of states and inputs) of what could be missing in one state equation."""
    x = bench.states
    position = (
        state - 1 if state > 0 and bench.machine.states[state - 1].split()[-1] in _DISPLACEMENTS else state
    )
    reach = np.max(np.abs(x), axis=0)
    swing = np.max(np.abs(bench.u[:, 0] - bench.machine.offset))
    rest = bench.machine.offset
    i, j = position, state
    table = [
        (Code.constant_load, "1", lambda x, u: np.ones(len(x))),
        (Code.coulomb_friction, "sgn v", lambda x, u: np.tanh(x[:, j] / (SMOOTH_SIGN * reach[j]))),
        (Code.quadratic_drag, "v |v|", lambda x, u: x[:, j] * np.abs(x[:, j])),
        (Code.cubic_stiffness, "x^3", lambda x, u: x[:, i] ** 3),
        (Code.quadratic_stiffness, "x^2", lambda x, u: x[:, i] ** 2),
        (Code.bilinear_stiffness, "max(x, 0)", lambda x, u: np.maximum(x[:, i], 0.0)),
        (Code.gravity, "sin x", lambda x, u: np.sin(x[:, i])),
        (Code.root_outflow, "sqrt |x|", lambda x, u: np.sqrt(np.abs(x[:, j]))),
        (Code.bilinear_input, "u x", lambda x, u: (u[:, 0] - rest) * x[:, i]),
        (Code.input_polynomial, "u^2", lambda x, u: (u[:, 0] - rest) ** 2),
        (
            Code.input_saturation,
            "clip u",
            lambda x, u: np.clip(u[:, 0] - rest, -0.8 * swing, 0.8 * swing) - (u[:, 0] - rest),
        ),
        (Code.dead_zone, "clip u near 0", lambda x, u: np.clip(u[:, 0] - rest, -0.1 * swing, 0.1 * swing)),
    ]
    if bench.u.shape[1] > 1:
        table.append((Code.coupling, "second input", lambda x, u: u[:, 1] - bench.u[:, 1].mean()))
    return table


_DISPLACEMENTS = ("[m]", "[rad]", "[V]")  # units of a state whose rate is the next one


def evaluate(bench, state: int, x=None, u=None) -> np.ndarray:
    """Return the features at the given (default: recorded) states and inputs, (n_samples, n_features)."""
    x, u = bench.states if x is None else x, bench.u if u is None else u
    return np.stack([function(x, u) for _, _, function in features(bench, state)], axis=1)


def name_of(curve, bench, state: int) -> str | None:
    """Return the code of the feature that a curve over the recording is most like, if it is like one."""
    if np.std(curve) < 1e-12:
        return None
    table = features(bench, state)
    columns = evaluate(bench, state)
    likeness = [
        abs(np.corrcoef(column, curve)[0, 1]) if np.std(column) > 1e-12 else 0.0 for column in columns.T
    ]
    best = int(np.argmax(likeness))
    return table[best][0].name if likeness[best] >= ALIKE else None
