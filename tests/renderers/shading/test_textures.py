"""Wrap, filter, texel centres and colour space of texture reads; decoding; bytes from linear light."""

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
from renderers.compiler.pointers import address_of, f32_at, i32_at, i64_at
from renderers.drawlist import DrawList, Image, ImageError, Instance, Material, Mesh, Sampler, Texture, Wrap
from renderers.interface import Output
from renderers.raster import CpuRenderer
from renderers.raster.frame_threads import FrameThreads
from renderers.shading import texels_of
from renderers.shading.gamma import (
    DECODED,
    ENCODED,
    GAMMA_CELLS,
    THRESHOLDS,
    decode_gamma,
    encode_gamma,
    gamma_pixels,
    plain_byte,
)
from renderers.shading.layout import (
    A_ROWS,
    A_TEXEL,
    A_UV0,
    G_PIXELS,
    G_VALUES,
    S_BYTE_VALUES,
    S_COMMON,
    S_TEXTURE_FLOATS,
    S_TEXTURES,
    STRIDE,
)
from renderers.shading.sampling import sample
from renderers.shading.texture_table import TI_LEVEL, TextureTable
from tests.renderers.shading.reference import lookup, picture
from tests.support.waiting import SECONDS

CELLS = address_of(GAMMA_CELLS, np.int32)
DECODED_AT = address_of(DECODED, np.float32)
ENCODED_AT = address_of(ENCODED, np.float32)
PIXELS = np.random.default_rng(3).integers(0, 256, (5, 3, 4)).astype(np.uint8)


@njit
def _sample(job, segment, row):
    sample(i64_at(job), i64_at(segment), row, 0, 8, A_TEXEL, True)


@njit
def _plain_bytes(values, out, count):
    for k in range(0, count, 8):
        vec.store(i32_at(out), k, plain_byte(vec.load(f32_at(values), k)))


@njit
def _gamma_bytes(values, out, count):
    for k in range(0, count, 8):
        # Three places of a pixel; the others shall not matter.
        value, zero, one = vec.load(f32_at(values), k), vec.f32(0.0), vec.f32(1.0)
        red = gamma_pixels(value, zero, zero, CELLS)
        green = gamma_pixels(zero, value, one, CELLS) ^ vec.i32(0xFF0000)
        blue = gamma_pixels(one, one, value, CELLS) ^ vec.i32(0xFFFF)
        same = (red == (green >> vec.i32(8))) & (red == (blue >> vec.i32(16)))
        vec.store(i32_at(out), k, vec.select(same, red, vec.i32(-1)))


@njit
def _decode_gamma(values, out, count):
    for k in range(0, count, 8):
        vec.store(f32_at(out), k, decode_gamma(vec.load(f32_at(values), k), DECODED_AT))


@njit
def _encode_gamma(values, out, count):
    for k in range(0, count, 8):
        vec.store(f32_at(out), k, encode_gamma(vec.load(f32_at(values), k), ENCODED_AT))


def each(kernel: Callable[[int, int, int], None], values: object, dtype: type[np.generic] = np.int32) -> np.ndarray:
    """A kernel over float32 values, eight at a time."""
    given = np.asarray(values, np.float32).reshape(-1)
    padded = np.resize(given, -(-len(given) // 8) * 8).astype(np.float32)
    out = np.empty(len(padded), dtype)
    kernel(padded.ctypes.data, out.ctypes.data, len(padded))
    return out[: len(given)]


def read_all(texture: Texture, u: np.ndarray, v: np.ndarray, *, srgb: bool = False) -> np.ndarray:
    """(8, 4): the texture at eight coordinates."""
    table = TextureTable()
    row = table.row(texture, srgb)
    integers, floats = table.as_tables()
    job, segment = np.zeros(S_COMMON, np.int64), np.zeros(G_VALUES, np.int64)
    job[S_TEXTURES] = address_of(integers, np.int64)
    job[S_TEXTURE_FLOATS] = address_of(floats, np.float32)
    job[S_BYTE_VALUES] = address_of(LINEAR_FROM_BYTE, np.float32)
    pixels = np.zeros((A_ROWS, STRIDE), np.float32)
    segment[G_PIXELS] = address_of(pixels, np.float32)
    with np.errstate(over="ignore"):
        pixels[A_UV0, :8], pixels[A_UV0 + 1, :8] = u, v
    _sample(job.ctypes.data, segment.ctypes.data, row)
    return pixels[A_TEXEL : A_TEXEL + 4, :8].T


def read(texture: Texture, u: float, v: float, *, srgb: bool = False) -> np.ndarray:
    """(4,): the texture at one coordinate, which any lane reads alike."""
    lanes = read_all(texture, np.full(8, u), np.full(8, v), srgb=srgb)
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
    texture = Texture(picture(PIXELS), Sampler(wrap_s, wrap_t, mag_linear=linear))
    got, expected = read(texture, u, v, srgb=srgb), lookup(texture, u, v, srgb)
    if not linear:  # exactly between two texels either is right
        x, y = u * PIXELS.shape[1], v * PIXELS.shape[0]
        if min(abs(x - round(x)), abs(y - round(y))) < 2e-6:
            return
    np.testing.assert_allclose(got, expected, atol=1e-5)  # the place of a texel is float32


@pytest.mark.parametrize("linear", [True, False])
def test_a_texel_center_reads_that_texel(linear: bool) -> None:
    texture = Texture(picture(PIXELS), Sampler(mag_linear=linear))
    for j in range(5):
        for i in range(3):
            np.testing.assert_allclose(read(texture, (i + 0.5) / 3, (j + 0.5) / 5), PIXELS[j, i] / 255, atol=1e-6)


def test_transformed_coordinates() -> None:
    texture = Texture(picture(PIXELS), uv_transform=(0.5, -1.5, 0.2, 2.0, 0.25, -0.1))
    np.testing.assert_allclose(read(texture, 0.3, 0.7), lookup(texture, 0.3, 0.7, False), atol=1e-6)


@pytest.mark.parametrize("wrap", Wrap)
@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf, 1e300, -1e300, 1e25, 3e9, -3e9])
@pytest.mark.parametrize("linear", [True, False])
def test_any_coordinate_reads_inside_the_image(wrap: Wrap, bad: float, linear: bool) -> None:
    texture = Texture(picture(PIXELS), Sampler(wrap, wrap, mag_linear=linear))
    for u, v in ((bad, 0.5), (0.5, bad), (bad, bad)):
        got = read(texture, u, v)
        assert ((got >= 0) & (got <= 1)).all()


