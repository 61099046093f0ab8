"""Texture sampling (wrap, filter, texel centres, colour space), decoding of images, and gamma."""

import gc
import threading
import weakref
from dataclasses import replace

import numpy as np
import pytest

from renderers.camera import Camera
from renderers.color import srgb_values_from_linear
from renderers.drawlist import DrawList, Image, ImageError, Instance, Material, Mesh, Sampler, Texture, Wrap
from renderers.interface import Look, LookName, Output
from renderers.raster import CpuRenderer
from renderers.raster.frame_threads import FrameThreads
from renderers.shading.scene import prepare
from renderers.shading.texture_table import TextureTable
from renderers.shading.textures import empty_rows, level_row, set_level, texels_of
from tests.renderers.shading.reference import image_of
from tests.renderers.shading.test_pixels import assert_within_a_level
from tests.support.waiting import SECONDS

TEXELS = np.random.default_rng(3).integers(0, 256, (5, 3, 4)).astype(np.uint8)
TEXELS[..., 3] = 255
CORNERS = np.array(((0, 0), (1, 0), (1, 1), (0, 1)), np.float32)
"""Texture coordinates of the corners of a square."""


def square(width: int, height: int) -> tuple[Mesh, Camera]:
    """Return a square with texture coordinates 0 .. 1, and the camera whose image it fills."""
    corners = np.array(((-1, -1, 2), (1, -1, 2), (1, 1, 2), (-1, 1, 2)), np.float32)
    mesh = Mesh(corners, np.array(((0, 1, 2), (0, 2, 3)), np.uint32), None, CORNERS)
    return mesh, Camera(width, height, width, height, width / 2, height / 2, 0.05, 100.0, np.eye(4))


def drawn(mesh: Mesh, material: Material, view: Camera, look: LookName, threads: int = 1) -> np.ndarray:
    """Return the colours of an unlit mesh, (H, W, 3)."""
    scene = DrawList((Instance(mesh, replace(material, unlit=True, double_sided=True), np.eye(4)),))
    renderer = CpuRenderer(threads)
    frame = renderer.render(scene, view, Output.COLOR, Look(look))
    color: np.ndarray = frame.color.copy()
    renderer.close()
    return color


@pytest.mark.parametrize("look", ["plain", "gltf"])
@pytest.mark.parametrize("linear", [True, False])
@pytest.mark.parametrize("size", [(5, 3), (7, 1024)], ids=["small", "rows of a page"])
def test_sampling_matches_the_reference(size: tuple[int, int], linear: bool, look: LookName) -> None:
    """Coordinates of several images in any direction, with and without a transform of their own."""
    rng = np.random.default_rng(4)
    pixels = rng.integers(0, 256, (*size, 4)).astype(np.uint8)
    pixels[..., 3] = 255
    image = image_of(pixels)
    mesh, view = square(83, 61)
    for wrap_s in Wrap:
        for wrap_t in Wrap:
            for uv_transform in (None, (0.5, -1.5, 0.2, 2.0, 0.25, -0.1)):
                sampler = Sampler(wrap_s, wrap_t, linear, linear, mipmaps=False)
                texture = Texture(image, sampler, uv_transform=uv_transform)
                uv = (rng.uniform(-4, 4, 2) + CORNERS @ rng.uniform(-3, 3, (2, 2))).astype(np.float32)
                material = Material(base_color_texture=texture, unlit=True, double_sided=True)
                scene = DrawList((Instance(replace(mesh, uv0=uv), material, np.eye(4)),))
                # Exactly between two texels, either is right.
                assert_within_a_level(scene, view, Look(look), exceptions=0 if linear else 30)


@pytest.mark.parametrize("linear", [True, False])
def test_a_texel_center_reads_that_texel(linear: bool) -> None:
    texture = Texture(image_of(TEXELS), Sampler(mag_linear=linear, min_linear=linear, mipmaps=False))
    color = drawn(*_with(texture, square(3, 5)), "plain")
    np.testing.assert_array_equal(color, TEXELS[..., :3])


def _with(texture: Texture, where: tuple[Mesh, Camera]) -> tuple[Mesh, Material, Camera]:
    return where[0], Material(base_color_texture=texture), where[1]


