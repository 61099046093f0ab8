"""Four neighbouring texels of each of eight pixels, mixed in 16 bits: all four channels of a pixel side by side."""

from __future__ import annotations

from typing import Any, Final

from llvmlite import ir
from numba import types
from numba.core import cgutils

from renderers.compiler.simd.interleaved import columns_of
from renderers.compiler.simd.load_store import VolatileLoad
from renderers.compiler.simd.vectors import I8, I32, I64, LANES, f32x8, i32x8, insert, intrinsic, shuffle

SQUARE_VALUES: Final = 32
"""Values of four bytes that the texels of eight pixels are."""

_I16: Final = ir.IntType(16)
_BYTES: Final = ir.VectorType(I8, 16)
_WORDS: Final = ir.VectorType(_I16, 16)
_LONGS: Final = ir.VectorType(I64, 4)


def _splat(kind: Any, value: int) -> Any:
    return ir.Constant(kind, [value] * kind.count)


def _indices(builder: Any, pointer: Any, begin: Any) -> list[Any]:
    """Eight int32 behind a pointer as int64, one by one: that is cheaper than taking a vector apart."""
    first = builder.bitcast(builder.gep(pointer, [begin]), I32.as_pointer())
    loads = [VolatileLoad(builder.block, builder.gep(first, [ir.Constant(I64, k)])) for k in range(LANES)]
    for load in loads:  # volatile, or LLVM makes one vector of them and takes it apart
        load.align = 4
        insert(builder, load)
    return [builder.zext(load, I64) for load in loads]


