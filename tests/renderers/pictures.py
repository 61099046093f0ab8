"""Golden images. ``SCENEGATE_REGENERATE_PICTURES=1 pytest ...`` writes them; check them before committing."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

FOLDER = Path(__file__).parent.parent / "pictures"


def wanted_anew() -> bool:
    """Return whether to write golden images instead of comparing."""
    return bool(os.environ.get("SCENEGATE_REGENERATE_PICTURES"))


def same_as_golden(name: str, **arrays: NDArray[Any]) -> None:
    """Compare arrays bit for bit with ``tests/pictures/NAME.npz``; write it instead when asked to."""
    path = FOLDER / f"{name}.npz"
    if wanted_anew():
        FOLDER.mkdir(exist_ok=True)
        named: dict[str, Any] = {**arrays}
        np.savez_compressed(path, **named)
        pytest.skip(f"{path.name} was written")
    with np.load(path) as golden:
        assert set(golden.files) == set(arrays)
        for key, array in arrays.items():
            expected = golden[key]
            assert array.dtype == expected.dtype
            assert array.shape == expected.shape
            if array.tobytes() != expected.tobytes():
                different = np.argwhere((array != expected).reshape(*array.shape[:2], -1).any(axis=-1))
                raise AssertionError(
                    f"{name}: {key} differs in {len(different)} pixels, first at row, column {different[0]}: "
                    f"{array[tuple(different[0])]} instead of {expected[tuple(different[0])]}"
                )
