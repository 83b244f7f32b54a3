"""SIMD vectors of eight numbers for compiled loops over pixels.

The compiler does not vectorise loops over a graph of pixels by itself; these types make the vectors explicit.
Inside ``numba.njit`` functions a `Lanes` value adds, subtracts, multiplies and divides lane by lane like a
number.
"""

from __future__ import annotations

import operator
from collections.abc import Callable
from typing import TYPE_CHECKING, Any, Concatenate, ParamSpec

from llvmlite import ir
from numba.core import cgutils, types
from numba.extending import models, overload, register_model

if TYPE_CHECKING:
    Taken = ParamSpec("Taken")

    # Numba's stubs are wrong here: a call of an intrinsic takes no typing context, and returns a value.
    def intrinsic(function: Callable[Concatenate[Any, Taken], object]) -> Callable[Taken, Any]: ...
else:
    from numba.extending import intrinsic

COUNT = 8  # float32 lanes of AVX2; affects speed, and the order of sums

_WIDE = {
    types.float32: ir.VectorType(ir.FloatType(), COUNT),
    types.float64: ir.VectorType(ir.DoubleType(), COUNT),
}
_NARROW = {bits: ir.VectorType(ir.IntType(bits), COUNT) for bits in (8, 16)}
_INT32 = ir.VectorType(ir.IntType(32), COUNT)

ROUNDING = 1.5 * 2**23  # added to a float32 below 2²², it leaves the nearest integer in the lowest bits


class Lanes(types.Type):
    """Eight numbers of one type, float32 or float64."""

    def __init__(self, dtype):
        self.dtype = dtype
        super().__init__(f"lanes({dtype})")


@register_model(Lanes)
class _LanesModel(models.PrimitiveModel):
    def __init__(self, manager, lanes):
        super().__init__(manager, lanes, _WIDE[lanes.dtype])


@intrinsic
def load(typingctx, array, place):
    """Load eight numbers of a flat array from a place on: float32, float64, int8 or int16 (as float32)."""
    narrow = array.dtype in (types.int8, types.int16)
    lanes = Lanes(types.float32 if narrow else array.dtype)

    def emit(context, builder, signature, arguments):
        at = pointer_to(context, builder, signature, arguments)
        held = _NARROW[array.dtype.bitwidth] if narrow else _WIDE[lanes.dtype]
        values = builder.load(builder.bitcast(at, held.as_pointer()), align=array.dtype.bitwidth // 8)
        return builder.sitofp(values, _WIDE[lanes.dtype]) if narrow else values

    return lanes(array, place), emit


@intrinsic
def store(typingctx, array, place, lanes):
    """Write eight numbers into a flat array from a place on; rounded to the nearest if it is int16."""
    narrow = array.dtype == types.int16

    def emit(context, builder, signature, arguments):
        at, values = pointer_to(context, builder, signature, arguments), arguments[2]
        if narrow:
            shifted = builder.fadd(values, ir.Constant(values.type, [ROUNDING] * COUNT))
            values = builder.trunc(builder.bitcast(shifted, _INT32), _NARROW[16])
        builder.store(values, builder.bitcast(at, values.type.as_pointer()), align=array.dtype.bitwidth // 8)
        return context.get_dummy_value()

    return types.void(array, place, lanes), emit


@intrinsic
def spread(typingctx, number):
    """Broadcast a number to all lanes."""

    def emit(context, builder, signature, arguments):
        return _splat(builder, _WIDE[number], arguments[0])

    return Lanes(number)(number), emit


@intrinsic
def lane_sum(typingctx, lanes):
    """Sum the lanes, in a fixed order."""

    def emit(context, builder, signature, arguments):
        values = [
            builder.extract_element(arguments[0], ir.Constant(ir.IntType(32), lane)) for lane in range(COUNT)
        ]
        while len(values) > 1:
            half = len(values) // 2
            values = [builder.fadd(values[i], values[i + half]) for i in range(half)]
        return values[0]

    return lanes.dtype(lanes), emit


@intrinsic
def clipped(typingctx, lanes, bound):
    """Clip to ``[−bound, bound]``, lane by lane."""

    def emit(context, builder, signature, arguments):
        values, high = arguments
        low = builder.fneg(high)
        values = builder.select(builder.fcmp_ordered("<", values, high), values, high)
        return builder.select(builder.fcmp_ordered(">", values, low), values, low)

    return lanes(lanes, bound), emit


@intrinsic
def magnitude(typingctx, lanes):
    """Take ``|x|`` lane by lane."""

    def emit(context, builder, signature, arguments):
        name = "llvm.fabs.v8f32" if lanes.dtype == types.float32 else "llvm.fabs.v8f64"
        return _call(builder, name, arguments[0])

    return lanes(lanes), emit


@intrinsic
def widened(typingctx, lanes):
    """Convert to float64."""

    def emit(context, builder, signature, arguments):
        return builder.fpext(arguments[0], _WIDE[types.float64])

    return Lanes(types.float64)(lanes), emit


@intrinsic
def where_above(typingctx, tested, bound, then, otherwise):
    """Choose ``then`` in lanes where ``tested > bound``, ``otherwise`` elsewhere."""

    def emit(context, builder, signature, arguments):
        tested, bound, then, otherwise = arguments
        return builder.select(builder.fcmp_ordered(">", tested, bound), then, otherwise)

    return then(tested, bound, then, otherwise), emit


def _arithmetic(function, instruction):
    """Define an operator on two `Lanes`."""

    @intrinsic
    def of_lanes(typingctx, left, right):
        def emit(context, builder, signature, arguments):
            return getattr(builder, instruction)(*arguments, flags=("contract",))

        return left(left, right), emit

    @overload(function, inline="always")
    def _(left, right):
        if isinstance(left, Lanes) and left == right:
            return lambda left, right: of_lanes(left, right)
        return None


for _function, _instruction in (
    (operator.add, "fadd"),
    (operator.sub, "fsub"),
    (operator.mul, "fmul"),
    (operator.truediv, "fdiv"),
):
    _arithmetic(_function, _instruction)


def pointer_to(context, builder, signature, arguments):
    """Compute the address of ``array[place]``, `array` and `place` being the first two arguments."""
    array = context.make_array(signature.args[0])(context, builder, arguments[0])
    return builder.gep(array.data, [arguments[1]])


def shuffled(builder, left, right, order):
    """Shuffle the lanes of two vectors; those of the right are numbered after those of the left."""
    lanes = ir.Constant(ir.VectorType(ir.IntType(32), len(order)), list(order))
    return builder.shuffle_vector(left, right, lanes)


def _splat(builder, wide, number):
    first = builder.insert_element(ir.Constant(wide, ir.Undefined), number, ir.Constant(ir.IntType(32), 0))
    return shuffled(builder, first, first, [0] * COUNT)


def _call(builder, name, values):
    function = cgutils.get_or_insert_function(
        builder.module, ir.FunctionType(values.type, [values.type]), name
    )
    return builder.call(function, [values])
