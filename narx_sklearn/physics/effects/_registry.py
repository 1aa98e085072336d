"""The catalogue, and the entries that users add to it."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pandas as pd

from narx_sklearn.physics.effects._clearance import CLEARANCE
from narx_sklearn.physics.effects._drift import DRIFT
from narx_sklearn.physics.effects._dynamics import DYNAMICS
from narx_sklearn.physics.effects._effect import (
    ARGUMENTS,
    MAX_MEMORY,
    MAX_PARAMETERS,
    MET_ON,
    SECONDS,
    Effect,
    EffectParameter,
    Power,
    Setting,
)
from narx_sklearn.physics.effects._friction import FRICTION
from narx_sklearn.physics.effects._hysteresis import HYSTERESIS
from narx_sklearn.physics.effects._limits import LIMITS
from narx_sklearn.physics.effects._loads import LOADS
from narx_sklearn.physics.effects._sensor import SENSOR
from narx_sklearn.physics.effects._stiffness import STIFFNESS

TRIAL_STEP = 0.01  # s, of the trial run of a new entry


def _closed(effects: tuple[Effect, ...]) -> dict[str, Effect]:
    """Return the entries by code, each the look-alike of its look-alikes."""
    codes = [effect.code for effect in effects]
    alike: dict[str, set[str]] = {code: set() for code in codes}
    for effect in effects:
        for other in effect.lookalikes:
            alike[effect.code].add(other)
            alike[other].add(effect.code)
    return {
        effect.code: replace(effect, lookalikes=tuple(code for code in codes if code in alike[effect.code]))
        for effect in effects
    }


CATALOGUE: dict[str, Effect] = _closed(
    (*FRICTION, *CLEARANCE, *LIMITS, *STIFFNESS, *HYSTERESIS, *LOADS, *DRIFT, *DYNAMICS, *SENSOR)
)
"""The effects that a diagnosis tries, by code."""

BUILT_IN = frozenset(CATALOGUE)


def register_effect(effect: Effect) -> None:
    """Add an entry to the catalogue, after trying it once.

    Its force, transform and starting values are called once on small arrays, so that a mistake shows here and
    not inside a compiled run.

    Parameters
    ----------
    effect : Effect
        The new entry. Forces may be plain Python functions that numba can compile.

    Raises
    ------
    TypeError
        If it is no `Effect`.
    ValueError
        If its code is taken, a field is missing or malformed, or a trial call fails.

    See Also
    --------
    unregister_effect : Take it out again.
    list_effects : What the catalogue holds.

    Examples
    --------
    >>> import numpy as np
    >>> from narx_sklearn.physics.effects import Effect, EffectParameter, register_effect, unregister_effect
    >>> def magnet(argument, rate, own, second, time, step, z, theta, dz):
    ...     return theta[0] / (1.0 + argument * argument)
    >>> def some_values(setting):
    ...     return np.array([[0.1 * np.std(setting.own)]])
    >>> register_effect(Effect(
    ...     code="magnet", title="Magnet", sentence="A magnet pulls when near.", equation="a/(1 + x^2)",
    ...     parameters=(EffectParameter("a", "{port}"),), starts=some_values, force=magnet))
    >>> unregister_effect("magnet").code
    'magnet'
    """
    if not isinstance(effect, Effect):
        raise TypeError(f"effect must be an Effect, got {type(effect).__name__}.")
    _check_fields(effect)
    if effect.code in CATALOGUE:
        raise ValueError(
            f"The catalogue already holds an effect of code {effect.code!r}. Choose another code, or take "
            "out what you registered before with unregister_effect."
        )
    _check_trial(effect)
    CATALOGUE[effect.code] = effect


def unregister_effect(code: str) -> Effect:
    """Take a user's entry out of the catalogue and return it.

    Parameters
    ----------
    code : str
        Its code.

    Returns
    -------
    Effect
        The entry that was taken out.

    Raises
    ------
    ValueError
        If the code is unknown, or belongs to the package.

    See Also
    --------
    register_effect : Put it in, with an example.
    """
    if code in BUILT_IN:
        raise ValueError(
            f"{code!r} belongs to the package and stays; leave it out of a search by its code instead."
        )
    if code not in CATALOGUE:
        own = sorted(set(CATALOGUE) - BUILT_IN)
        raise ValueError(f"No effect {code!r} was registered; registered are {own}.")
    return CATALOGUE.pop(code)


def list_effects() -> pd.DataFrame:
    """Return the catalogue as a table, one row an effect.

    Returns
    -------
    pandas.DataFrame
        Columns ``code``, ``title``, ``sentence``, ``ports``, ``equation``, ``parameters``, ``look_alikes``,
        ``separate_by`` and ``source``, in the catalogue's order.

    Examples
    --------
    >>> from narx_sklearn.physics.effects import list_effects
    >>> int(list_effects()["code"].str.contains("friction").sum())
    5
    """
    return pd.DataFrame(
        [
            {
                "code": effect.code,
                "title": effect.title,
                "sentence": effect.sentence,
                "ports": ", ".join(effect.ports),
                "equation": effect.equation,
                "parameters": ", ".join(f"{p.name} [{p.unit}]" for p in effect.parameters),
                "look_alikes": ", ".join(effect.lookalikes),
                "separate_by": effect.separate_by,
                "source": effect.source,
            }
            for effect in CATALOGUE.values()
        ]
    )


def restore_effect(code: str, content: dict | None = None) -> Effect:
    """Return the catalogue's entry, or rebuild one that a user wrote."""
    return CATALOGUE[code] if content is None else Effect(**content)