@intrinsic
def copy_squares(typing_context: Any, texels: Any, stride: Any, values: Any, at: Any, to: Any) -> Any:
    """Copy two rows of two texels of each of eight pixels to where ``mix_squares`` reads them.

    Nothing waits for what is loaded here, so that many cache lines are under way at a time. The result means nothing.

    Args:
        texels: pointer to int32. stride: an int64, from a texel to the one below it.
        values: pointer to float32, of which the eight from ``at`` on are the int32 numbers of the upper left texels, at
            least 0, and SQUARE_VALUES from ``to`` on are written.
    """

    def generate(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        texels, stride, values, at, to = args
        rows = texels, builder.gep(texels, [stride])
        out = builder.bitcast(builder.gep(values, [to]), I64.as_pointer())
        for lane, index in enumerate(_indices(builder, values, at)):
            for row in range(2):
                two = builder.bitcast(builder.gep(rows[row], [index]), I64.as_pointer())
                place = builder.gep(out, [ir.Constant(I64, lane % 4 * 4 + row * 2 + lane // 4)])
                builder.store(builder.load(two, align=4), place, align=4)
        return ir.Constant(I32, 0)

    return types.int32(texels, types.int64, values, types.int64, types.int64), generate


def _scaled(builder: Any, context: Any, a: Any, b: Any) -> Any:
    """a * b / 32768, rounded to nearest, ties upwards."""
    if "+avx2" in context.codegen().magic_tuple()[2]:
        declare: Any = cgutils.get_or_insert_function
        kind = ir.FunctionType(_WORDS, [_WORDS, _WORDS])
        return builder.call(declare(builder.module, kind, "llvm.x86.avx2.pmul.hr.sw"), [a, b])
    wide = ir.VectorType(I32, 16)
    product = builder.mul(builder.sext(a, wide), builder.sext(b, wide))
    product = builder.add(builder.ashr(product, _splat(wide, 14)), _splat(wide, 1))
    return builder.trunc(builder.ashr(product, _splat(wide, 1)), _WORDS)


def _packed(builder: Any, context: Any, a: Any, b: Any) -> Any:
    """Bytes of 0 .. 255: the lower halves of both, then the upper ones."""
    whole = ir.VectorType(I8, 32)
    if "+avx2" in context.codegen().magic_tuple()[2]:
        # LLVM makes one register of 64 bytes of the two, and while such are used, a third of the units is not.
        declare: Any = cgutils.get_or_insert_function
        kind = ir.FunctionType(whole, [_WORDS, _WORDS])
        return builder.call(declare(builder.module, kind, "llvm.x86.avx2.packuswb"), [a, b])
    picks = [16 * half + 32 * which + 2 * k for half in range(2) for which in range(2) for k in range(8)]
    return shuffle(builder, builder.bitcast(a, whole), builder.bitcast(b, whole), picks)


@intrinsic
def mix_squares(typing_context: Any, values: Any, at: Any, fx: Any, fy: Any, light: Any, color: Any) -> Any:
    """Eight pixels (i32x8) of four bytes, the first one in the lowest byte: between four texels, times two factors.

    What lies between is rounded to 1/128 of a level twice, and once more after the factors.

    Args:
        values: pointer to float32; ``copy_squares`` has written those from ``at`` on, long enough ago.
        fx, fy, light: i32x8, the share of the right and of the lower texels, and a factor: 0 to 32767 for 0 to 1.
        color: i32x8, four factors in the halves of every two values, as small.
    """

    def generate(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        values, at, fx, fy, light, color = args
        first = builder.bitcast(builder.gep(values, [at]), _BYTES.as_pointer())
        seven = _splat(_WORDS, 7)
        fx, fy, light = (builder.bitcast(value, _WORDS) for value in (fx, fy, light))
        pairs = []
        for k in range(4):  # pixels four apart, so that all shuffles are within the halves of registers
            upper, lower = (
                builder.zext(builder.load(builder.gep(first, [ir.Constant(I64, 2 * k + row)]), align=4), _WORDS)
                for row in range(2)
            )
            share = shuffle(builder, fy, fy, [2 * k] * 8 + [2 * k + 8] * 8)
            step = _scaled(builder, context, builder.shl(builder.sub(lower, upper), seven), share)
            pairs.append(builder.bitcast(builder.add(builder.shl(upper, seven), step), _LONGS))
        color = builder.bitcast(color, _WORDS)
        halves = []
        for k in (0, 2):
            left = builder.bitcast(shuffle(builder, pairs[k], pairs[k + 1], [0, 4, 2, 6]), _WORDS)
            right = builder.bitcast(shuffle(builder, pairs[k], pairs[k + 1], [1, 5, 3, 7]), _WORDS)
            picks = [2 * pixel for pixel in (k, k + 1, k + 4, k + 5) for _ in range(4)]
            share = shuffle(builder, fx, fx, picks)
            value = builder.add(left, _scaled(builder, context, builder.sub(right, left), share))
            factor = _scaled(builder, context, shuffle(builder, light, light, picks), color)
            value = builder.add(_scaled(builder, context, value, factor), _splat(_WORDS, 64))
            halves.append(builder.lshr(value, seven))
        return builder.bitcast(_packed(builder, context, *halves), i32x8.llvm)

    return i32x8(values, types.int64, fx, fy, light, color), generate


@intrinsic
def load_lines(typing_context: Any, planes: Any, values: Any, at: Any, right: Any, down: Any) -> Any:
    """Eight planes along eight lines: sixteen f32x8, the eight values at each line's first pixel and what each further
    pixel adds, one line per lane.

    Args:
        planes: pointer to float32. Those of a line are three times eight: at one pixel, what a step down adds, and what
            a step to the right adds.
        values: pointer to float32: from ``at`` on the int32 numbers of the lines' first values, from ``right`` and
            ``down`` on the steps from that pixel to the line's first.
    """
    out: Any = types.UniTuple(f32x8, 2 * LANES)

    def generate(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        planes, values, at, right, down = args
        starts, slopes = [], []
        for lane, index in enumerate(_indices(builder, values, at)):
            place = builder.bitcast(builder.gep(planes, [index]), f32x8.llvm.as_pointer())
            here, below, beside = (
                builder.load(builder.gep(place, [ir.Constant(I64, row)]), align=4) for row in range(3)
            )
            steps = []
            for first in (right, down):
                step = builder.load(builder.gep(values, [builder.add(first, ir.Constant(I64, lane))]))
                one = builder.insert_element(ir.Constant(f32x8.llvm, ir.Undefined), step, ir.Constant(I32, 0))
                steps.append(shuffle(builder, one, one, [0] * LANES))
            moved = builder.fadd(builder.fmul(steps[1], below), builder.fmul(steps[0], beside))
            starts.append(builder.fadd(here, moved))
            slopes.append(beside)
        columns = columns_of(builder, starts) + columns_of(builder, slopes)
        return context.make_tuple(builder, out, columns)

    return out(planes, values, types.int64, types.int64, types.int64), generate


def _prefetching(lanes: tuple[int, ...]) -> Any:
    def prefetch(typing_context: Any, values: Any, indices: Any, stride: Any) -> Any:
        def generate(context: Any, builder: Any, sig: Any, args: Any) -> Any:
            rows = args[0], builder.gep(args[0], [args[2]])
            byte = I8.as_pointer()
            kind = ir.FunctionType(ir.VoidType(), [byte, I32, I32, I32])
            declare: Any = cgutils.get_or_insert_function
            function = declare(builder.module, kind, "llvm.prefetch.p0")
            read, soon, data = ir.Constant(I32, 0), ir.Constant(I32, 3), ir.Constant(I32, 1)
            for lane in lanes:
                offset = builder.sext(builder.extract_element(args[1], ir.Constant(I32, lane)), I64)
                for row in rows:
                    builder.call(function, [builder.bitcast(builder.gep(row, [offset]), byte), read, soon, data])
            return ir.Constant(I32, 0)

        return types.int32(values, indices, types.int64), generate

    return intrinsic(prefetch)


prefetch_rows = _prefetching((0, LANES - 1))
"""``prefetch_rows(pointer, i32x8, stride)``: fetch the cache lines of the int32 at the first and the last of eight
indices behind a pointer and ``stride`` (an int64) further on. Indices may be anything. The result means nothing."""
prefetch_more_rows = _prefetching((0, 3, 5, LANES - 1))
"""The same of four of the indices."""
