"""Texture sampling (wrap, filter, texel centres, colour space), decoding of images, and gamma."""

from __future__ import annotations

import gc
import threading
import weakref
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numba import njit

from renderers.camera import Camera
from renderers.color import LINEAR_FROM_BYTE
from renderers.compiler import simd as vec
from renderers.compiler.pointers import address_of, f32_at, i32_at
from renderers.drawlist import DrawList, Image, ImageError, Instance, Material, Mesh, Sampler, Texture, Wrap
from renderers.interface import Output
from renderers.raster import CpuRenderer
from renderers.raster.frame_threads import FrameThreads
from renderers.shading.gamma import (
    GAMMA_CELLS,
    GAMMA_FROM_LINEAR,
    LINEAR_FROM_GAMMA,
    THRESHOLDS,
    byte_from_unit,
    decode_gamma,
    encode_gamma,
)
from renderers.shading.layout import MIP_LEVEL, PIXELS, SEGMENT, SHADING_JOB, TEXTURE
from renderers.shading.level_cells import encoded_pixels
from renderers.shading.sampling import sample
from renderers.shading.texture_table import TextureTable
from renderers.shading.textures import texels_of
from tests.renderers.shading import pixel_reference
from tests.renderers.shading.reference import image_of
from tests.support.waiting import SECONDS

segment_at = SEGMENT.at
CELLS = address_of(GAMMA_CELLS, np.int32)
LINEAR = address_of(LINEAR_FROM_GAMMA, np.float32)
ENCODED = address_of(GAMMA_FROM_LINEAR, np.float32)
TEXELS = np.random.default_rng(3).integers(0, 256, (5, 3, 4)).astype(np.uint8)


@njit
def _sample(segment_address, index):
    segment = segment_at(segment_address)
    sample(segment, index, 8, segment.pixels.texel, True)


@njit
def _plain_bytes(values, out, count):
    for k in range(0, count, 8):
        vec.store(i32_at(out), k, byte_from_unit(vec.load(f32_at(values), k)))


@njit
def _gamma_bytes(values, out, count):
    for k in range(0, count, 8):
        # Each channel by itself; the values of the others do not matter.
        value, zero, one = vec.load(f32_at(values), k), vec.f32(0.0), vec.f32(1.0)
        red = encoded_pixels(value, zero, zero, i32_at(CELLS))
        green = encoded_pixels(zero, value, one, i32_at(CELLS)) ^ vec.i32(0xFF0000)
        blue = encoded_pixels(one, one, value, i32_at(CELLS)) ^ vec.i32(0xFFFF)
        same = (red == (green >> vec.i32(8))) & (red == (blue >> vec.i32(16)))
        vec.store(i32_at(out), k, vec.select(same, red, vec.i32(-1)))


@njit
def _decode_gamma(values, out, count):
    for k in range(0, count, 8):
        vec.store(f32_at(out), k, decode_gamma(vec.load(f32_at(values), k), f32_at(LINEAR)))


@njit
def _encode_gamma(values, out, count):
    for k in range(0, count, 8):
        vec.store(f32_at(out), k, encode_gamma(vec.load(f32_at(values), k), f32_at(ENCODED)))


