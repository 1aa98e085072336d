"""What a diagnosis is asked to do."""

from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from typing import Any

from narx_sklearn.physics.effects import CATALOGUE, Effect

STAGES = {  # share of the time, in per cent, that has usually passed when a stage begins
    "check of the record": 0,
    "fit of the simulator's own parameters": 10,
    "colour of the noise": 12,
    "search for missing physics": 35,
    "search again, under the noise that the best explanation leaves": 55,
    "rivals and unnamed curves": 73,
    "verification on held-out samples": 82,
    "location": 92,
}


SECOND_LOOK = 0.25  # of alpha
IN_PART = 0.5  # of alpha, for what acts for a while
NAMELESS = 0.5  # of alpha, for what has no name, and for what follows no signal


@dataclass(frozen=True)
class Settings:
    """What a diagnosis is asked to do.

    The chance ``alpha`` of a false alarm is for the search for names all through the record; other searches
    are allowed shares of it.
    """

    effects: tuple
    alpha: float
    max_effects: int
    n_leaders: int
    window: int | None
    random_state: Any
    n_jobs: int | None
    tell: Callable[[str], None]
    level: float = 0.9
    test_fraction: float = 0.2
    of_noise: tuple[str, ...] = ()  # codes of what values themselves show, and is a part of the noise

    @property
    def unasked(self) -> list[Effect]:
        """Effects of the catalogue that are not asked for, and may act."""
        return [e for e in CATALOGUE.values() if e not in self.effects and e.code not in self.of_noise]

    @property
    def alpha_in_part(self) -> float:
        """Chance that is allowed to what acts for a while."""
        return IN_PART * self.alpha

    @property
    def alpha_nameless(self) -> float:
        """Chance that is allowed to what is no noise but has no name, and to what follows no signal."""
        return NAMELESS * self.alpha

    def for_second_look(self) -> "Settings":
        """Return what a second look at a record is asked to do."""
        return replace(self, alpha=SECOND_LOOK * self.alpha)


def read_effects(effects, exclude=()) -> tuple[Effect, ...]:
    """Return the effects that may be missing: the catalogue, or those of a list of codes and own ones.

    With an effect of the catalogue go its other forms.
    """
    if isinstance(effects, str):
        if effects != "catalogue":
            raise ValueError(f"effects must be 'catalogue' or a list of codes, got {effects!r}.")
        effects = CATALOGUE.values()
    else:
        _check_list(effects, "effects", "'catalogue', or a list of codes or Effects")
    _check_list(exclude, "exclude", "a list of codes, empty for none")
    left_out = {effect.code for effect in _with_forms(exclude)}
    chosen = [effect for effect in _with_forms(effects) if effect.code not in left_out]
    if not chosen:
        raise ValueError("No effect is left to look for; exclude fewer, or pass effects='catalogue'.")
    return tuple(chosen)


def _with_forms(codes: Iterable) -> list[Effect]:
    """Return the entries and their other forms, each once."""
    entries = [_entry(code) for code in codes]
    forms = [form for entry in entries for form in CATALOGUE.values() if form.form_of == entry.code]
    return list(dict.fromkeys([*entries, *forms]))


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
