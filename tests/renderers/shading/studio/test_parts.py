"""Mip levels, tangents, sRGB encoding, sample positions and limits of the light rig."""

import itertools
from dataclasses import replace

import numpy as np
import pytest

from renderers.camera import Camera
from renderers.drawlist import Image, ImageError, Mesh, Texture
from renderers.light_rig import Rig
from renderers.msaa import sample_cameras
from renderers.shading.mikktspace import corner_tangents, with_tangents
from renderers.shading.mipmaps import halve, make_chain
from renderers.shading.texture_table import TextureTable
from tests.renderers.shading.reference import ball
from tests.renderers.shading.studio import reference as ref
from tests.renderers.shading.studio.scenes import noise


@pytest.mark.parametrize("srgb", [True, False])
def test_levels_are_means(srgb: bool) -> None:
    image = noise(32)
    levels = list(make_chain(image.decode(), (32, 32), srgb))
    exact = ref.levels(image, srgb)[1:]
    assert [level.shape for level in levels] == [level.shape for level in exact]
    for level, expected in zip(levels, exact, strict=True):
        encoded = np.concatenate(
            (ref.srgb(expected[..., :3]) if srgb else 255 * expected[..., :3], 255 * expected[..., 3:]), -1
        )
        assert np.abs(level - encoded).max() <= 1.1  # half a level of rounding, again at every level


def test_an_image_that_cannot_be_decoded_is_named_by_its_texture() -> None:
    def broken() -> np.ndarray:
        raise ImageError("torn")

    for name in ("first", "second"):
        table = TextureTable()
        table.index_of(Texture(Image(b"torn", broken), name=name), True)
        with pytest.raises(ImageError, match=f"^{name}: torn$"):
            table.structs()