def apply(kernel: Callable[[int, int, int], None], values: object, dtype: type[np.generic] = np.int32) -> np.ndarray:
    """Return a kernel's results for float32 values, eight at a time."""
    given = np.asarray(values, np.float32).reshape(-1)
    padded = np.resize(given, -(-len(given) // 8) * 8).astype(np.float32)
    out = np.empty(len(padded), dtype)
    kernel(padded.ctypes.data, out.ctypes.data, len(padded))
    return out[: len(given)]


def sample_lanes(texture: Texture, u: np.ndarray, v: np.ndarray, *, srgb: bool = False) -> np.ndarray:
    """Sample a texture at eight coordinates: (8, 4)."""
    table = TextureTable()
    index = table.index_of(texture, srgb)
    textures = table.structs()
    job, segment, pixels = (np.zeros(1, struct.dtype) for struct in (SHADING_JOB, SEGMENT, PIXELS))
    job["textures"] = address_of(textures, TEXTURE.dtype)
    job["linear_from_byte"] = address_of(LINEAR_FROM_BYTE, np.float32)
    segment["job"], segment["pixels"] = address_of(job, SHADING_JOB.dtype), address_of(pixels, PIXELS.dtype)
    uv, texel = (pixels[name][0].reshape(4, -1) for name in ("uv", "texel"))
    with np.errstate(over="ignore"):
        uv[0, :8], uv[1, :8] = u, v
    _sample(address_of(segment, SEGMENT.dtype), index)
    rgba: np.ndarray = texel[:, :8].T
    return rgba


def expected_at(texture: Texture, u: float, v: float, srgb: bool = False) -> np.ndarray:
    """Return what the reference samples at one coordinate: (4,)."""
    rgba: np.ndarray = pixel_reference.sample(texture, np.array(((u, v),), np.float64), srgb)[0]
    return rgba


def sample_one(texture: Texture, u: float, v: float, *, srgb: bool = False) -> np.ndarray:
    """Sample a texture at one coordinate: (4,). All lanes give the same."""
    lanes = sample_lanes(texture, np.full(8, u), np.full(8, v), srgb=srgb)
    first: np.ndarray = lanes[0]
    assert (lanes == first).all()
    return first


@settings(deadline=None, max_examples=300)
@given(
    u=st.floats(-7.0, 7.0, width=32),
    v=st.floats(-7.0, 7.0, width=32),
    wrap_s=st.sampled_from(Wrap),
    wrap_t=st.sampled_from(Wrap),
    linear=st.booleans(),
    srgb=st.booleans(),
)
def test_sampling_matches_the_reference(
    u: float, v: float, wrap_s: Wrap, wrap_t: Wrap, linear: bool, srgb: bool
) -> None:
    texture = Texture(image_of(TEXELS), Sampler(wrap_s, wrap_t, mag_linear=linear))
    actual, expected = sample_one(texture, u, v, srgb=srgb), expected_at(texture, u, v, srgb)
    if not linear:  # exactly between two texels, either is right
        x, y = u * TEXELS.shape[1], v * TEXELS.shape[0]
        if min(abs(x - round(x)), abs(y - round(y))) < 2e-6:
            return
    np.testing.assert_allclose(actual, expected, atol=1e-5)  # positions of texels are float32


@pytest.mark.parametrize("linear", [True, False])
def test_a_texel_center_reads_that_texel(linear: bool) -> None:
    texture = Texture(image_of(TEXELS), Sampler(mag_linear=linear))
    for j in range(5):
        for i in range(3):
            np.testing.assert_allclose(sample_one(texture, (i + 0.5) / 3, (j + 0.5) / 5), TEXELS[j, i] / 255, atol=1e-6)


def test_transformed_coordinates() -> None:
    texture = Texture(image_of(TEXELS), uv_transform=(0.5, -1.5, 0.2, 2.0, 0.25, -0.1))
    np.testing.assert_allclose(sample_one(texture, 0.3, 0.7), expected_at(texture, 0.3, 0.7), atol=1e-6)


@pytest.mark.parametrize("wrap", Wrap)
@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf, 1e300, -1e300, 1e25, 3e9, -3e9])
@pytest.mark.parametrize("linear", [True, False])
def test_any_coordinate_reads_inside_the_image(wrap: Wrap, bad: float, linear: bool) -> None:
    texture = Texture(image_of(TEXELS), Sampler(wrap, wrap, mag_linear=linear))
    for u, v in ((bad, 0.5), (0.5, bad), (bad, bad)):
        rgba = sample_one(texture, u, v)
        assert ((rgba >= 0) & (rgba <= 1)).all()


