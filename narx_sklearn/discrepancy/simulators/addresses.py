"""Compiled functions by where they lie, and arrays by where they begin: how the kernel is handed both.

The right-hand side, the output and the forces of the effects enter by their addresses, as functions of one
signature each, so the kernel that calls them is compiled once (in two forms) and kept on disk, and only the
user's own few lines are compiled anew. (numba takes functions as arguments too, but looks each of them up at
every call, which costs as much as the run of a thousand samples.)

What a kernel that is kept on disk calls from here it does not see change: it is compiled anew when its own
file is.
"""

from functools import cache, lru_cache
from typing import Any

from numba import carray, njit, types
from numba.core import cgutils
from numba.core.errors import NumbaError
from numba.extending import intrinsic

from narx_sklearn.physics.effects._effect import MAX_MEMORY

MAX_THETA = 24  # parameters of one effect; the last one is the share that spills onward
ADDRESSES_KEPT = 256

POINTER = types.CPointer(types.float64)
EQUATION = types.void(*[POINTER] * 4, *[types.intp] * 4)
"""Signature of a right-hand side and of an output: where ``x, u, p, written`` lie, and their lengths.

An output of rates too finds them after the states, as the second half of ``x``. (Arrays would be handed over
with all they know of themselves, at the price of many lines of arithmetic.)
"""

FORCE = types.float64(*[types.float64] * 6, *[POINTER] * 3)
"""Signature of an effect's force: ``(argument, rate, own, second, time, step, z, theta, written dz)``."""


def _function_at(kind, address):
    """Return the numba code of the function of a kind that lies at an address."""

    def generate(context, builder, signature, arguments):
        pointer = builder.inttoptr(arguments[0], context.get_value_type(types.voidptr))
        function = cgutils.create_struct_proxy(kind)(context, builder)
        function.c_addr = pointer  # only looked at when there is no compiled address
        function.jit_addr = pointer
        return function._getvalue()

    return kind(address), generate


# numba gives a value in the place of the first argument, the typing context
equation_at: Any = intrinsic(lambda context, address: _function_at(types.FunctionType(EQUATION), address))
force_at: Any = intrinsic(lambda context, address: _function_at(types.FunctionType(FORCE), address))


def _pointer_to(vector):
    """Return the type and the numba code of the pointer to the first value of a vector."""

    def generate(context, builder, signature, arguments):
        return context.make_array(vector)(context, builder, arguments[0]).data

    return types.CPointer(vector.dtype)(vector), generate


def _pointer_to_row(matrix, index):
    """Return the type and the numba code of the pointer to a row of a C-contiguous matrix."""

    def generate(context, builder, signature, arguments):
        values = context.make_array(matrix)(context, builder, arguments[0])
        row_size = builder.extract_value(values.shape, 1)
        return builder.gep(values.data, [builder.mul(arguments[1], row_size)])

    return types.CPointer(matrix.dtype)(matrix, types.intp), generate


_pointer: Any = intrinsic(lambda context, vector: _pointer_to(vector))
row_pointer: Any = intrinsic(lambda context, matrix, index: _pointer_to_row(matrix, index))


def _lent(arrays):
    """Return the type and the numba code of a tuple of arrays without what counts their owners."""

    def generate(context, builder, signature, arguments):
        lent = []
        for k, kind in enumerate(arrays):
            array = context.make_array(kind)(context, builder, builder.extract_value(arguments[0], k))
            array.meminfo = cgutils.get_null_value(array.meminfo.type)
            array.parent = cgutils.get_null_value(array.parent.type)
            lent.append(array._getvalue())
        return context.make_tuple(builder, signature.return_type, lent)

    return arrays(arrays), generate


borrowed: Any = intrinsic(lambda context, arrays: _lent(arrays))


@njit(nogil=True)
def keep(arrays):
    """Let arrays live until here, of which others are borrowed."""


@njit(nogil=True, inline="always")
def row_of(matrix, index):
    """Return a row that does not keep its matrix alive: counting owners costs more than most forces do."""
    return carray(row_pointer(matrix, index), (matrix.shape[1],))


@njit(nogil=True, inline="always")
def write(equation, x, u, p, written):
    """Let an equation write its values for these arguments."""
    equation(_pointer(x), _pointer(u), _pointer(p), _pointer(written), x.size, u.size, p.size, written.size)


@njit(nogil=True, cache=True)
def write_values(equation_address, x, u, p, written):
    """Let the equation at an address write its values for these arguments."""
    write(equation_at(equation_address), x, u, p, written)


@lru_cache(maxsize=ADDRESSES_KEPT)
def equation_address(function) -> int:
    """Return where a compiled right-hand side or output lies, as long as it lives."""
    return _address(function, EQUATION)


@cache
def compiled_force(function: Any):
    """Return an effect's force compiled: from disk when it was declared so, else anew."""
    if hasattr(function, "py_func"):
        return function
    return njit(nogil=True, error_model="numpy")(function)


@cache
def _pointed_at(function: Any):
    """Return an effect's force compiled for the kernel, which tells it only where its arrays begin.

    One that asks them for more than their values (a slice, a size) gets whole arrays made of them first.
    """
    force = compiled_force(function)
    try:
        force.compile(FORCE.args)
    except NumbaError:

        def called(argument, rate, own, second, time, step, z, theta, dz):
            memory, change = carray(z, (MAX_MEMORY,)), carray(dz, (MAX_MEMORY,))
            return force(argument, rate, own, second, time, step, memory, carray(theta, (MAX_THETA,)), change)

        return njit(FORCE, nogil=True, error_model="numpy")(called)
    return force


@cache
def force_address(function) -> int:
    """Return where an effect's force lies, compiled for the kernel."""
    return _address(_pointed_at(function), FORCE)


def _address(function, signature) -> int:
    found = function.get_compile_result(signature)
    return found.library.get_pointer_to_function(found.fndesc.llvm_func_name)
