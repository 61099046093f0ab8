"""Keys of contents."""

from __future__ import annotations

import numpy as np
import pytest

from renderers.contents import quick_key, whole_key

PLACES = 8


@pytest.mark.parametrize("size", [0, 1, 1000, 16 << 10, (16 << 10) + 1, 100_003, 1 << 20])
def test_keys_depend_on_content_only(size: int) -> None:
    data = np.random.default_rng(size).bytes(size)
    moved = memoryview(bytearray(b"xyz" + data))[3:]
    assert quick_key(data) == quick_key(moved) >= 0
    assert whole_key(data) == whole_key(moved) < 0
    assert quick_key(data) != quick_key(data + b"\0")
    assert whole_key(data) != whole_key(data + b"\0")


@pytest.mark.parametrize("size", [1000, 16 << 10, (16 << 10) + 1, 100_003])
def test_bytes_that_quick_key_covers(size: int) -> None:
    data = memoryview(bytearray(size))
    quick, whole = quick_key(data), whole_key(data)
    seen = 0
    for at in range(0, size, 7):
        data[at] = 1
        seen += quick_key(data) != quick
        assert whole_key(data) != whole
        data[at] = 0
    changes = len(range(0, size, 7))
    if size <= 16 << 10:
        assert seen == changes
    else:
        assert seen == pytest.approx(changes * PLACES * 1024 / size, rel=0.02)
    for at in (0, 1023, size - 1024 if size > 1024 else 0, size - 1):
        data[min(at, size - 1)] = 1
        assert quick_key(data) != quick
        data[min(at, size - 1)] = 0