def test_rows_of_a_page_size_are_padded() -> None:
    """Rows are padded so that they do not map to the same cache sets; sampling stays the same."""
    pixels = np.random.default_rng(5).integers(0, 256, (7, 1024, 4)).astype(np.uint8)
    image = picture(pixels)
    texels = texels_of(image)
    assert texels.rows.shape[1] > texels.width == 1024
    np.testing.assert_array_equal(texels.rgba, pixels)
    for linear in (True, False):
        for wrap in Wrap:
            texture = Texture(image, Sampler(wrap, wrap, mag_linear=linear))
            for u, v in ((0.37201, 0.51), (0.99999, 0.93), (-0.0003, 1.2), (0.00001, 0.02)):
                np.testing.assert_allclose(read(texture, u, v), lookup(texture, u, v, False), atol=2e-3)


def test_texels_are_decoded_once_and_collected_with_their_image() -> None:
    calls = 0

    def decode() -> np.ndarray:
        nonlocal calls
        calls += 1
        return PIXELS

    image = Image(b"counted", decode)
    first = texels_of(image)
    assert texels_of(image) is first
    assert calls == 1
    gone = weakref.ref(image)
    texels = weakref.ref(first.rows) if first.rows is not PIXELS else None
    del image, first
    gc.collect()
    assert gone() is None
    assert texels is None or texels() is None


def test_equal_textures_share_a_row() -> None:
    table = TextureTable()
    texture = Texture(picture(PIXELS))
    assert table.row(texture, False) == table.row(replace(texture), False) == 0
    assert table.row(replace(texture, uv_set=1), False) == 1
    assert table.row(texture, True) == 2


@pytest.mark.parametrize("pixels", [PIXELS[..., :3], PIXELS.astype(np.uint16), PIXELS[:0], PIXELS[0]])
def test_rejects_texels_of_wrong_shape_or_dtype(pixels: np.ndarray) -> None:
    with pytest.raises(ImageError, match=r"^decoded to .* expected \(H, W, 4\) uint8"):
        texels_of(Image(b"x", lambda: pixels))


def test_texels_know_whether_they_are_opaque() -> None:
    solid = PIXELS.copy()
    solid[..., 3] = 255
    assert texels_of(picture(solid)).opaque
    solid[2, 1, 3] = 254
    assert not texels_of(picture(solid)).opaque


def test_lanes_are_independent() -> None:
    rng = np.random.default_rng(9)
    for linear in (False, True):
        for wrap in Wrap:
            texture = Texture(picture(PIXELS), Sampler(wrap, wrap, mag_linear=linear))
            u, v = rng.uniform(-3, 3, (2, 8)).astype(np.float32)
            for srgb in (False, True):
                lanes = read_all(texture, u, v, srgb=srgb)
                np.testing.assert_array_equal(lanes, [read(texture, *at, srgb=srgb) for at in zip(u, v, strict=True)])


def test_gamma_bytes_are_exact() -> None:
    c = np.concatenate((np.random.default_rng(1).random(4000), np.linspace(0, 0.01, 2000), [0, 1])).astype(np.float32)
    exact = 255 * c.astype(np.float64) ** (1 / 2.2)
    assert (np.abs(each(_gamma_bytes, c) - exact) <= 0.5 + 1e-4).all()
    # Every level is reached right from its threshold on.
    levels = np.arange(1, 256)
    np.testing.assert_array_equal(each(_gamma_bytes, THRESHOLDS[1:]), levels)
    np.testing.assert_array_equal(each(_gamma_bytes, np.nextafter(THRESHOLDS[1:], np.float32(0))), levels - 1)


