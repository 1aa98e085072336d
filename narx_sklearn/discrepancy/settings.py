"""What a diagnosis is asked to do."""

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Any

from narx_sklearn.physics.effects import CATALOGUE, Effect

STAGES = {  # share of the time, in per cent, that has usually passed when a stage begins
    "check of the record": 0,
    "fit of the simulator's own parameters": 10,
    "colour of the noise": 12,
    "search for missing physics": 35,
    "search again, under the noise that the best explanation leaves": 55,
    "rivals and unnamed curves": 73,
    "location": 82,
    "verification on held-out samples": 84,
}


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
    else:
        _check_list(effects, "effects", "'catalogue', or a list of codes or Effects")
    _check_list(exclude, "exclude", "a list of codes, empty for none")
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


def _check_list(given, name: str, wanted: str) -> None:
    if isinstance(given, str):
        raise TypeError(f"{name} must be {wanted}, got the text {given!r}. Pass [{given!r}].")
    if not isinstance(given, Iterable):
        raise TypeError(f"{name} must be {wanted}, got {given!r}; put a single one into a list.")
