"""What a parameter of the simulator depends on, that was taken for a constant."""

import numpy as np

from narx_sklearn.physics.effects._effect import Effect, EffectParameter, Setting
from narx_sklearn.physics.effects._kernel import kernel
from narx_sklearn.physics.effects._starts import ORDINARY, grid, spread


@kernel
def _in_proportion(second, theta):
    return 1.0 + theta[0] * (second - theta[1])


def _mean(setting: Setting) -> float:
    return float(np.nanmean(setting.argument))


def _varying_starts(setting: Setting) -> np.ndarray:
    """A parameter that changes by a tenth where the signal is a standard deviation off its mean."""
    size = spread(setting.argument)
    return grid([ORDINARY / size], [_mean(setting)]) if size > 0 else np.empty((0, 2))


def _varying_limits(setting: Setting) -> np.ndarray:
    """Count the signal from its mean: from elsewhere, the parameter itself would be another."""
    return np.array([[-np.inf, np.inf], [_mean(setting)] * 2])


PARAMETERS = (
    Effect(
        code="varying_parameter",
        title="Parameter that depends on a signal",
        sentence="What the simulation has as a constant changes with a signal, wherever it stands in the "
        "equations.",
        equation="p (1 + a (w - r)) in place of p, with r the mean of w",
        parameters=(EffectParameter("a", "1/({second})"), EffectParameter("r", "{second}")),
        starts=_varying_starts,
        limits=_varying_limits,
        factor=_in_proportion,
        lookalikes=("temperature_gain", "bilinear_input", "quadratic_stiffness", "gain_drift"),
        separate_by="that signal alone at several levels, with all else repeated",
        source="Rugh and Shamma 2000, Automatica 36(10), sec. 2 (parameters that depend on a signal)",
        narx_terms="that signal as a further input, times the terms that hold the parameter",
    ),
)