def _check_fields(effect: Effect) -> None:
    def refuse(what: str):
        raise ValueError(f"Effect {effect.code!r}: {what}")

    if not isinstance(effect.code, str) or not effect.code.isidentifier():
        refuse("code must be a text of letters, digits and underscores, such as 'magnet_force'.")
    for name in ("title", "sentence", "equation"):
        if not isinstance(getattr(effect, name), str) or not getattr(effect, name).strip():
            refuse(f"{name} must be a text that is not empty, got {getattr(effect, name)!r}.")
    if effect.force is None and effect.transform is None and effect.factor is None:
        refuse(
            "it needs a force (to act at a state equation), a transform (at an input or output) or a factor "
            "(of a parameter)."
        )
    if not effect.ports:
        refuse("it can act nowhere: input_port and output_port are both off and there is no force.")
    for name in ("force", "transform", "held", "curved", "factor", "phi", "limits", "acts_in", "scan"):
        if getattr(effect, name) is not None and not callable(getattr(effect, name)):
            refuse(f"{name} must be callable, got {type(getattr(effect, name)).__name__}.")
    if not callable(effect.starts):
        refuse(f"starts must be callable as starts(setting), got {type(effect.starts).__name__}.")
    n = len(effect.parameters)
    if not 1 <= n <= MAX_PARAMETERS:
        refuse(f"it has {n} parameters; an effect has 1 to {MAX_PARAMETERS}.")
    for parameter in effect.parameters:
        if not isinstance(parameter, EffectParameter) or not parameter.lower < parameter.upper:
            refuse(
                f"parameter {parameter!r} must be EffectParameter(name, unit, lower, upper), lower < upper."
            )
        given = parameter.at_input
        if given is not None and not parameter.lower <= given <= parameter.upper:
            refuse(f"parameter {parameter.name!r} has at_input={given!r}, which is outside its bounds.")
    if effect.argument not in ARGUMENTS:
        refuse(f"argument must be one of {list(ARGUMENTS)}, got {effect.argument!r}.")
    if effect.second not in SECONDS:
        refuse(f"second must be one of {list(SECONDS)}, got {effect.second!r}.")
    if effect.met_on not in MET_ON:
        refuse(f"met_on must be one of {list(MET_ON)}, got {effect.met_on!r}.")
    if effect.met_at not in (None, "input", "output"):
        refuse(f"met_at must be None, 'input' or 'output', got {effect.met_at!r}.")
    if effect.form_of and effect.form_of not in CATALOGUE:
        refuse(f"form_of must be the code of an effect of the catalogue, or empty, got {effect.form_of!r}.")
    if effect.power is not None and not isinstance(effect.power, Power):
        refuse(f"power must be Power(exponent, odd) or None, got {effect.power!r}.")
    for name in ("levels", "references", "instants", "chosen", "spare"):
        indices = getattr(effect, name)
        if not isinstance(indices, tuple) or not all(index in range(n) for index in indices):
            refuse(f"{name} must be a tuple of indices of its {n} parameters, got {indices!r}.")
    for name in ("levels", "instants"):
        if len(getattr(effect, name)) not in (0, 2):
            refuse(f"{name} are two indices or none, got {getattr(effect, name)!r}.")
    for name in ("amplitude", "begin", "form", "choice", "reach", "phase"):
        index = getattr(effect, name)
        if index is not None and not 0 <= index < n:
            refuse(f"{name} must index one of its {n} parameters or be None, got {index!r}.")
    if effect.choice is not None and not np.isfinite(effect.parameters[effect.choice][2:4]).all():
        chosen = effect.parameters[effect.choice].name
        refuse(f"choice is one end of a range or the other, but parameter {chosen!r} has no finite bounds.")
    if effect.chosen and effect.limits is None:
        refuse("what is chosen is moved between limits; give limits(setting) for it.")
    if not effect.valleys >= 0:
        refuse(f"valleys counts the values tried and must be 0 or more, got {effect.valleys!r}.")
    if not 0 <= effect.n_memory <= MAX_MEMORY:
        refuse(f"n_memory must lie between 0 and {MAX_MEMORY}, got {effect.n_memory!r}.")
    if effect.after and effect.n_memory:
        refuse(
            f"an effect that acts after the step has no states of its own, got n_memory={effect.n_memory}."
        )


