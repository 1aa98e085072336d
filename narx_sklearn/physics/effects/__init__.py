"""Catalogue of physical effects that a simulation may lack."""

from narx_sklearn.physics.effects._effect import PORTS, Effect, EffectParameter, Setting, no_start
from narx_sklearn.physics.effects._registry import (
    BUILT_IN,
    CATALOGUE,
    list_effects,
    register_effect,
    restore_effect,
    unregister_effect,
)

__all__ = [
    "BUILT_IN",
    "CATALOGUE",
    "PORTS",
    "Effect",
    "EffectParameter",
    "Setting",
    "list_effects",
    "no_start",
    "register_effect",
    "restore_effect",
    "unregister_effect",
]