def test_rows_of_a_page_size_are_padded() -> None:
    """Rows are padded so that they do not map to the same cache sets; sampling stays the same."""
    pixels = np.random.default_rng(5).integers(0, 256, (7, 1024, 4)).astype(np.uint8)
    image = image_of(pixels)
    texels = texels_of(image)
    assert texels.rows.shape[1] > texels.width == 1024
    np.testing.assert_array_equal(texels.rgba, pixels)
    for linear in (True, False):
        for wrap in Wrap:
            texture = Texture(image, Sampler(wrap, wrap, mag_linear=linear))
            for u, v in ((0.37201, 0.51), (0.99999, 0.93), (-0.0003, 1.2), (0.00001, 0.02)):
                np.testing.assert_allclose(sample_one(texture, u, v), expected_at(texture, u, v), atol=2e-3)


def test_texels_are_decoded_once_and_collected_with_their_image() -> None:
    calls = 0

    def decode() -> np.ndarray:
        nonlocal calls
        calls += 1
        return TEXELS

    image = Image(b"counted", decode)
    first = texels_of(image)
    assert texels_of(image) is first
    assert calls == 1
    gone = weakref.ref(image)
    texels = weakref.ref(first.rows) if first.rows is not TEXELS else None
    del image, first
    gc.collect()
    assert gone() is None
    assert texels is None or texels() is None


def test_equal_textures_share_a_struct() -> None:
    table = TextureTable()
    texture = Texture(image_of(TEXELS))
    assert table.index_of(texture, False) == table.index_of(replace(texture), False) == 0
    assert table.index_of(replace(texture, uv_set=1), False) == 1
    assert table.index_of(texture, True) == 2


@pytest.mark.parametrize("pixels", [TEXELS[..., :3], TEXELS.astype(np.uint16), TEXELS[:0], TEXELS[0]])
def test_rejects_texels_of_wrong_shape_or_dtype(pixels: np.ndarray) -> None:
    with pytest.raises(ImageError, match=r"^decoded to .* expected \(H, W, 4\) uint8"):
        texels_of(Image(b"x", lambda: pixels))


def test_opaque_texels() -> None:
    solid = TEXELS.copy()
    solid[..., 3] = 255
    assert texels_of(image_of(solid)).opaque
    solid[2, 1, 3] = 254
    assert not texels_of(image_of(solid)).opaque


def test_lanes_are_independent() -> None:
    rng = np.random.default_rng(9)
    for linear in (False, True):
        for wrap in Wrap:
            texture = Texture(image_of(TEXELS), Sampler(wrap, wrap, mag_linear=linear))
            u, v = rng.uniform(-3, 3, (2, 8)).astype(np.float32)
            for srgb in (False, True):
                lanes = sample_lanes(texture, u, v, srgb=srgb)
                np.testing.assert_array_equal(
                    lanes, [sample_one(texture, *at, srgb=srgb) for at in zip(u, v, strict=True)]
                )


def test_gamma_bytes_are_exact() -> None:
    c = np.concatenate((np.random.default_rng(1).random(4000), np.linspace(0, 0.01, 2000), [0, 1])).astype(np.float32)
    exact = 255 * c.astype(np.float64) ** (1 / 2.2)
    assert (np.abs(apply(_gamma_bytes, c) - exact) <= 0.5 + 1e-4).all()
    # Every level begins at its threshold.
    levels = np.arange(1, 256)
    np.testing.assert_array_equal(apply(_gamma_bytes, THRESHOLDS[1:]), levels)
    np.testing.assert_array_equal(apply(_gamma_bytes, np.nextafter(THRESHOLDS[1:], np.float32(0))), levels - 1)


def test_plain_bytes_round() -> None:
    assert apply(_plain_bytes, (0.0, 0.5, 1.0, 127.4 / 255, 127.6 / 255)).tolist() == [0, 128, 255, 127, 128]


@pytest.mark.parametrize("kernel", [_plain_bytes, _gamma_bytes])
def test_bytes_of_non_finite_and_out_of_range_values(kernel: Callable[[int, int, int], None]) -> None:
    values = (np.nan, -1.0, -np.inf, 7.0, np.inf, 1e-40, -0.0)
    assert apply(kernel, values).tolist() == [0, 0, 0, 255, 255, 0, 0]


