"""Wrap, filter, texel centres and colour space of texture reads; decoding; bytes from linear light."""

from __future__ import annotations

import gc
import weakref
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from renderers.drawlist import Image, ImageError, Sampler, Texture, Wrap
from renderers.shading import texels_of
from renderers.shading.memory import address_of
from renderers.shading.sampling import AS_STORED, BYTE_VALUES, SRGB, sample
from renderers.shading.textures import TextureTable
from renderers.shading.transfer import DECODED, GUESSES, THRESHOLDS, decode_gamma, gamma_byte, plain_byte
from tests.renderers.shading_reference import lookup, picture

GAMMA_TABLES = address_of(THRESHOLDS, np.float32), address_of(GUESSES, np.uint8)
DECODED_AT = address_of(DECODED, np.float32)
PIXELS = np.random.default_rng(3).integers(0, 256, (5, 3, 4)).astype(np.uint8)


def read(texture: Texture, u: float, v: float, *, srgb: bool = False) -> np.ndarray:
    table = TextureTable()
    row = table.row(texture)
    integers, floats = table.as_tables()
    assert row == 0
    addresses = address_of(integers, np.int64), address_of(floats, np.float32), address_of(BYTE_VALUES, np.float32)
    return np.array(sample(*addresses, SRGB if srgb else AS_STORED, u, v))


@settings(deadline=None, max_examples=300)
@given(
    u=st.floats(-7.0, 7.0),
    v=st.floats(-7.0, 7.0),
    wrap_s=st.sampled_from(Wrap),
    wrap_t=st.sampled_from(Wrap),
    linear=st.booleans(),
    srgb=st.booleans(),
)
def test_sampling_is_the_specification(
    u: float, v: float, wrap_s: Wrap, wrap_t: Wrap, linear: bool, srgb: bool
) -> None:
    texture = Texture(picture(PIXELS), Sampler(wrap_s, wrap_t, mag_linear=linear))
    got, expected = read(texture, u, v, srgb=srgb), lookup(texture, u, v, srgb)
    if not linear:  # exactly between two texels either is right
        x, y = u * PIXELS.shape[1], v * PIXELS.shape[0]
        if min(abs(x - round(x)), abs(y - round(y))) < 1e-9:
            return
    np.testing.assert_allclose(got, expected, atol=2e-6)


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


def test_an_image_is_decoded_once_and_forgotten_with_it() -> None:
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
    texels = weakref.ref(first.rgba) if first.rgba is not PIXELS else None
    del image, first
    gc.collect()
    assert gone() is None
    assert texels is None or texels() is None


def test_equal_textures_share_a_row() -> None:
    table = TextureTable()
    texture = Texture(picture(PIXELS))
    assert table.row(texture) == table.row(replace(texture)) == 0
    assert table.row(replace(texture, uv_set=1)) == 1


@pytest.mark.parametrize("pixels", [PIXELS[..., :3], PIXELS.astype(np.uint16), PIXELS[:0], PIXELS[0]])
def test_what_is_no_picture_is_refused(pixels: np.ndarray) -> None:
    with pytest.raises(ImageError, match=r"image 'wall' decoded to .* expected \(H, W, 4\) uint8"):
        texels_of(Image(b"x", lambda: pixels, "wall"))


def test_texels_know_whether_they_are_opaque() -> None:
    solid = PIXELS.copy()
    solid[..., 3] = 255
    assert texels_of(picture(solid)).opaque
    solid[2, 1, 3] = 254
    assert not texels_of(picture(solid)).opaque


def test_gamma_bytes_round_the_power() -> None:
    c = np.concatenate((np.random.default_rng(1).random(4000), np.linspace(0, 0.01, 2000), [0, 1])).astype(np.float32)
    got = np.array([gamma_byte(x, *GAMMA_TABLES) for x in c])
    exact = 255 * c.astype(np.float64) ** (1 / 2.2)
    assert (np.abs(got - exact) <= 0.5 + 1e-4).all()
    # Every level is reached right from its threshold on.
    for level in range(1, 256):
        assert gamma_byte(THRESHOLDS[level], *GAMMA_TABLES) == level
        assert gamma_byte(np.nextafter(THRESHOLDS[level], np.float32(0)), *GAMMA_TABLES) == level - 1


def test_plain_bytes_round() -> None:
    for c, byte in ((0.0, 0), (0.5, 128), (1.0, 255), (127.4 / 255, 127), (127.6 / 255, 128)):
        assert plain_byte(np.float32(c)) == byte


@pytest.mark.parametrize(("c", "byte"), [(np.nan, 0), (-1.0, 0), (-np.inf, 0), (7.0, 255), (np.inf, 255)])
def test_bytes_of_odd_values(c: float, byte: int) -> None:
    assert plain_byte(np.float32(c)) == byte
    assert gamma_byte(np.float32(c), *GAMMA_TABLES) == byte


def test_decoding_a_shown_value() -> None:
    c = np.linspace(0, 1, 5001).astype(np.float32)
    got = np.array([decode_gamma(x, DECODED_AT) for x in c])
    np.testing.assert_allclose(got, c.astype(np.float64) ** 2.2, atol=2e-7)
    assert decode_gamma(np.float32(np.nan), DECODED_AT) == 0
    assert decode_gamma(np.float32(2), DECODED_AT) == 1
