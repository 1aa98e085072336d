"""What a diagnosis is asked to do."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any


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
