"""Comparison with golden images.

``SCENEGATE_REGENERATE_PICTURES=1 pytest ...`` writes the golden images anew. Look at them before committing them.
"""

import os
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

GOLDEN_FOLDER = Path(__file__).parent.parent / "pictures"


def regenerates_golden_images() -> bool:
    """Return True if golden images are to be written instead of compared."""
    return bool(os.environ.get("SCENEGATE_REGENERATE_PICTURES"))


def assert_equal_to_golden(name: str, **arrays: NDArray[Any]) -> None:
    """Assert that arrays equal those of ``tests/pictures/NAME.npz`` bit for bit.

    If golden images are regenerated, write the file and skip the test.
    """
    path = GOLDEN_FOLDER / f"{name}.npz"
    if regenerates_golden_images():
        GOLDEN_FOLDER.mkdir(exist_ok=True)
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
