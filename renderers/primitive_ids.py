"""Look-up of the instance that a primitive id belongs to, for kernels."""

from __future__ import annotations

from renderers.compiler.device_function import device_function


@device_function
def instance_of(first_ids, instance_count, primitive_id, hint):
    """Return the index of the instance that a primitive belongs to.

    Args:
        first_ids: pointer to (instance_count + 1,) int64, as in ``Visibility.first_ids``.
        primitive_id: >= 0.
        hint: index of the instance that is tried first; neighbouring pixels mostly share it.
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
