"""Catalogue of physical effects that a simulation may lack.

What an entry is stands in ``_effect``; ``_registry`` gathers the entries and takes those of users. They
stand by kind in ``_friction``, ``_clearance``, ``_limits``, ``_stiffness``, ``_hysteresis``, ``_loads``,
``_drift``, ``_dynamics`` and ``_sensor``, and share starting values (``_starts``), runs along a record
(``_series``), rounded corners (``_corner``), functions for NARX models (``_curves``) and how forces are
compiled (``_kernel``).
"""

from narx_sklearn.physics.effects._effect import (
    PARAMETER,
    PORTS,
    Effect,
    EffectParameter,
    Name,
    Power,
    PutOut,
    Setting,
    no_start,
)
from narx_sklearn.physics.effects._registry import (
    BUILT_IN,
    CATALOGUE,
    list_effects,
    register_effect,
    restore_effect,
    unregister_effect,
)
from narx_sklearn.physics.effects._series import held_runs

__all__ = [
    "BUILT_IN",
    "CATALOGUE",
    "PARAMETER",
    "PORTS",
    "Effect",
    "EffectParameter",
    "Name",
    "Power",
    "PutOut",
    "Setting",
    "held_runs",
    "list_effects",
    "no_start",
    "register_effect",
    "restore_effect",
    "unregister_effect",
]
