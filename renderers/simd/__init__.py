"""Eight lanes at a time: ``f32x8``, ``f64x8``, ``i32x8`` and ``m8`` as Numba types on LLVM vectors.

LLVM lowers them to whatever the machine has (AVX2: one register, f64x8 two; SSE2 and NEON: two and four). Operators
work lane by lane on operands of the same type; comparisons give ``m8``. Nothing is ever contracted to fused
multiply-adds, so that all machines, and the scalar kernels of the tests, round alike.

Traps, all measured on Zen 3 with LLVM 22:

* ``store(p, select(m, new, load(p)))`` becomes a masked store (vpmaskmovd), which is microcoded on Zen 1 to 3: 5 to 15
  times slower. ``load_again`` is a volatile load that keeps LLVM from seeing the pattern (llvm-project issue 213195;
  mended by pull request 214187, which llvmlite 0.50 does not have).
* gathers are LLVM's: eight scalar loads and inserts on Zen, where vgatherdps is slower, one instruction on Intel.
* scalar ``math.floor`` and ``ceil`` of float32 are calls into libm; ``floor`` and ``ceil`` here are one instruction.
"""

from __future__ import annotations

from renderers.simd.lookups import float_of, gather_squares, permute, prefetch_squares
from renderers.simd.moves import (
    gather,
    gather_pairs,
    load,
    load_again,
    load_corners,
    load_elements,
    load_third,
    load_triples,
    prefetch,
    scatter,
    store,
    store_quads,
    store_rgb,
    store_vertices,
)
from renderers.simd.vectors import (
    LANES,
    Vector,
    absolute,
    bits,
    bits_of,
    ceil,
    f32,
    f32x8,
    f64,
    f64x8,
    floor,
    i32,
    i32x8,
    iota,
    least,
    least_of,
    lowest_bit,
    m8,
    most,
    most_of,
    rint,
    select,
    spread0,
    spread1,
    spread2,
    spread3,
    spread4,
    spread5,
    spread6,
    spread7,
    sqrt,
    to_f32,
    to_f64,
    to_i32,
)

__all__ = [
    "LANES",
    "Vector",
    "absolute",
    "bits",
    "bits_of",
    "ceil",
    "f32",
    "f32x8",
    "f64",
    "f64x8",
    "float_of",
    "floor",
    "gather",
    "gather_pairs",
    "gather_squares",
    "i32",
    "i32x8",
    "iota",
    "least",
    "least_of",
    "load",
    "load_again",
    "load_corners",
    "load_elements",
    "load_third",
    "load_triples",
    "lowest_bit",
    "m8",
    "most",
    "most_of",
    "permute",
    "prefetch",
    "prefetch_squares",
    "rint",
    "scatter",
    "select",
    "spread0",
    "spread1",
    "spread2",
    "spread3",
    "spread4",
    "spread5",
    "spread6",
    "spread7",
    "sqrt",
    "store",
    "store_quads",
    "store_rgb",
    "store_vertices",
    "to_f32",
    "to_f64",
    "to_i32",
]
