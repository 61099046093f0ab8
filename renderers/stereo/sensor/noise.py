"""Counter-based random numbers: functions of a key and a counter.

There is no state, so a frame has the same bytes for any number of threads.
"""

from statistics import NormalDist
from typing import Final

import numpy as np
from numpy.typing import NDArray

from renderers.compiler.device_function import inlined
from renderers.compiler.kernel_types import I64, U64, u64
from renderers.splitmix import GAMMA, mix


@inlined
def random64(key: U64, counter: I64) -> U64:
    """Return 64 random bits for a key and a counter."""
    return mix(key + u64(counter) * GAMMA)


def _normal_table() -> NDArray[np.float32]:
    normal = NormalDist()
    table = np.array([normal.inv_cdf((i + 0.5) / 4096) for i in range(4096)])
    scaled: NDArray[np.float32] = (table / table.std()).astype(np.float32)
    return scaled


NORMAL_TABLE: Final = _normal_table()
"""(4096,) float32, quantiles of the standard normal distribution, scaled to unit variance. 12 random bits select
one."""
