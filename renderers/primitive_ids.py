"""Look-up of the instance that a primitive id belongs to, for kernels."""

from __future__ import annotations

from renderers.compiler.device_function import device_function


@device_function
def instance_of(first, count, primitive_id, hint):
    """Return the index of the instance that a primitive belongs to.

    Args:
        first: pointer to (count + 1,) int64, as in ``Visibility.first_ids``.
        primitive_id: >= 0.
        hint: an instance that is tried first: neighbouring pixels mostly share it.
    """
    if first[hint] <= primitive_id and primitive_id < first[hint + 1]:
        return hint
    low = 0
    high = count
    while high - low > 1:
        middle = (low + high) >> 1
        if first[middle] <= primitive_id:
            low = middle
        else:
            high = middle
    return low
