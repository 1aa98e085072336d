"""What a diagnosis is asked to do."""

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Any

from narx_sklearn.physics.effects import CATALOGUE, Effect


@dataclass(frozen=True)
class Settings:
    """What a diagnosis is asked to do."""

    effects: tuple
    alpha: float
    max_effects: int
    n_leaders: int
    window: int | None
    random_state: Any
    n_jobs: int | None
    tell: Callable[[str], None]


def read_effects(effects, exclude=()) -> tuple[Effect, ...]:
    """Return the effects that may be missing: the catalogue, or those of a list of codes and own ones."""
    if isinstance(effects, str):
        if effects != "catalogue":
            raise ValueError(f"effects must be 'catalogue' or a list of codes, got {effects!r}.")
        effects = CATALOGUE.values()
    elif not isinstance(effects, Iterable):
        raise TypeError(
            f"effects must be 'catalogue' or a list of codes, got {effects!r}; put a single one into a list."
        )
    chosen = [_entry(effect) for effect in effects]
    left_out = {_entry(code).code for code in exclude}
    chosen = [effect for effect in chosen if effect.code not in left_out]
    if not chosen:
        raise ValueError("No effect is left to look for; exclude fewer, or pass effects='catalogue'.")
    return tuple(chosen)


def _entry(code) -> Effect:
    if isinstance(code, Effect):
        return code
    if code not in CATALOGUE:
        raise ValueError(f"There is no effect {code!r} in the catalogue; it holds {sorted(CATALOGUE)}.")
    return CATALOGUE[code]
