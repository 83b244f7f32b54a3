"""Eight numbers at a time: the vectors that compiled loops over pixels work on.

The compiler does not turn loops over a graph of pixels into vector instructions by itself; with these it
has no choice. Inside ``numba.njit`` functions a `Lanes` value adds, subtracts, multiplies and divides lane
by lane like a number.
"""

from __future__ import annotations

import operator

from llvmlite import ir
from numba.core import cgutils, types
from numba.extending import intrinsic, models, overload, register_model

COUNT = 8

_WIDE = {
    types.float32: ir.VectorType(ir.FloatType(), COUNT),
    types.float64: ir.VectorType(ir.DoubleType(), COUNT),
}
_INT16 = ir.VectorType(ir.IntType(16), COUNT)
_PLACES = ir.VectorType(ir.IntType(32), COUNT)


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
    """The eight numbers of a flat array, float32, float64 or int16 (as float32), from a place on."""
    narrow = array.dtype == types.int16
    lanes = Lanes(types.float32 if narrow else array.dtype)

    def emit(context, builder, signature, arguments):
        at = _pointer(context, builder, signature, arguments)
        held = _INT16 if narrow else _WIDE[lanes.dtype]
        values = builder.load(builder.bitcast(at, held.as_pointer()), align=array.dtype.bitwidth // 8)
        return builder.sitofp(values, _WIDE[lanes.dtype]) if narrow else values

    return lanes(array, place), emit


@intrinsic
def store(typingctx, array, place, lanes):
    """Write eight numbers into a flat array, from a place on; rounded to the nearest where it is int16."""
    narrow = array.dtype == types.int16

    def emit(context, builder, signature, arguments):
        at, values = _pointer(context, builder, signature, arguments), arguments[2]
        if narrow:
            values = builder.fptosi(_call(builder, "llvm.rint.v8f32", values), _INT16)
        builder.store(values, builder.bitcast(at, values.type.as_pointer()), align=array.dtype.bitwidth // 8)
        return context.get_dummy_value()

    return types.void(array, place, lanes), emit


@intrinsic
def gather(typingctx, array, offset, places, place):
    """``array[offset + places[place + i]]`` for the eight lanes i; places are uint32."""
    lanes = Lanes(array.dtype)

    def emit(context, builder, signature, arguments):
        origin = _pointer(context, builder, signature, arguments)
        at = _pointer(context, builder, signature.replace(args=signature.args[2:]), arguments[2:])
        where = builder.load(builder.bitcast(at, _PLACES.as_pointer()), align=4)
        values = ir.Constant(_WIDE[array.dtype], ir.Undefined)
        for lane in range(COUNT):
            number = ir.Constant(ir.IntType(32), lane)
            far = builder.zext(builder.extract_element(where, number), ir.IntType(64))
            values = builder.insert_element(values, builder.load(builder.gep(origin, [far])), number)
        return values

    return lanes(array, offset, places, place), emit


@intrinsic
def spread(typingctx, number):
    """The same number in all lanes."""

    def emit(context, builder, signature, arguments):
        return _splat(builder, _WIDE[number], arguments[0])

    return Lanes(number)(number), emit


@intrinsic
def lane_sum(typingctx, lanes):
    """Sum of the lanes, in an order that never changes."""

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
    """``|x|`` lane by lane."""

    def emit(context, builder, signature, arguments):
        name = "llvm.fabs.v8f32" if lanes.dtype == types.float32 else "llvm.fabs.v8f64"
        return _call(builder, name, arguments[0])

    return lanes(lanes), emit


@intrinsic
def widened(typingctx, lanes):
    """The same numbers as float64."""

    def emit(context, builder, signature, arguments):
        return builder.fpext(arguments[0], _WIDE[types.float64])

    return Lanes(types.float64)(lanes), emit


@intrinsic
def where_above(typingctx, tested, bound, then, otherwise):
    """``then`` in lanes where ``tested > bound``, ``otherwise`` elsewhere."""

    def emit(context, builder, signature, arguments):
        tested, bound, then, otherwise = arguments
        return builder.select(builder.fcmp_ordered(">", tested, bound), then, otherwise)

    return then(tested, bound, then, otherwise), emit


def _arithmetic(function, instruction):
    """Let two `Lanes` meet in an operator."""

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


def _pointer(context, builder, signature, arguments):
    """Where ``array[place]`` lies, `array` and `place` being the first two arguments."""
    array = context.make_array(signature.args[0])(context, builder, arguments[0])
    return builder.gep(array.data, [arguments[1]])


def _splat(builder, wide, number):
    first = builder.insert_element(ir.Constant(wide, ir.Undefined), number, ir.Constant(ir.IntType(32), 0))
    same = ir.Constant(ir.VectorType(ir.IntType(32), COUNT), [0] * COUNT)
    return builder.shuffle_vector(first, first, same)


def _call(builder, name, values):
    function = cgutils.get_or_insert_function(
        builder.module, ir.FunctionType(values.type, [values.type]), name
    )
    return builder.call(function, [values])
