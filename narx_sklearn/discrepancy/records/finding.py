"""Something about a record that is no physics."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any


@dataclass(frozen=True)
class DataFinding:
    """Something about a record that is no physics.

    Attributes
    ----------
    code : str
        ``"short_record"``, ``"constant_input"``, ``"duplicated_samples"``, ``"clipped_output"``, ``"jump"``,
        ``"held_output"``, ``"time_scale"``, ``"swapped"``, ``"delayed"``, ``"sign"``, ``"wrapped"``,
        ``"unsigned"``, ``"units"``, ``"quantised_output"``, ``"spikes"``, ``"coarse_steps"``, ``"rows"``,
        ``"bounds"``, ``"dead_values"``, ``"sessions"``, ``"hold"``.
    sentence : str
        What was seen, with the number, and what to do.
    evidence : mapping of {str: value}
        The numbers.
    """

    code: str
    sentence: str
    evidence: Mapping[str, Any] = field(default_factory=dict)

    def __str__(self) -> str:
        return self.sentence