@pytest.mark.parametrize("shape", [(5, 7), (1, 9), (12, 1), (3, 2), (2, 2)])
def test_levels_of_odd_sizes_keep_the_mean(shape: tuple[int, int]) -> None:
    rng = np.random.default_rng(1)
    pixels = rng.integers(0, 256, (*shape, 4)).astype(np.uint8)
    levels = (pixels, *make_chain(pixels, shape, False))
    for before, level in itertools.pairwise(levels):
        assert level.shape[:2] == tuple(max(side // 2, 1) for side in before.shape[:2])
        assert np.abs(level.mean(axis=(0, 1)) - before.mean(axis=(0, 1))).max() <= 0.5
    assert levels[-1].shape[:2] == (1, 1)


def test_writable_and_read_only_images_share_one_compiled_signature() -> None:
    pixels = noise(8).decode().copy()
    for writable in (True, False):
        pixels.flags.writeable = writable
        list(make_chain(pixels, (8, 8), True))
        assert pixels.flags.writeable is writable
    assert len(halve.signatures) == 1  # another one would be compiled while serving


def tangents_of(uv: np.ndarray) -> np.ndarray:
    mesh = ball(12)
    assert mesh.normals is not None
    return corner_tangents(mesh.positions, mesh.normals, uv, mesh.elements).reshape(-1, 3, 4)


def planar() -> np.ndarray:
    """Return coordinates with u along x and v against z."""
    mesh = ball(12)
    return np.stack((mesh.positions[:, 0], -mesh.positions[:, 2]), -1).astype(np.float32)


def test_tangents_lie_in_the_plane_of_the_normal_and_follow_u() -> None:
    mesh = ball(12)
    made = tangents_of(planar())
    n = mesh.normals[mesh.elements]
    used = np.linalg.norm(made[..., :3], axis=-1) > 0
    assert used.mean() > 0.95
    np.testing.assert_allclose(np.linalg.norm(made[used][:, :3], axis=-1), 1.0, atol=1e-5)
    assert np.abs((made[..., :3] * n).sum(-1)[used]).max() < 1e-5
    # Where the surface faces the map, the tangent is x as the surface shows it.
    facing = np.abs(n[..., 1]) > 0.9
    x = ref.normalized(np.array((1.0, 0, 0)) - n * n[..., :1])
    assert (made[..., :3] * x).sum(-1)[facing & used].min() > 0.995


def test_handedness_follows_the_texture_coordinates_and_bitangents_point_up_the_image() -> None:
    mesh = ball(12)
    n = mesh.normals[mesh.elements]
    for sign in (1.0, -1.0):
        made = tangents_of(planar() * np.array((sign, 1.0), np.float32))
        bitangent = np.cross(n, made[..., :3]) * made[..., 3:]
        facing = np.abs(n[..., 1]) > 0.9
        assert bitangent[facing][:, 2].min() > 0.9  # v falls with z


def test_vertices_on_a_mirror_line_have_both_hands() -> None:
    """Two squares whose coordinates mirror each other share two vertices: MikkTSpace gives each side its own."""
    p = np.array(((-1, 0, 0), (0, 0, 0), (1, 0, 0), (-1, 1, 0), (0, 1, 0), (1, 1, 0)), np.float32)
    uv = np.stack((np.abs(p[:, 0]), 1 - p[:, 1]), -1).astype(np.float32)
    triangles = np.array(((0, 1, 4), (0, 4, 3), (1, 2, 5), (1, 5, 4)), np.uint32)
    normals = np.tile(np.array((0, 0, 1), np.float32), (6, 1))
    made = corner_tangents(p, normals, uv, triangles).reshape(-1, 3, 4)
    np.testing.assert_allclose(made[:2], np.broadcast_to((-1, 0, 0, -1), (2, 3, 4)), atol=1e-6)
    np.testing.assert_allclose(made[2:], np.broadcast_to((1, 0, 0, 1), (2, 3, 4)), atol=1e-6)


def test_vertices_are_split_where_tangents_differ() -> None:
    """Two squares with mirrored coordinates share the vertices 2 and 5; no triangle uses the vertices 0 and 7."""
    x = np.array((9, -1, 0, 1, -1, 0, 1, 9), np.float32)
    y = np.array((9, 0, 0, 0, 1, 1, 1, 9), np.float32)
    mesh = Mesh(
        np.stack((x, y, np.zeros(8, np.float32)), -1),
        np.array(((1, 2, 5), (1, 5, 4), (2, 3, 6), (2, 6, 5)), np.uint32),
        np.tile(np.array((0, 0, 1), np.float32), (8, 1)),
        np.stack((y, x), -1),
        np.stack((np.abs(x), 1 - y), -1),
        np.random.default_rng(0).random((8, 4)).astype(np.float32),
    )
    made = with_tangents(mesh, 1)
    assert len(made.positions) == 6 + 2 + 1  # vertex 2 has two corners in the right square, vertex 5 has one
    wanted = corner_tangents(mesh.positions, mesh.normals, mesh.uv1, mesh.elements)
    np.testing.assert_array_equal(made.tangents[made.elements].reshape(-1, 4), wanted)
    for name in ("positions", "normals", "uv0", "uv1", "colors"):
        np.testing.assert_array_equal(getattr(made, name)[made.elements], getattr(mesh, name)[mesh.elements])


def test_meshes_without_texture_coordinates_get_no_tangents() -> None:
    mesh = replace(ball(4), tangents=None, uv0=None)
    assert with_tangents(mesh, 0) is mesh
    assert with_tangents(ball(4), 0).tangents is not None


def test_tangents_without_normals_are_those_of_flat_faces() -> None:
    mesh = replace(ball(4), tangents=None, normals=None)
    corner = mesh.elements.reshape(-1)
    a, b, c = mesh.positions[mesh.elements].transpose(1, 0, 2)
    normals = np.repeat(ref.normalized(np.cross(b - a, c - a)), 3, axis=0)
    made = with_tangents(mesh, 0)
    np.testing.assert_array_equal(made.positions[made.elements].reshape(-1, 3), mesh.positions[corner])
    np.testing.assert_allclose(made.normals[made.elements].reshape(-1, 3), normals, atol=1e-6)
    across = np.einsum("ni,ni->n", made.tangents[:, :3], made.normals)
    np.testing.assert_allclose(across, 0.0, atol=1e-6)


def test_vertices_are_welded_and_weighted_by_angle() -> None:
    """The order of vertices, and whether equal ones are shared, does not matter."""
    mesh = ball(8)
    uv = np.stack((mesh.positions[:, 0] + 0.2 * mesh.positions[:, 1], -mesh.positions[:, 2]), -1).astype(np.float32)
    shared = corner_tangents(mesh.positions, mesh.normals, uv, mesh.elements)
    flat = mesh.elements.reshape(-1)
    apart = corner_tangents(
        mesh.positions[flat], mesh.normals[flat], uv[flat], np.arange(len(flat), dtype=np.uint32).reshape(-1, 3)
    )
    np.testing.assert_allclose(shared, apart, atol=1e-6)


def test_degenerate_texture_coordinates_give_zero_tangents() -> None:
    mesh = ball(4)
    assert mesh.normals is not None
    for uv in (np.zeros((len(mesh.positions), 2)), np.full((len(mesh.positions), 2), np.nan)):
        made = corner_tangents(mesh.positions, mesh.normals, uv.astype(np.float32), mesh.elements)
        assert (made[:, :3] == 0).all()
        assert (np.abs(made[:, 3]) == 1).all()


def test_sample_positions() -> None:
    camera = Camera(4, 4, 2.0, 2.0, 2.0, 2.0, 0.1, 1.0, np.eye(4))
    assert sample_cameras(camera, 1) == (camera,)
    for samples in (4, 8):
        offsets = np.array([(2.0 - c.cx, 2.0 - c.cy) for c in sample_cameras(camera, samples)])
        np.testing.assert_allclose(offsets.mean(axis=0), 0.0, atol=1e-12 if samples == 4 else 0.07)
        assert len({*offsets[:, 0]}) == len({*offsets[:, 1]}) == samples
    with pytest.raises(ValueError, match="samples must be 1, 4 or 8, not 2"):
        sample_cameras(camera, 2)


def test_light_rig_limits() -> None:
    with pytest.raises(ValueError, match="shadow_size"):
        Rig(shadow_size=10)
    with pytest.raises(ValueError, match="shadow_radius"):
        Rig(shadow_radius=9)