@pytest.mark.parametrize("wrap", Wrap)
@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf, 1e38, -1e38, 1e25, 3e9, -3e9])
@pytest.mark.parametrize("linear", [True, False])
def test_any_coordinate_reads_inside_the_image(wrap: Wrap, bad: float, linear: bool) -> None:
    pixels = (100 + TEXELS % 50).astype(np.uint8)
    pixels[..., 3] = 255
    texture = Texture(image_of(pixels), Sampler(wrap, wrap, linear, linear, mipmaps=False))
    mesh, view = square(9, 5)
    for u, v in ((bad, 0.5), (0.5, bad), (bad, bad)):
        uv = np.tile(np.array((u, v), np.float32), (4, 1))
        color = drawn(replace(mesh, uv0=uv), Material(base_color_texture=texture), view, "plain")
        assert 100 <= color.min() <= color.max() < 150


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


@pytest.mark.parametrize("pixels", [TEXELS[..., :2], TEXELS.astype(np.uint16), TEXELS[:0], TEXELS[0]])
def test_rejects_texels_of_wrong_shape_or_dtype(pixels: np.ndarray) -> None:
    with pytest.raises(ImageError, match=r"^decoded to .* expected \(H, W, 3 \| 4\) uint8"):
        texels_of(Image(b"x", lambda: pixels))


@pytest.mark.parametrize("size", [(1, 1), (1, 5), (5, 1), (3, 4)])
def test_rgb_images_are_opaque(size: tuple[int, int]) -> None:
    pixels = np.random.default_rng(0).integers(0, 256, (*size, 3), np.uint8)
    texels = texels_of(Image(b"rgb", lambda: pixels))
    height, width = size
    assert texels.opaque
    assert not texels.translucent
    np.testing.assert_array_equal(texels.rows[:height, :width], np.dstack((pixels, np.full(size, 255, np.uint8))))
    np.testing.assert_array_equal(texels.rows[:height, width], texels.rows[:height, 0])


def test_opaque_texels() -> None:
    solid = TEXELS.copy()
    solid[..., 3] = 255
    assert texels_of(image_of(solid)).opaque
    solid[2, 1, 3] = 254
    assert not texels_of(image_of(solid)).opaque


@pytest.mark.parametrize("end", [1.0, 0.01])
def test_encoded_bytes_are_exact(end: float) -> None:
    """Of a ramp from 0: every byte is the nearest to the exact value."""
    mesh, view = square(512, 16)
    colors = np.array(((0, 0, end, 1), (end, 0, 0, 1), (end, 0, 0, 1), (0, 0, end, 1)), np.float32)
    x = (np.arange(512) + 0.5) / 512
    linear = np.stack((end * x, 0 * x, end * (1 - x)), axis=-1)
    color = drawn(replace(mesh, colors=colors), Material(), view, "gltf")
    assert (np.abs(color - 255 * linear ** (1 / 2.2)) <= 0.5 + 2e-3).all()
    color = drawn(replace(mesh, colors=colors), Material(), view, "phong")
    assert (np.abs(color - 255 * linear) <= 0.5 + 1e-3).all()
    color = drawn(replace(mesh, colors=colors), Material(), view, "studio")
    assert (np.abs(color - 255 * srgb_values_from_linear(linear)) <= 0.5 + 2e-3).all()


def test_vertex_colors_decoded_as_by_vtk_are_exact() -> None:
    mesh, view = square(512, 16)
    colors = np.array(((0, 1, 0, 1), (1, 1, 0, 1), (1, 1, 0, 1), (0, 1, 0, 1)), np.float32)
    color = drawn(replace(mesh, colors=colors), Material(), view, "pbr")
    # Raised to 2.2, and encoded again.
    assert (np.abs(color[..., 0] - 255 * (np.arange(512) + 0.5) / 512) <= 0.5 + 2e-3).all()
    assert (color[..., 1:] == (255, 0)).all()


@pytest.mark.parametrize("look", ["phong", "gltf", "studio"])
@pytest.mark.parametrize(
    ("value", "byte"),
    [(0.0, 0), (-0.0, 0), (1.0, 255), (np.nan, 0), (-1.0, 0), (-np.inf, 0), (7.0, 255), (np.inf, 255), (1e-40, 0)],
)
def test_bytes_of_values_at_and_beyond_the_limits(look: LookName, value: float, byte: int) -> None:
    mesh, view = square(9, 5)
    for channel in range(3):
        factors = [1.0, 1.0, 1.0, 1.0]
        factors[channel] = value
        color = drawn(mesh, Material(base_color=(factors[0], factors[1], factors[2], 1.0)), view, look)
        assert (color[..., channel] == byte).all()
        assert (np.delete(color, channel, axis=-1) == 255).all()


