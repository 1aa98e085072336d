"""Plants to try compensators on, and a scorer that judges a compensator by what it does to one."""

from collections.abc import Callable

import numpy as np

from narx_sklearn._validation import as_signals
from narx_sklearn.compensation._kernels import element_value
from narx_sklearn.compensation.law import BoucWenElement
from narx_sklearn.metrics import mape
from narx_sklearn.model.kernels import STATE_SIZE
from narx_sklearn.model.narx import NARXModel
from narx_sklearn.model.simulation import free_run
from narx_sklearn.physics.boucwen import BoucWenModel

__all__ = ["run_plant", "tracking_error", "tracking_scorer"]


def run_plant(plant, u) -> np.ndarray:
    """Apply an input to a plant and return its output.

    Parameters
    ----------
    plant : callable, NARXModel, or object with ``run`` or ``predict``
        Anything that simulates: a function from the whole input to the whole output; a model, run freely from
        its steady state; an operator of `narx_sklearn.physics`; a fitted estimator.
    u : array-like of shape (n_samples,)
        Input.

    Returns
    -------
    ndarray of shape (n_samples,)

    Raises
    ------
    TypeError
        If the plant is nothing that can be run.
    ValueError
        If it returns another number of samples.

    Examples
    --------
    >>> from narx_sklearn.compensation import run_plant
    >>> run_plant(lambda u: 2 * u, [1.0, 2.0]).tolist()
    [2.0, 4.0]
    """
    u = as_signals(u, "u")[:, 0]
    if isinstance(plant, NARXModel):
        y = free_run(plant, u).y
    elif hasattr(plant, "run"):
        y = plant.run(u)
    elif hasattr(plant, "predict"):
        y = plant.predict(u.reshape(-1, 1))
    elif callable(plant):
        y = plant(u)
    else:
        raise TypeError(
            "A plant is a function of the input, a NARXModel, or has run or predict; got "
            f"{type(plant).__name__}."
        )
    y = np.asarray(y, dtype=float).reshape(-1)
    if y.size != u.size:
        raise ValueError(
            f"The plant returned {y.size} samples for an input of {u.size}; it must return as many."
        )
    return y


def tracking_error(
    compensator, plant, reference, *, metric: Callable = mape, n_settle: int = 0, m_init: float | None = None
) -> float:
    """Compute how far a plant, driven by a compensator, stays from a reference.

    Parameters
    ----------
    compensator : fitted compensator or None
        Gives the input; None applies the reference itself.
    plant : callable, NARXModel, or object with ``run`` or ``predict``
        As for `run_plant`.
    reference : array-like of shape (n_samples,)
        Wanted output.
    metric : callable, default=mape
        ``metric(reference, output)``, smaller is better.
    n_settle : int, default=0
        First samples that are not judged.
    m_init : float or None, default=None
        Input before the first sample, as for ``predict``; the input at which the plant starts, where it is
        known.

    Returns
    -------
    float
        Infinite where the plant left the finite range.
    """
    r = as_signals(reference, "reference")[:, 0]
    if compensator is None:
        u = r
    elif hasattr(compensator, "compensate"):  # a score says itself what a warning would
        u = compensator.compensate(r, m_init).m
    else:
        u = compensator.predict(r, m_init=m_init)
    y = run_plant(plant, u)
    if not np.all(np.isfinite(y)):
        return np.inf
    return float(metric(r[n_settle:], y[n_settle:]))