def _check_trial(effect: Effect) -> None:
    """Call everything once, on 64 samples of a signal that moves both ways."""
    n = len(effect.parameters)
    starts = _tried(effect, "starts", lambda: np.asarray(effect.starts(trial_setting()), dtype=float))
    if starts.size == 0:
        bounds = np.array([(p.lower, p.upper) for p in effect.parameters], dtype=float)
        starts = np.clip(np.ones((1, n)), bounds[:, 0], bounds[:, 1])
    if starts.ndim != 2 or starts.shape[1] != n:
        raise ValueError(
            f"Effect {effect.code!r}: starts(setting) returned shape {starts.shape}; wanted is (n_starts, "
            f"{n}), one column a parameter."
        )
    for parameter, values in zip(effect.parameters, starts.T, strict=True):
        if np.any(values < parameter.lower) or np.any(values > parameter.upper):
            raise ValueError(
                f"Effect {effect.code!r}: starts(setting) gives {parameter.name} = {values.tolist()}, "
                f"outside its bounds {parameter.lower} and {parameter.upper}."
            )
    if effect.limits is not None:
        limits = np.shape(_tried(effect, "limits", lambda: effect.limits(trial_setting())))
        if limits != (n, 2):
            raise ValueError(
                f"Effect {effect.code!r}: limits(setting) returned shape {limits}; wanted is ({n}, 2), the "
                "least and the largest value of each parameter."
            )
    theta = starts[0]
    for name in ("force", "handed_on", "following"):
        if getattr(effect, name) is not None:
            _try_force(effect, name, getattr(effect, name), theta, effect.n_memory if name == "force" else 0)
    if effect.put_out is not None and effect.put_out.late is None:
        _try_force(effect, "put_out", effect.put_out.force, theta, effect.put_out.n_memory)
    if effect.transform is not None:
        _try_on_signal(effect, "transform", lambda signal, at: _transformed(effect, signal, at, theta))
    if effect.factor is not None:
        _try_factor(effect, theta)
    if effect.held is not None:
        _try_on_signal(effect, "held", lambda signal, at: _held(effect, signal, at, theta))
    if effect.curved is not None:
        _try_on_signal(effect, "curved", lambda signal, at: _curved(effect, signal, at, theta))
    if effect.acts_in is not None:
        _try_acts_in(effect, effect.acts_in, theta)
    if effect.scan is not None:
        _try_scan(effect)


def _transformed(effect: Effect, signal: np.ndarray, at: Setting, theta: np.ndarray) -> tuple:
    return (effect.transform(signal, at.second, TRIAL_STEP, theta.copy(), at.first),)


def _held(effect: Effect, signal: np.ndarray, at: Setting, theta: np.ndarray) -> tuple:
    return tuple(effect.held(signal, TRIAL_STEP, theta.copy(), at.first))


