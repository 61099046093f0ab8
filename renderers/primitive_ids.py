"""Which instance a record of the visibility buffer belongs to, for kernels."""

from __future__ import annotations

from renderers.compiler.device_function import inner


@inner
def instance_of(first, count, record, hint):
    """Instance of a record.

    Args:
        first: pointer to (count + 1,) int64, as in ``Visibility.first_record``.
        record: a record number >= 0.
        hint: an instance, tried first: neighbours mostly share theirs.
    """
    if first[hint] <= record and record < first[hint + 1]:
        return hint
    low = 0
    high = count
    while high - low > 1:
        middle = (low + high) >> 1
        if first[middle] <= record:
            low = middle
        else:
            high = middle
    return low