def test_plain_bytes_round() -> None:
    assert each(_plain_bytes, (0.0, 0.5, 1.0, 127.4 / 255, 127.6 / 255)).tolist() == [0, 128, 255, 127, 128]


@pytest.mark.parametrize("kernel", [_plain_bytes, _gamma_bytes])
def test_bytes_of_non_finite_and_out_of_range_values(kernel: Callable[[int, int, int], None]) -> None:
    odd = (np.nan, -1.0, -np.inf, 7.0, np.inf, 1e-40, -0.0)
    assert each(kernel, odd).tolist() == [0, 0, 0, 255, 255, 0, 0]


def test_decode_gamma() -> None:
    c = np.linspace(0, 1, 5001).astype(np.float32)
    np.testing.assert_allclose(each(_decode_gamma, c, np.float32), c.astype(np.float64) ** 2.2, atol=2e-7)
    assert each(_decode_gamma, (np.nan, 2.0), np.float32).tolist() == [0, 1]


def test_encode_gamma() -> None:
    c = np.concatenate((np.linspace(0, 1, 5001), 2.0 ** np.linspace(-39, 0, 4001))).astype(np.float32)
    shown = c.astype(np.float64) ** (1 / 2.2)
    np.testing.assert_allclose(each(_encode_gamma, c, np.float32), shown, rtol=2.1e-6)
    assert each(_encode_gamma, (np.nan, 2.0, -1.0, 1e-13), np.float32).tolist() == [0, 1, 0, 0]


def test_new_images_are_decoded_in_parallel() -> None:
    together = threading.Barrier(2, timeout=SECONDS)

    def decode() -> np.ndarray:
        together.wait()  # breaks unless two threads are here
        return PIXELS.copy()

    table = TextureTable()
    textures = [Texture(Image(bytes([k]), decode)) for k in range(2)]
    known = Texture(picture(PIXELS))
    expected = texels_of(known.image)
    for texture in (known, *textures, replace(textures[0], uv_set=1)):
        table.row(texture, False)
    crew = FrameThreads(2)
    try:
        integers, _ = table.as_tables(lambda units, work: crew.run(units, work))
    finally:
        crew.close()
    addresses = integers[:, TI_LEVEL].tolist()
    assert len(addresses) == 4
    assert addresses[0] == address_of(expected.rows, np.uint8)
    assert addresses[1] == addresses[3] != addresses[2]
    assert any(level is expected.rows for level in table.keep)


def test_the_first_error_of_decoding_is_raised() -> None:
    def broken() -> np.ndarray:
        raise ImageError("torn")

    table = TextureTable()
    for k in range(2):
        table.row(Texture(Image(bytes([k]), broken), name=f"wall {k}"), False)
    crew = FrameThreads(2)
    try:
        with pytest.raises(ImageError, match=r"^wall \d: torn$"):
            table.as_tables(lambda units, work: crew.run(units, work))
    finally:
        crew.close()


@pytest.mark.parametrize("wrap", [Wrap.REPEAT, Wrap.CLAMP_TO_EDGE, Wrap.MIRRORED_REPEAT])
@pytest.mark.parametrize("length", [32767, 40_000, 100_000])
@pytest.mark.parametrize("upright", [False, True])
def test_ramps_of_any_length(upright: bool, length: int, wrap: Wrap) -> None:
    """From black to red over a square; longer ones than integers have fractions for."""
    ramp = (np.arange(length) * 255 / (length - 1)).round().astype(np.uint8)
    pixels = np.full((2, length, 4), 255, np.uint8)
    pixels[..., 0] = ramp
    if upright:
        pixels = pixels.swapaxes(0, 1)
    texture = Texture(picture(np.ascontiguousarray(pixels)), Sampler(wrap_s=wrap, wrap_t=wrap))
    corners = np.array(((-1, -1, 2), (1, -1, 2), (1, 1, 2), (-1, 1, 2)), np.float32)
    uv = np.array(((0, 0), (1, 0), (1, 1), (0, 1)), np.float32)
    square = Mesh(corners, np.array(((0, 1, 2), (0, 2, 3)), np.uint32), None, uv)
    drawn = DrawList((Instance(square, Material(base_color_texture=texture, double_sided=True), np.eye(4)),))
    view = Camera(100, 100, 100.0, 100.0, 50.0, 50.0, 0.05, 100.0, np.eye(4))
    with CpuRenderer(1).render(drawn, view, Output.COLOR) as frame:
        assert frame.color is not None
        seen = frame.color[50, :, 0] if not upright else frame.color[:, 50, 0]
        expected = 255 * (np.arange(100) + 0.5) / 100
        assert np.abs(seen - expected).max() <= 1.5