def test_new_images_are_decoded_in_parallel() -> None:
    barrier = threading.Barrier(2, timeout=SECONDS)

    def decode() -> np.ndarray:
        barrier.wait()  # breaks unless two threads wait
        return TEXELS.copy()

    mesh, view = square(9, 5)
    textures = [Texture(Image(bytes([k]), decode)) for k in range(2)]
    known = Texture(image_of(TEXELS))
    expected = drawn(mesh, Material(base_color_texture=known), view, "plain")
    for texture in (known, *textures):
        instances = tuple(
            Instance(mesh, Material(base_color_texture=each, unlit=True, double_sided=True), np.eye(4))
            for each in (texture, *textures)
        )
        renderer = CpuRenderer(2)
        frame = renderer.render(DrawList(instances), view, Output.COLOR, Look("plain"))
        np.testing.assert_array_equal(frame.color, expected)
        renderer.close()


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
    mesh, view = square(100, 100)
    scene = DrawList((Instance(mesh, Material(base_color_texture=texture, double_sided=True), np.eye(4)),))
    frame = CpuRenderer(1).render(scene, view, Output.COLOR)
    row = frame.color[50, :, 0] if not upright else frame.color[:, 50, 0]
    expected = 255 * (np.arange(100) + 0.5) / 100
    assert np.abs(row - expected).max() <= 1.5


def shares(count: int) -> np.ndarray:
    """Return the share of each of ``count`` texels in each of 64 pixels that lie side by side on them, (64, count)."""
    edges, texels = np.arange(65)[:, None] * count / 64, np.arange(count)
    return np.clip(np.minimum(edges[1:], texels + 1) - np.maximum(edges[:-1], texels), 0.0, None) * 64 / count


@pytest.mark.parametrize("size", [(256, 256), (64, 512), (230, 100)], ids=["minified", "anisotropic", "fractions"])
def test_the_area_filter_averages_the_light_of_each_pixel(size: tuple[int, int]) -> None:
    """The footprint is sharper than that of trilinear filters, and so is the image."""
    cells = np.random.default_rng(5).integers(0, 2, (17, 17)).astype(np.uint8) * 255
    pixels = np.full((*size, 4), 255, np.uint8)
    rows, columns = (np.arange(n) * 17 // n for n in size)
    pixels[..., :3] = cells[rows[:, None], columns, None]
    mesh, view = square(64, 64)
    material = Material(base_color_texture=Texture(image_of(pixels)), unlit=True, double_sided=True)
    scene, renderer = DrawList((Instance(mesh, material, np.eye(4)),)), CpuRenderer(1)
    exact = shares(size[0]) @ (pixels[..., 0] / 255.0) @ shares(size[1]).T
    deviations = []
    for area_filter in (False, True):
        frame = renderer.render(scene, view, Output.COLOR, Look("gltf", area_filter=area_filter))
        light = (frame.color[..., 0] / 255.0) ** 2.2
        assert light.mean() == pytest.approx(exact.mean(), abs=0.005)
        deviations.append(float((light - exact).std()))
    assert deviations[1] < 0.05
    assert deviations[1] < 0.5 * deviations[0]
    renderer.close()


def test_an_image_of_several_textures_counts_once_for_the_cache() -> None:
    """Else a scene whose materials share images evicts its own tables."""
    image = image_of(np.full((64, 64, 4), 255, np.uint8))
    mesh, _ = square(8, 8)
    textures = [Texture(image, uv_transform=(1.0, 0.0, float(k), 0.0, 1.0, 0.0)) for k in range(8)]
    instances = [Instance(mesh, Material(base_color_texture=texture), np.eye(4)) for texture in textures]
    assert prepare(instances, "gltf").nbytes < 2 * prepare(instances[:1], "gltf").nbytes


@pytest.mark.parametrize("size", [(1, 1), (1, 37), (37, 1), (64, 64), (300, 173), (5, 2)])
def test_mip_levels_of_one_array_do_not_overlap(size: tuple[int, int]) -> None:
    height, width = size
    last_level = max(size).bit_length() - 1
    shapes = [(max(height >> k, 1), max(width >> k, 1)) for k in range(last_level + 1)]
    levels = [np.full((*shape, 4), k + 1, np.uint8) for k, shape in enumerate(shapes)]
    rows = empty_rows(*size)
    for k, level in enumerate(levels):
        set_level(rows, size, k, level)
    for k, level in enumerate(levels):
        first_row, first_column = level_row(height, k), 0 if k == 0 else width + 1
        stored = rows[first_row:, first_column:][: len(level), : level.shape[1] + 1]  # and the repeated first texel
        assert stored.shape == (len(level), level.shape[1] + 1, 4)
        assert (stored == k + 1).all()