def _curved(effect: Effect, signal: np.ndarray, at: Setting, theta: np.ndarray) -> tuple:
    return tuple(effect.curved(signal, signal.copy(), signal.copy(), TRIAL_STEP, theta.copy(), at.first))


def _try_acts_in(effect: Effect, acts_in: Callable, theta: np.ndarray) -> None:
    spans = _tried(effect, "acts_in", lambda: np.asarray(acts_in(theta.copy()), dtype=float))
    if spans.ndim != 2 or spans.shape[1] != 2 or not np.all(spans[:, 0] <= spans[:, 1]):
        raise ValueError(
            f"Effect {effect.code!r}: acts_in returned {spans.tolist()}; wanted is ((low, high), ...), "
            "between which values of its argument it acts."
        )


def _try_scan(effect: Effect) -> None:
    setting = trial_setting()
    residual = 0.1 * np.sign(setting.argument)

    def scanned() -> tuple:
        rows, n_tried = effect.scan(setting._replace(residual=residual), residual)
        return np.shape(rows), float(n_tried)

    shape, n_tried = _tried(effect, "scan", scanned)
    n = len(effect.parameters)
    if len(shape) != 2 or shape[1] != n or n_tried < shape[0]:
        raise ValueError(
            f"Effect {effect.code!r}: scan returned rows of shape {shape} and {n_tried:g} tried; wanted is "
            f"(n_rows, {n}), one column a parameter, and the number of all that were tried."
        )


def _try_on_signal(effect: Effect, name: str, call) -> None:
    setting = trial_setting()
    signal = setting.argument.copy()
    for changed in _tried(effect, name, lambda: call(signal, setting)):
        if np.shape(changed) != signal.shape or not np.all(np.isfinite(changed)):
            raise ValueError(
                f"Effect {effect.code!r}: {name} returned shape {np.shape(changed)} for {signal.size} "
                "finite samples; wanted is one finite value a sample."
            )
    if not np.array_equal(signal, setting.argument):
        raise ValueError(f"Effect {effect.code!r}: {name} changed its signal; return a new array.")


def _try_factor(effect: Effect, theta: np.ndarray) -> None:
    value = _tried(effect, "factor", lambda: effect.factor(0.5, theta.copy()))
    if not np.isscalar(value) or not np.isfinite(value):
        raise ValueError(f"Effect {effect.code!r}: factor returned {value!r}; wanted is one finite number.")


def _try_force(effect: Effect, name: str, force: Callable, theta: np.ndarray, n_written: int) -> None:
    padded = np.zeros(MAX_PARAMETERS + 1)
    padded[: theta.size] = theta
    dz = np.full(MAX_MEMORY, np.nan)
    value = _tried(
        effect,
        name,
        lambda: force(0.5, -0.3, 0.2, 0.1, 1.0, TRIAL_STEP, np.zeros(MAX_MEMORY), padded, dz),
    )
    if not np.isscalar(value) or not np.isfinite(value):
        raise ValueError(f"Effect {effect.code!r}: {name} returned {value!r}; wanted is one finite number.")
    if not np.all(np.isfinite(dz[:n_written])):
        raise ValueError(
            f"Effect {effect.code!r}: {name} left dz = {dz[:n_written].tolist()}; it must write all "
            f"{n_written} states that n_memory announces."
        )


def _tried(effect: Effect, name: str, call):
    try:
        return call()
    except Exception as error:
        raise ValueError(f"Effect {effect.code!r}: {name} raised {type(error).__name__}: {error}") from error


def trial_setting() -> Setting:
    """Return a small setting in which most effects show: two sines, both ways, two sessions."""
    time = TRIAL_STEP * np.arange(64)
    argument = np.sin(20.0 * time) + 0.4 * np.cos(47.0 * time)
    rate = 20.0 * np.cos(20.0 * time) - 18.8 * np.sin(47.0 * time)
    return Setting(
        argument=argument,
        rate=rate,
        own=-3.0 * argument + np.cos(11.0 * time),
        second=1.0 + np.cos(13.0 * time),
        time=np.concatenate([time[:40], time[:24]]),
        dt=TRIAL_STEP,
        first=np.array([0, 40]),
    )
