"""Anti-aliasing of rendered images."""

import threading

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from renderers.fxaa import fxaa
from tests.renderers import scalar_fxaa

WHITE, BLACK = 255, 0


def smoothed(image: NDArray[np.uint8]) -> NDArray[np.uint8]:
    out = np.array(image, order="C")
    fxaa(out)
    return out


def half_plane(slope: float, size: int = 64) -> NDArray[np.uint8]:
    """Return an image that is white above a line through the centre and black below, without anti-aliasing."""
    y, x = np.mgrid[0:size, 0:size] + 0.5 - size / 2
    return np.where((y < slope * x)[..., None], WHITE, BLACK).astype(np.uint8).repeat(3, axis=-1)


def coverage(slope: float, size: int = 64, samples: int = 8) -> NDArray[np.float64]:
    """Return the exact coverage of the same half plane: the mean of many samples per pixel."""
    fine = half_plane(slope, size * samples)[..., 0].astype(float)
    exact: NDArray[np.float64] = fine.reshape(size, samples, size, samples).mean(axis=(1, 3))
    return exact


def test_slanted_edges_approach_their_coverage() -> None:
    for slope in (0.05, 0.11, 0.25, 0.4, 0.9, -0.3, 1.7):
        rough, exact = half_plane(slope), coverage(slope)
        inside = (slice(8, -8), slice(8, -8))
        before = np.abs(rough[..., 0].astype(float) - exact)[inside].mean()
        after = np.abs(smoothed(rough)[..., 0].astype(float) - exact)[inside].mean()
        assert after < 0.7 * before, slope


def test_threads_are_independent() -> None:
    images = [half_plane(slope, 200) for slope in (0.1, 0.2, 0.3, 0.4)]
    expected = [smoothed(image) for image in images]
    results: list[NDArray[np.uint8] | None] = [None] * len(images)

    def work(index: int) -> None:
        for _ in range(20):
            results[index] = smoothed(images[index])

    threads = [threading.Thread(target=work, args=(index,)) for index in range(len(images))]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    for result, wanted in zip(results, expected, strict=True):
        np.testing.assert_array_equal(result, wanted)


@settings(deadline=None, max_examples=50)
@given(st.integers(1, 40), st.integers(1, 40), st.sampled_from([2, 3, 17, 256]), st.integers(0, 2**32 - 1))
def test_equals_the_scalar_reference(height: int, width: int, levels: int, seed: int) -> None:
    rng = np.random.default_rng(seed)
    image = (rng.integers(0, levels, (height, width, 3)) * (255 // (levels - 1))).astype(np.uint8)
    if seed % 2:  # blocks instead of noise: long edges
        image = image[::5, ::7].repeat(5, axis=0).repeat(7, axis=1)[:height, :width]
    expected = np.array(image, order="C")
    scalar_fxaa.fxaa(expected)
    np.testing.assert_array_equal(smoothed(image), expected)
