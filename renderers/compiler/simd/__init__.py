"""Vectors of eight lanes for kernels: ``f32x8``, ``f64x8``, ``i32x8`` and the mask ``m8``, Numba types on LLVM vectors.

Kernels use them as ``vec.load(..)``. LLVM lowers them to the registers of the machine: one of AVX2 (two for f64x8), two
or four of SSE2 and NEON. Operators work lane by lane on operands of the same type; comparisons return ``m8``. No
operations are contracted to fused multiply-adds: all machines, and the scalar kernels of the tests, round alike.

Measured on Zen 3 with LLVM 22:

* ``store(p, select(m, new, load(p)))`` becomes a masked store (vpmaskmovd), which is microcoded on Zen 1 to 3: 5 to 15
  times slower. ``load_volatile`` keeps LLVM from recognising the pattern (llvm-project issue 213195, fixed by pull
  request 214187, which llvmlite 0.50 does not have).
* ``gather`` is eight scalar loads on AMD, where vgatherdps is slower, and one instruction on Intel.
* ``math.floor`` and ``math.ceil`` of float32 scalars are calls into libm; ``floor`` and ``ceil`` here are one
  instruction.
"""

from renderers.compiler.simd.arithmetic import *
from renderers.compiler.simd.interleaved import *
from renderers.compiler.simd.lanes import *
from renderers.compiler.simd.load_store import *
from renderers.compiler.simd.vectors import *
