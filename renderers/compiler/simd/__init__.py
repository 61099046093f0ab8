"""Eight lanes at a time: ``f32x8``, ``f64x8``, ``i32x8`` and ``m8`` as Numba types on LLVM vectors.

LLVM lowers them to whatever the machine has (AVX2: one register, f64x8 two; SSE2 and NEON: two and four). Operators
work lane by lane on operands of the same type; comparisons give ``m8``. Nothing is ever contracted to fused
multiply-adds, so that all machines, and the scalar kernels of the tests, round alike.

Traps, all measured on Zen 3 with LLVM 22:

* ``store(p, select(m, new, load(p)))`` becomes a masked store (vpmaskmovd), which is microcoded on Zen 1 to 3: 5 to 15
  times slower. ``load_volatile`` is a volatile load that keeps LLVM from seeing the pattern (llvm-project issue 213195;
  mended by pull request 214187, which llvmlite 0.50 does not have).
* gathers are LLVM's: eight scalar loads and inserts on Zen, where vgatherdps is slower, one instruction on Intel.
* scalar ``math.floor`` and ``ceil`` of float32 are calls into libm; ``floor`` and ``ceil`` here are one instruction.
"""

from __future__ import annotations

from renderers.compiler.simd.bilinear_quads import (
    SQUARE_VALUES,
    copy_squares,
    load_lines,
    mix_squares,
    prefetch_more_rows,
    prefetch_rows,
)
from renderers.compiler.simd.load_store import (
    compress,
    gather,
    gather_pairs,
    load,
    load_corners,
    load_elements,
    load_octets,
    load_quads,
    load_third,
    load_triples,
    load_vertices,
    load_volatile,
    prefetch,
    scatter,
    store,
    store_quads,
    store_rgb,
    store_rows,
    store_vertices,
    store_where,
)
from renderers.compiler.simd.permute import from_bits, gather_squares, has_compress, mask_of, permute
from renderers.compiler.simd.vectors import (
    LANES,
    Vector,
    absolute,
    broadcast_lane0,
    broadcast_lane1,
    broadcast_lane2,
    broadcast_lane3,
    broadcast_lane4,
    broadcast_lane5,
    broadcast_lane6,
    broadcast_lane7,
    ceil,
    count_bits,
    f32,
    f32x8,
    f64,
    f64x8,
    float_bits,
    floor,
    high_twice,
    highest_bit,
    i32,
    i32x8,
    iota,
    join_halves,
    lane0,
    lane4,
    less_unsigned,
    low_twice,
    lowest_bit,
    m8,
    maximum,
    maximum_of,
    minimum,
    minimum_of,
    movemask,
    rint,
    select,
    sqrt,
    swapped,
    swapped_pairs,
    to_f32,
    to_f64,
    to_i32,
)

__all__ = [
    "LANES",
    "SQUARE_VALUES",
    "Vector",
    "absolute",
    "broadcast_lane0",
    "broadcast_lane1",
    "broadcast_lane2",
    "broadcast_lane3",
    "broadcast_lane4",
    "broadcast_lane5",
    "broadcast_lane6",
    "broadcast_lane7",
    "ceil",
    "compress",
    "copy_squares",
    "count_bits",
    "f32",
    "f32x8",
    "f64",
    "f64x8",
    "float_bits",
    "floor",
    "from_bits",
    "gather",
    "gather_pairs",
    "gather_squares",
    "has_compress",
    "high_twice",
    "highest_bit",
    "i32",
    "i32x8",
    "iota",
    "join_halves",
    "lane0",
    "lane4",
    "less_unsigned",
    "load",
    "load_corners",
    "load_elements",
    "load_lines",
    "load_octets",
    "load_quads",
    "load_third",
    "load_triples",
    "load_vertices",
    "load_volatile",
    "low_twice",
    "lowest_bit",
    "m8",
    "mask_of",
    "maximum",
    "maximum_of",
    "minimum",
    "minimum_of",
    "mix_squares",
    "movemask",
    "permute",
    "prefetch",
    "prefetch_more_rows",
    "prefetch_rows",
    "rint",
    "scatter",
    "select",
    "sqrt",
    "store",
    "store_quads",
    "store_rgb",
    "store_rows",
    "store_vertices",
    "store_where",
    "swapped",
    "swapped_pairs",
    "to_f32",
    "to_f64",
    "to_i32",
]

# TODO: former names, for kernels that are not renamed yet.
least_of = minimum_of
most_of = maximum_of
least = minimum
most = maximum
bits_of = float_bits
bits = movemask
float_of = from_bits
load_again = load_volatile
halves = join_halves
below = less_unsigned
compressed = compress
compresses = has_compress
lanes_in = mask_of
spread0 = broadcast_lane0
spread1 = broadcast_lane1
spread2 = broadcast_lane2
spread3 = broadcast_lane3
spread4 = broadcast_lane4
spread5 = broadcast_lane5
spread6 = broadcast_lane6
spread7 = broadcast_lane7
