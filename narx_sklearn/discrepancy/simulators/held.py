"""Objects and mappings that a user's function reads, as constants of the compiler.

``plant.stiffness``, ``self.table(u[0])`` and ``constants["mass"]`` are then what a number written in their
place would be. What is written to, or read under a name that is computed, does not compile.
"""

from collections.abc import Mapping
from itertools import count
from typing import Any

import numba
import numpy as np
from numba.core import types
from numba.core.imputils import lower_builtin, lower_constant, lower_getattr_generic
from numba.core.typing.templates import AbstractTemplate, AttributeTemplate, infer, infer_getattr, signature
from numba.extending import models, overload, register_model, typeof_impl

NUMBERS = types.Number | types.Boolean


class Held:
    """Members of an object, or items of a mapping, by their names.

    Parameters
    ----------
    members : mapping of {str: value}
        Numbers, arrays, tuples, compiled functions, and others of this kind.
    """

    def __init__(self, members: Mapping[str, Any]):
        self.type = _HeldType(members)


class _HeldType(types.Opaque):
    """Type of one held object: it has all that is known of it, and no value while the function runs."""

    numbers = count()

    def __init__(self, members: Mapping[str, Any]):
        self.members = {name: (_constant_type(value), value) for name, value in members.items()}
        super().__init__(f"Held{next(self.numbers)}")


def _constant_type(value: Any) -> types.Type:
    kind = numba.typeof(value)
    return kind.copy(readonly=True) if isinstance(value, np.ndarray) else kind


register_model(_HeldType)(models.OpaqueModel)


@typeof_impl.register(Held)
def _typeof(held, context):
    return held.type


@lower_constant(_HeldType)
def _lower_held(context, builder, kind, value):
    return context.get_dummy_value()


@infer_getattr
class _Member(AttributeTemplate):
    key = _HeldType

    def generic_resolve(self, held, name):  # type: ignore[override]
        return held.members[name][0] if name in held.members else None


@lower_getattr_generic(_HeldType)
def _lower_member(context, builder, held, value, name):
    return context.get_constant_generic(builder, *held.members[name])


@infer
class _Item(AbstractTemplate):
    key = "static_getitem"

    def generic(self, args, kws):
        held, name = args
        if isinstance(held, _HeldType) and isinstance(name, str) and name in held.members:
            return signature(held.members[name][0], *args)
        return None


@lower_builtin("static_getitem", _HeldType, types.Any)
def _lower_item(context, builder, sig, args):
    return context.get_constant_generic(builder, *sig.args[0].members[args[1]])


# -- what the compiler lacks of numpy -----------------------------------------------------------------------


@overload(np.clip)
def _clip(a, a_min, a_max):
    """Of a number: numba has only the one of arrays."""
    if not isinstance(a, NUMBERS):
        return None
    if isinstance(a_min, types.NoneType):
        return lambda a, a_min, a_max: np.minimum(a, a_max)
    if isinstance(a_max, types.NoneType):
        return lambda a, a_min, a_max: np.maximum(a, a_min)
    return lambda a, a_min, a_max: np.minimum(np.maximum(a, a_min), a_max)


@overload(np.heaviside)
def _heaviside(x1, x2):
    if not isinstance(x1, NUMBERS):
        return None
    return lambda x1, x2: np.nan if np.isnan(x1) else (1.0 if x1 > 0 else (x2 * 1.0 if x1 == 0 else 0.0))


@overload(np.polyval)
def _polyval(p, x):
    if not isinstance(x, NUMBERS):
        return None

    def value(p, x):
        total = 0.0
        for coefficient in p:
            total = total * x + coefficient
        return total

    return value
