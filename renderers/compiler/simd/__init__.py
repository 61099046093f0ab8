"""Vectors of eight lanes for kernels: ``f32x8``, ``f64x8``, ``i32x8`` and the mask ``m8``, Numba types on LLVM vectors.

Kernels use them as ``vec.load(..)``. LLVM lowers them to the registers of the machine: one of AVX2 (two for f64x8), two
or four of SSE2 and NEON. Operators work lane by lane on operands of the same type; comparisons return ``m8``. No
operations are contracted to fused multiply-adds: all machines, and the scalar kernels of the tests, round alike.

Measured on Zen 3 with LLVM 22:

* ``store(p, select(m, new, load(p)))`` becomes a masked store (vpmaskmovd), which is microcoded on Zen 1 to 3: 5 to 15
  times slower. ``load_volatile`` keeps LLVM from recognising the pattern (llvm-project issue 213195, fixed by pull
  request 214187, which llvmlite 0.50 does not have).
* ``gather`` becomes eight scalar loads on Zen, where vgatherdps is slower, and one instruction on Intel.
* ``math.floor`` and ``math.ceil`` of float32 scalars are calls into libm; ``floor`` and ``ceil`` here are one
  instruction.
"""

from __future__ import annotations

from renderers.compiler.simd.arithmetic import (
    absolute,
    ceil,
    count_bits,
    float_bits,
    floor,
    less_unsigned,
    lowest_bit,
    maximum,
    maximum_of,
    minimum,
    minimum_of,
    movemask,
    or_of,
    rint,
    select,
    sqrt,
    to_f32,
    to_f64,
    to_i32,
)
from renderers.compiler.simd.interleaved import (
    load_corners,
    load_elements,
    load_octets,
    load_pairs,
    load_quads,
    load_third,
    store_rgb,
    store_vertices,
)
from renderers.compiler.simd.lanes import (
    compress,
    lane,
    permute,
)
from renderers.compiler.simd.load_store import (
    gather,
    load,
    load_volatile,
    prefetch,
    store,
    store_where,
)
from renderers.compiler.simd.vectors import (
    LANES,
    f32,
    f64,
    i32,
    iota,
)

__all__ = [
    "LANES",
    "absolute",
    "ceil",
    "compress",
    "count_bits",
    "f32",
    "f64",
    "float_bits",
    "floor",
    "gather",
    "i32",
    "iota",
    "lane",
    "less_unsigned",
    "load",
    "load_corners",
    "load_elements",
    "load_octets",
    "load_pairs",
    "load_quads",
    "load_third",
    "load_volatile",
    "lowest_bit",
    "maximum",
    "maximum_of",
    "minimum",
    "minimum_of",
    "movemask",
    "or_of",
    "permute",
    "prefetch",
    "rint",
    "select",
    "sqrt",
    "store",
    "store_rgb",
    "store_vertices",
    "store_where",
    "to_f32",
    "to_f64",
    "to_i32",
]
