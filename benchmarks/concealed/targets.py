"""The targets of the protocol, one line each."""

from typing import NamedTuple

__all__ = ["TARGETS", "Target"]


class Target(NamedTuple):
    """A measure of a cell: `at_least` or at most `value`; a `proportion` gets exact binomial bounds."""

    cell: str
    stratum: str  # "" for each stratum apart, "*" for all together
    measure: str
    at_least: bool
    value: float
    proportion: bool = True


TARGETS = (
    Target("T0", "", "false_alarm", False, 0.01),
    Target("T1", "", "says_refit", True, 0.97),
    Target("T2", "R>=0.3", "first_right", True, 0.95),
    Target("T2", "R>=0.3", "wrong_name", False, 0.02),
    Target("T2", "R>=0.15", "first_right", True, 0.90),
    Target("T2", "R>=0.15", "wrong_name", False, 0.03),
    Target("T2", "R>=0.1", "first_right", True, 0.70),
    Target("T2", "R>=0.1", "wrong_name", False, 0.05),
    Target("T3", "*", "wrong_name", False, 0.03),
    Target("T4", "*", "exact_set", True, 0.80),
    Target("T5", "*", "exact_set", True, 0.70),
    Target("T5", "*", "set_f1", True, 0.85, False),
    Target("T6", "*", "unknown_at_port", True, 0.85),
    Target("T6", "*", "forced_name", False, 0.05),
    Target("T7", "", "first_right", True, 0.85),
    Target("T8", "*", "set_holds", True, 0.95),
    Target("T8", "*", "set_size", False, 2.0, False),
    Target("T10", "*", "port_right", True, 0.95),
    Target("T10", "*", "region_f1", True, 0.90, False),
    Target("T10", "*", "time_iou", True, 0.70, False),
)
