"""Pixels of four numbers, the fourth unused, as SIMD vectors of eight pixels: one load fetches a pixel."""

from __future__ import annotations

from llvmlite import ir
from numba.core import cgutils, types

from stages.solvers.kernels.simd import COUNT, Lanes, intrinsic, pointer_to, shuffled

_THREE = types.UniTuple(Lanes(types.float32), 3)
_QUAD = ir.VectorType(ir.FloatType(), 4)
_WIDTH = ir.IntType(64)

# Transposition of eight pixels of four numbers to four rows of eight, and back: pairs are interleaved within
# each half of a vector, twice.
_LOW, _HIGH = (0, 8, 1, 9, 4, 12, 5, 13), (2, 10, 3, 11, 6, 14, 7, 15)
_EVEN, _ODD = (0, 1, 8, 9, 4, 5, 12, 13), (2, 3, 10, 11, 6, 7, 14, 15)


@intrinsic
def gather_channels(typingctx, array, pixels, place):
    """Load three channels, a `Lanes` each, of the eight pixels ``pixels[place:place + 8]``.

    The array holds four numbers per pixel, the fourth unused: one load fetches a pixel.
    """

    def emit(context, builder, signature, arguments):
        origin = context.make_array(signature.args[0])(context, builder, arguments[0]).data
        first = pointer_to(context, builder, signature.replace(args=signature.args[1:]), arguments[1:])
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
        first = pointer_to(context, builder, signature.replace(args=signature.args[1:]), arguments[1:])
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
        first = pointer_to(context, builder, signature, arguments)
        quads = [_load_quad(builder, builder.gep(first, [_WIDTH(4 * lane)])) for lane in range(COUNT)]
        return context.make_tuple(builder, signature.return_type, _channels(builder, quads))

    return _THREE(array, place), emit


@intrinsic
def store_channels(typingctx, array, place, red, green, blue):
    """Write three channels of eight pixels, four numbers each; the fourth repeats blue."""

    def emit(context, builder, signature, arguments):
        first, (red, green, blue) = pointer_to(context, builder, signature, arguments), arguments[2:]
        near, far = shuffled(builder, red, green, _LOW), shuffled(builder, red, green, _HIGH)
        near_blue, far_blue = shuffled(builder, blue, blue, _LOW), shuffled(builder, blue, blue, _HIGH)
        pairs = [
            shuffled(builder, near, near_blue, _EVEN),
            shuffled(builder, near, near_blue, _ODD),
            shuffled(builder, far, far_blue, _EVEN),
            shuffled(builder, far, far_blue, _ODD),
        ]
        for lane in range(COUNT):
            half = range(0, 4) if lane < 4 else range(4, 8)
            quad = shuffled(builder, pairs[lane % 4], pairs[lane % 4], half)
            at = builder.gep(first, [_WIDTH(4 * lane)])
            builder.store(quad, builder.bitcast(at, _QUAD.as_pointer()), align=4)
        return context.get_dummy_value()

    return types.void(array, place, red, green, blue), emit


def _load_quad(builder, at):
    return builder.load(builder.bitcast(at, _QUAD.as_pointer()), align=4)


def _channels(builder, quads):
    """Transpose the first three numbers of eight pixels to three vectors of eight."""
    wide = [shuffled(builder, quads[lane], quads[lane + 4], range(8)) for lane in range(4)]
    near, far = shuffled(builder, wide[0], wide[1], _LOW), shuffled(builder, wide[2], wide[3], _LOW)
    near_blue, far_blue = (
        shuffled(builder, wide[0], wide[1], _HIGH),
        shuffled(builder, wide[2], wide[3], _HIGH),
    )
    return [
        shuffled(builder, near, far, _EVEN),
        shuffled(builder, near, far, _ODD),
        shuffled(builder, near_blue, far_blue, _EVEN),
    ]
