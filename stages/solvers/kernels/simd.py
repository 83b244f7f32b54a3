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
_QUAD = ir.VectorType(ir.FloatType(), 4)
_WIDTH = ir.IntType(64)

# Transposition of eight pixels of four numbers to four rows of eight, and back: pairs are interleaved within
# each half of a vector, twice.
_LOW, _HIGH = (0, 8, 1, 9, 4, 12, 5, 13), (2, 10, 3, 11, 6, 14, 7, 15)
_EVEN, _ODD = (0, 1, 8, 9, 4, 5, 12, 13), (2, 3, 10, 11, 6, 7, 14, 15)

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


_THREE = types.UniTuple(Lanes(types.float32), 3)


@intrinsic
def load(typingctx, array, place):
    """Load eight numbers of a flat array from a place on: float32, float64, int8 or int16 (as float32)."""
    narrow = array.dtype in (types.int8, types.int16)
    lanes = Lanes(types.float32 if narrow else array.dtype)

    def emit(context, builder, signature, arguments):
        at = _pointer(context, builder, signature, arguments)
        held = _NARROW[array.dtype.bitwidth] if narrow else _WIDE[lanes.dtype]
        values = builder.load(builder.bitcast(at, held.as_pointer()), align=array.dtype.bitwidth // 8)
        return builder.sitofp(values, _WIDE[lanes.dtype]) if narrow else values

    return lanes(array, place), emit


@intrinsic
def store(typingctx, array, place, lanes):
    """Write eight numbers into a flat array from a place on; rounded to the nearest if it is int16."""
    narrow = array.dtype == types.int16

    def emit(context, builder, signature, arguments):
        at, values = _pointer(context, builder, signature, arguments), arguments[2]
        if narrow:
            shifted = builder.fadd(values, ir.Constant(values.type, [ROUNDING] * COUNT))
            values = builder.trunc(builder.bitcast(shifted, _INT32), _NARROW[16])
        builder.store(values, builder.bitcast(at, values.type.as_pointer()), align=array.dtype.bitwidth // 8)
        return context.get_dummy_value()

    return types.void(array, place, lanes), emit


@intrinsic
def gather_channels(typingctx, array, pixels, place):
    """Load three channels, a `Lanes` each, of the eight pixels ``pixels[place:place + 8]``.

    The array holds four numbers per pixel, the fourth unused: one load fetches a pixel.
    """

    def emit(context, builder, signature, arguments):
        origin = context.make_array(signature.args[0])(context, builder, arguments[0]).data
        first = _pointer(context, builder, signature.replace(args=signature.args[1:]), arguments[1:])
        pixels = [builder.load(builder.gep(first, [_WIDTH(lane)])) for lane in range(COUNT)]
        starts = [builder.shl(builder.zext(pixel, _WIDTH), _WIDTH(2)) for pixel in pixels]
        quads = [_load_quad(builder, builder.gep(origin, [start])) for start in starts]
        return context.make_tuple(builder, signature.return_type, _channels(builder, quads))

    return _THREE(array, pixels, place), emit


@intrinsic
def prefetch_pixels(typingctx, array, pixels, place):
    """Prefetch the eight pixels ``pixels[place:place + 8]`` into the L2 cache; L1 is too small."""

    def emit(context, builder, signature, arguments):
        origin = context.make_array(signature.args[0])(context, builder, arguments[0]).data
        first = _pointer(context, builder, signature.replace(args=signature.args[1:]), arguments[1:])
        byte, number = ir.IntType(8).as_pointer(), ir.IntType(32)
        kind = ir.FunctionType(ir.VoidType(), [byte, number, number, number])
        prefetch = cgutils.get_or_insert_function(builder.module, kind, "llvm.prefetch.p0i8")
        to_read, l2_cache, data = number(0), number(2), number(1)
        for lane in range(COUNT):
            pixel = builder.load(builder.gep(first, [_WIDTH(lane)]))
            at = builder.gep(origin, [builder.shl(builder.zext(pixel, _WIDTH), _WIDTH(2))])
            builder.call(prefetch, [builder.bitcast(at, byte), to_read, l2_cache, data])
        return context.get_dummy_value()

    return types.void(array, pixels, place), emit


@intrinsic
def load_channels(typingctx, array, place):
    """Load three channels, a `Lanes` each, of eight consecutive pixels, four numbers each."""

    def emit(context, builder, signature, arguments):
        first = _pointer(context, builder, signature, arguments)
        quads = [_load_quad(builder, builder.gep(first, [_WIDTH(4 * lane)])) for lane in range(COUNT)]
        return context.make_tuple(builder, signature.return_type, _channels(builder, quads))

    return _THREE(array, place), emit


@intrinsic
def store_channels(typingctx, array, place, red, green, blue):
    """Write three channels of eight pixels, four numbers each; the fourth repeats blue."""

    def emit(context, builder, signature, arguments):
        first, (red, green, blue) = _pointer(context, builder, signature, arguments), arguments[2:]
        near, far = _mixed(builder, red, green, _LOW), _mixed(builder, red, green, _HIGH)
        near_blue, far_blue = _mixed(builder, blue, blue, _LOW), _mixed(builder, blue, blue, _HIGH)
        pairs = [
            _mixed(builder, near, near_blue, _EVEN),
            _mixed(builder, near, near_blue, _ODD),
            _mixed(builder, far, far_blue, _EVEN),
            _mixed(builder, far, far_blue, _ODD),
        ]
        for lane in range(COUNT):
            half = range(0, 4) if lane < 4 else range(4, 8)
            quad = _mixed(builder, pairs[lane % 4], pairs[lane % 4], half)
            at = builder.gep(first, [_WIDTH(4 * lane)])
            builder.store(quad, builder.bitcast(at, _QUAD.as_pointer()), align=4)
        return context.get_dummy_value()

    return types.void(array, place, red, green, blue), emit


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


def _pointer(context, builder, signature, arguments):
    """Compute the address of ``array[place]``, `array` and `place` being the first two arguments."""
    array = context.make_array(signature.args[0])(context, builder, arguments[0])
    return builder.gep(array.data, [arguments[1]])


def _load_quad(builder, at):
    return builder.load(builder.bitcast(at, _QUAD.as_pointer()), align=4)


def _channels(builder, quads):
    """Transpose the first three numbers of eight pixels to three vectors of eight."""
    wide = [_mixed(builder, quads[lane], quads[lane + 4], range(8)) for lane in range(4)]
    near, far = _mixed(builder, wide[0], wide[1], _LOW), _mixed(builder, wide[2], wide[3], _LOW)
    near_blue, far_blue = _mixed(builder, wide[0], wide[1], _HIGH), _mixed(builder, wide[2], wide[3], _HIGH)
    return [
        _mixed(builder, near, far, _EVEN),
        _mixed(builder, near, far, _ODD),
        _mixed(builder, near_blue, far_blue, _EVEN),
    ]


def _mixed(builder, left, right, order):
    """Shuffle the lanes of two vectors; those of the right are numbered after those of the left."""
    lanes = ir.Constant(ir.VectorType(ir.IntType(32), len(order)), list(order))
    return builder.shuffle_vector(left, right, lanes)


def _splat(builder, wide, number):
    first = builder.insert_element(ir.Constant(wide, ir.Undefined), number, ir.Constant(ir.IntType(32), 0))
    return _mixed(builder, first, first, [0] * COUNT)


def _call(builder, name, values):
    function = cgutils.get_or_insert_function(
        builder.module, ir.FunctionType(values.type, [values.type]), name
    )
    return builder.call(function, [values])