def test_decode_gamma() -> None:
    c = np.linspace(0, 1, 5001).astype(np.float32)
    np.testing.assert_allclose(apply(_decode_gamma, c, np.float32), c.astype(np.float64) ** 2.2, atol=2e-7)
    assert apply(_decode_gamma, (np.nan, 2.0), np.float32).tolist() == [0, 1]


def test_encode_gamma() -> None:
    c = np.concatenate((np.linspace(0, 1, 5001), 2.0 ** np.linspace(-39, 0, 4001))).astype(np.float32)
    encoded = c.astype(np.float64) ** (1 / 2.2)
    np.testing.assert_allclose(apply(_encode_gamma, c, np.float32), encoded, rtol=2.1e-6)
    assert apply(_encode_gamma, (np.nan, 2.0, -1.0, 1e-13), np.float32).tolist() == [0, 1, 0, 0]


def test_new_images_are_decoded_in_parallel() -> None:
    barrier = threading.Barrier(2, timeout=SECONDS)

    def decode() -> np.ndarray:
        barrier.wait()  # breaks unless two threads wait
        return TEXELS.copy()

    table = TextureTable()
    textures = [Texture(Image(bytes([k]), decode)) for k in range(2)]
    cached = Texture(image_of(TEXELS))
    expected = texels_of(cached.image)
    for texture in (cached, *textures, replace(textures[0], uv_set=1)):
        table.index_of(texture, False)
    crew = FrameThreads(2)
    try:
        table.structs(lambda units, work: crew.run(units, work))
    finally:
        crew.close()
    addresses = [array["texels"][0] for array in table.keep if array.dtype == MIP_LEVEL.dtype]
    assert len(addresses) == 4
    assert addresses[0] == address_of(expected.rows, np.uint8)
    assert addresses[1] == addresses[3] != addresses[2]
    assert any(level is expected.rows for level in table.keep)


def test_the_first_error_of_decoding_is_raised() -> None:
    def broken() -> np.ndarray:
        raise ImageError("torn")

    table = TextureTable()
    for k in range(2):
        table.index_of(Texture(Image(bytes([k]), broken), name=f"wall {k}"), False)
    crew = FrameThreads(2)
    try:
        with pytest.raises(ImageError, match=r"^wall \d: torn$"):
            table.structs(lambda units, work: crew.run(units, work))
    finally:
        crew.close()


@pytest.mark.parametrize("wrap", [Wrap.REPEAT, Wrap.CLAMP_TO_EDGE, Wrap.MIRRORED_REPEAT])
@pytest.mark.parametrize("length", [32767, 40_000, 100_000])
@pytest.mark.parametrize("upright", [False, True])
def test_ramps_of_any_length(upright: bool, length: int, wrap: Wrap) -> None:
    """From black to red over a square, also of more texels than 16 bits can count."""
    ramp = (np.arange(length) * 255 / (length - 1)).round().astype(np.uint8)
    pixels = np.full((2, length, 4), 255, np.uint8)
    pixels[..., 0] = ramp
    if upright:
        pixels = pixels.swapaxes(0, 1)
    texture = Texture(image_of(np.ascontiguousarray(pixels)), Sampler(wrap, wrap, mipmaps=False))
    corners = np.array(((-1, -1, 2), (1, -1, 2), (1, 1, 2), (-1, 1, 2)), np.float32)
    uv = np.array(((0, 0), (1, 0), (1, 1), (0, 1)), np.float32)
    square = Mesh(corners, np.array(((0, 1, 2), (0, 2, 3)), np.uint32), None, uv)
    scene = DrawList((Instance(square, Material(base_color_texture=texture, double_sided=True), np.eye(4)),))
    view = Camera(100, 100, 100.0, 100.0, 50.0, 50.0, 0.05, 100.0, np.eye(4))
    with CpuRenderer(1).render(scene, view, Output.COLOR) as frame:
        assert frame.color is not None
        row = frame.color[50, :, 0] if not upright else frame.color[:, 50, 0]
        expected = 255 * (np.arange(100) + 0.5) / 100
        assert np.abs(row - expected).max() <= 1.5
