"""Look-up of the instance that a primitive id belongs to, for kernels."""

from renderers.compiler.device_function import device_function
from renderers.compiler.kernel_types import I64, Pointer


@device_function
def instance_of(first_ids: Pointer[I64], instance_count: I64, primitive_id: I64, hint: I64) -> I64:
    """Return the index of the instance that a primitive id, at least 0, belongs to; ``first_ids``: as in
    ``Visibility``.

    The instance ``hint`` is tried first: neighbouring pixels mostly share it.
    """
    if first_ids[hint] <= primitive_id and primitive_id < first_ids[hint + 1]:
        return hint
    low = 0
    high = instance_count
    while high - low > 1:
        middle = (low + high) >> 1
        if first_ids[middle] <= primitive_id:
            low = middle
        else:
            high = middle
    return low
