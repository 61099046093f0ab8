"""Image files that clients write."""

import resource
from pathlib import Path

import numpy as np
import pytest

from scenegate.camera.files import write_image


@pytest.mark.parametrize("suffix", [".png", ".jpg", ".tiff", ".bmp"])
def test_an_image_that_a_full_disk_cuts_is_removed_and_named(suffix: str, tmp_path: Path) -> None:
    path = tmp_path / f"image{suffix}"
    noise = np.random.default_rng(1).integers(0, 256, (64, 64, 3), np.uint8)
    write_image(path, noise)
    before, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (1000, hard))
    try:
        with pytest.raises(OSError, match="File too large") as refused:
            write_image(path, noise)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (before, hard))
    assert (refused.value.filename, path.exists()) == (str(path), False)


def test_a_suffix_of_no_image_format_is_refused(tmp_path: Path) -> None:
    with pytest.raises(OSError, match="is not an image format"):
        write_image(tmp_path / "image.txt", np.zeros((2, 2), np.uint8))