def tracking_scorer(
    plant, reference, *, metric: Callable = mape, n_settle: int = 0, m_init: float | None = None
) -> Callable:
    """Make a scorer for cross-validation: minus the tracking error on a plant.

    The data of a fold identify the compensator; the plant judges it, whatever the fold held out.

    Parameters
    ----------
    plant : callable, NARXModel, or object with ``run`` or ``predict``
        As for `run_plant`.
    reference : array-like of shape (n_samples,)
        Wanted output.
    metric : callable, default=mape
        ``metric(reference, output)``, smaller is better.
    n_settle : int, default=0
        First samples that are not judged.
    m_init : float or None, default=None
        Input before the first sample, as for ``predict``; the input at which the plant starts, where it is
        known.

    Returns
    -------
    callable
        ``scorer(compensator, X, y)``, larger is better; for ``scoring=`` of `GridSearchCV`. A compensator
        that drives the plant out of the finite range scores -1e6.

    Examples
    --------
    >>> import numpy as np
    >>> from narx_sklearn.compensation import PrandtlIshlinskiiCompensator, tracking_scorer
    >>> from narx_sklearn.physics import PrandtlIshlinskiiOperator
    >>> plant = PrandtlIshlinskiiOperator((0, 0.5), (1.0, 0.4))
    >>> scorer = tracking_scorer(plant, np.sin(np.arange(100) / 10))
    >>> round(scorer(PrandtlIshlinskiiCompensator(plant).fit(), None, None), 9) == 0.0
    True
    """

    def score(compensator, X=None, y=None) -> float:
        error = tracking_error(compensator, plant, reference, metric=metric, n_settle=n_settle, m_init=m_init)
        return -min(error, 1e6)

    return score


class SteppedPlant:
    """A plant that is stepped one sample at a time, for closed loops.

    Parameters
    ----------
    plant : callable, NARXModel, BoucWenModel, or object with ``step``
        ``step(u) -> y``, or a function of that kind; its ``reset()`` is called where it has one. A model of
        one input and one output, or a Bouc-Wen model, is wrapped.
    """

    def __init__(self, plant):
        self.plant = plant
        self._step = self._wrapped(plant)

    def _wrapped(self, plant):
        if isinstance(plant, NARXModel):
            return _ModelStepper(plant).step
        if isinstance(plant, BoucWenModel):
            return _BoucWenStepper(plant).step
        if hasattr(plant, "step"):
            if hasattr(plant, "reset"):
                plant.reset()
            return plant.step
        if callable(plant):
            return plant
        raise TypeError(
            "A plant in a loop must be stepped: a NARXModel, a BoucWenModel, a function u -> y, or an "
            f"object with step(u); got {type(plant).__name__}."
        )

    def step(self, u: float) -> float:
        """Apply one input, return the output at the same sample."""
        return float(self._step(u))


class _BoucWenStepper:
    def __init__(self, model: BoucWenModel):
        self.model = model
        element = BoucWenElement("u", model.A, model.beta, model.gamma, model.n)
        self._kind, self._parameters = element.kind, element.kernel_parameters
        self._h, self._last = np.zeros(STATE_SIZE), 0.0

    def step(self, u):
        h = element_value(self._kind, self._parameters, float(u), self._last, self._h)
        self._last = float(u)
        return self.model.input_gain * u + self.model.hysteresis_gain * h + self.model.offset


class _ModelStepper:
    """Steps a model by free runs over its last few samples; for phi regressors without memory."""

    def __init__(self, model: NARXModel):
        if len(model.inputs) != 1 or len(model.outputs) != 1:
            raise ValueError(
                f"A model in a loop must have one input and one output, got {list(model.inputs)} and "
                f"{list(model.outputs)}."
            )
        if any(p.has_memory for p in model.phi):
            raise ValueError(
                "A model with phi regressors that remember cannot be stepped by its last samples; pass an "
                "object with step(u)."
            )
        self.model = model
        self._u: list = []
        self._y: list = []

    def step(self, u):
        depth = self.model.max_lag
        if not self._u:
            self._y = list(free_run(self.model, np.full(depth + 1, u)).y[:, 0])[-1:] * (depth or 1)
            self._u = [float(u)] * (depth + 1)
            return self._y[-1]
        self._u = [*self._u[1:], float(u)]
        y = free_run(self.model, self._u, y_init=self._y).y[-1, 0]
        self._y = [*self._y[1:], y]
        return y
