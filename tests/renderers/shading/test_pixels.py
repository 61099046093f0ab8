"""SIMD shading against the reference in NumPy: random scenes, odd sizes, row borders."""

from dataclasses import replace

import numpy as np
import pytest

from renderers.camera import Camera
from renderers.drawlist import DrawList, Instance, Material, Mesh, Sampler, Texture, Wrap
from renderers.interface import Look, LookName, Output
from renderers.raster import CpuRenderer
from renderers.shading import paint, prepare
from renderers.shading.mesh_buffers import buffers_of
from tests.renderers.shading.pixel_reference import shaded
from tests.renderers.shading.reference import RENDERER, ball, image_of, placed, quad


def test_colours_of_a_mesh_are_read_where_they_are() -> None:
    positions, colors = np.zeros((3, 3), np.float32), np.ones((3, 4), np.float32)
    buffers = buffers_of(Mesh(positions, np.array(((0, 1, 2),), np.uint32), colors=colors), -1)
    assert buffers.colors is not None
    assert np.shares_memory(buffers.colors, colors)
    assert buffers.extras is None


def random_material(rng: np.random.Generator) -> Material:
    """Return a material with any factors, and each texture in half of the cases."""

    def texture() -> Texture | None:
        if rng.random() < 0.5:
            return None
        pixels = rng.integers(0, 256, (*rng.integers(1, 20, 2), 4)).astype(np.uint8)
        pixels[..., 3] = 255  # the reference knows neither layers nor mip levels
        wraps = rng.choice(np.array(Wrap), 2)
        uv_transform = (1.0, 0.3, 0.1, -0.2, 1.1, 0.4) if rng.random() < 0.5 else None
        # Always filtered: the nearest texel may depend on the last bit, and neighbours differ without limit.
        sampler = Sampler(wraps[0], wraps[1], mipmaps=False)
        return Texture(image_of(pixels), sampler, int(rng.integers(0, 2)), uv_transform)

    return Material(
        base_color=(*rng.random(3), 1.0),
        base_color_texture=texture(),
        metallic=float(rng.random()),
        roughness=float(rng.random()),
        metallic_roughness_texture=texture(),
        normal_texture=texture(),
        normal_scale=float(rng.random()),
        occlusion_texture=texture(),
        occlusion_strength=float(rng.random()),
        emissive=(0.1, 0.0, 0.2) if rng.random() < 0.5 else (0.0, 0.0, 0.0),
        emissive_texture=texture(),
        double_sided=bool(rng.random() < 0.7),
        unlit=bool(rng.random() < 0.2),
        line_width=3.0,
        point_size=5.0,
    )


def random_mesh(rng: np.random.Generator) -> Mesh:
    """Return small or large triangles, lines or points, with or without each attribute."""
    count = int(rng.integers(4, 60))
    size = float(rng.choice((0.05, 0.5, 3.0)))
    positions = rng.uniform(-1.5, 1.5, (count, 1, 3)) + rng.normal(scale=size, size=(count, 3, 3))
    vertices = positions.reshape(-1, 3).astype(np.float32)
    n = len(vertices)
    corners = int(rng.choice((3, 3, 3, 2, 1)))

    def maybe(values: np.ndarray) -> np.ndarray | None:
        return values.astype(np.float32) if rng.random() < 0.6 else None

    return Mesh(
        vertices,
        rng.integers(0, n, (count, corners)).astype(np.uint32),
        maybe(rng.normal(size=(n, 3))),
        maybe(rng.uniform(-2, 2, (n, 2))),
        maybe(rng.uniform(-2, 2, (n, 2))),
        maybe(np.append(rng.random((n, 3)), np.ones((n, 1)), axis=1)),
        maybe(np.concatenate((rng.normal(size=(n, 3)), rng.choice((-1.0, 1.0), (n, 1))), axis=1)),
    )


def random_scene(rng: np.random.Generator) -> DrawList:
    def pose() -> np.ndarray:
        X = np.eye(4)
        X[:3, :3] = np.linalg.qr(rng.normal(size=(3, 3)))[0] * rng.uniform(0.3, 2.0, 3)
        X[:3, 3] = rng.uniform((-1, -1, 2), (1, 1, 6))
        return X

    return DrawList(tuple(Instance(random_mesh(rng), random_material(rng), pose()) for _ in range(6)))


def view(width: int, height: int) -> Camera:
    return Camera(width, height, 60.0, 65.0, width / 2 + 0.3, height / 2 - 0.2, 0.05, 50.0, np.eye(4))


def assert_within_a_level(scene: DrawList, camera: Camera, look: Look, exceptions: int = 0) -> np.ndarray:
    """Compare the nearest surfaces as the kernels and as the reference shade them.

    Args:
        exceptions: number of values that may differ by more than one level of 255.

    Returns:
        The kernels' image.
    """
    color = np.full((camera.height, camera.width, 3), 99, np.uint8)
    shading = prepare(scene.instances, look.name)
    paint(RENDERER, scene, shading, camera, look, color)
    visible = RENDERER.visibility(scene, camera, cull_back=shading.cull_back)
    expected = shaded(scene, visible, camera, look)
    differences = np.abs(color.astype(np.int64) - expected)
    assert (differences > 1).sum() <= exceptions
    assert (differences != 0).mean() < 0.02
    return color


@pytest.mark.parametrize("name", ["phong", "plain", "pbr", "gltf"])
@pytest.mark.parametrize("seed", range(6))
def test_random_scenes_to_a_level(name: LookName, seed: int) -> None:
    scene = random_scene(np.random.default_rng(seed))
    assert_within_a_level(scene, view(83, 61), Look(name))


@pytest.mark.parametrize("width", range(1, 18))
def test_narrow_images(width: int) -> None:
    scene = random_scene(np.random.default_rng(3))
    for name in ("phong", "pbr"):
        assert_within_a_level(scene, view(width, 33), Look(name))


def test_writes_nothing_outside_the_image() -> None:
    """Values after the rows of an image inside a larger array stay unchanged."""
    scene = random_scene(np.random.default_rng(4))
    for width, height in ((1, 1), (7, 5), (13, 33), (64, 3)):
        camera = view(width, height)
        memory = np.full(3 * width * height + 64, 77, np.uint8)
        color = memory[: 3 * width * height].reshape(height, width, 3)
        for name in ("phong", "pbr"):
            paint(RENDERER, scene, prepare(scene.instances, name), camera, Look(name), color)
            assert (memory[3 * width * height :] == 77).all()


def test_far_and_huge_triangles_to_a_level() -> None:
    """A floor to the horizon, a wall a million times as wide as the image, a tiny far ball."""
    uv = np.array(((0, 0), (0, 3000), (3000, 3000), (3000, 0)), np.float32)
    floor = np.array(((-900, 1, 0.1), (-900, 1, 2000), (900, 1, 2000), (900, 1, 0.1)), np.float32)
    checks = np.kron(np.eye(2), np.ones((8, 8)))[..., None] * (200, 100, 50, 0) + (20, 30, 40, 255)
    texture = Texture(image_of(checks.astype(np.uint8)), Sampler(mipmaps=False))
    tiled = Material(base_color_texture=texture, double_sided=True)
    camera = Camera(97, 71, 60.0, 60.0, 48.0, 35.0, 0.01, 1e7, np.eye(4))
    scenes = (
        DrawList((placed(replace(quad(), positions=floor, uv0=uv, normals=None), tiled),)),
        DrawList((placed(quad(1e6, 3.0, uv0=uv), tiled),)),
        DrawList((placed(ball(10, 1e4), tiled, z=1e5),)),
        DrawList((placed(ball(10, 1e-3), replace(tiled, base_color_texture=None), z=0.02),)),
    )
    for scene in scenes:
        for name in ("phong", "pbr"):
            assert_within_a_level(scene, camera, Look(name))


@pytest.mark.parametrize("cells", [4, 30, 230])
def test_plain_surfaces_to_a_level(cells: int) -> None:
    """Large and small triangles, and enough for prefetching; flat, smooth and no normals; mirrored; clipped colours."""
    sphere = ball(cells, 0.9)
    flat = replace(sphere, positions=sphere.positions[sphere.elements].reshape(-1, 3), uv0=None, tangents=None)
    flat = replace(
        flat,
        elements=np.arange(len(flat.positions), dtype=np.uint32).reshape(-1, 3),
        normals=np.repeat(flat.positions[::3], 3, axis=0),
    )
    for mesh in (sphere, flat, replace(flat, normals=None)):
        for color in ((0.9, 0.3, 1.0, 1.0), (1.7, -0.2, 0.5, 1.0)):
            for unlit in (False, True):
                material = Material(color, double_sided=True, unlit=unlit)
                X = np.diag((1.0, -1.0, 1.0, 1.0))
                X[:3, 3] = 1.0, 0.0, 4.0  # beside the other
                scene = DrawList((placed(mesh, material, z=3.0), Instance(mesh, material, X)))
                for name in ("phong", "plain", "pbr"):
                    assert_within_a_level(scene, view(83, 61), Look(name))


@pytest.mark.parametrize("side", [16, 512])
@pytest.mark.parametrize("cells", [4, 30, 230])
def test_textured_surfaces_to_a_level(cells: int, side: int) -> None:
    """Large and small triangles, and enough for prefetching; with and without normals; unlit; from behind; filtered or
    not, across every texture border."""
    y, x = np.mgrid[0:side, 0:side] / side * 2.0 * np.pi
    values = np.stack((np.sin(x), np.cos(y), np.sin(2.0 * x + y), np.ones_like(x)), axis=-1)
    waves = image_of((127.5 + 127.5 * values).astype(np.uint8))
    flat = image_of(np.full((side, side, 4), (250, 120, 30, 255), np.uint8))  # any texel is right
    sphere = replace(ball(cells, 0.9), tangents=None)
    for mesh in (sphere, replace(sphere, normals=None)):
        for unlit in (False, True):
            for wrap in Wrap:
                for image, linear in ((waves, True), (flat, False)):
                    uv_transform = (2.0, 0.5, -0.25, -0.5, 1.5, 0.125) if unlit else None
                    texture = Texture(image, Sampler(wrap, wrap, linear, linear, mipmaps=False), 0, uv_transform)
                    for green in (0.3, 1.3):
                        material = Material((0.9, green, 1.0, 1.0), texture, double_sided=True, unlit=unlit)
                        X = np.diag((1.0, -1.0, 1.0, 1.0))
                        X[:3, 3] = 1.0, 0.0, 4.0  # beside the other
                        scene = DrawList((placed(mesh, material, z=3.0), Instance(mesh, material, X)))
                        assert_within_a_level(scene, view(83, 61), Look("phong"))


@pytest.mark.parametrize("unit", [1e-3, 1.0, 1e3])
@pytest.mark.parametrize("thickness", [1.0, 0.2, 1e-3, 0.0])
@pytest.mark.parametrize("smooth", [True, False])
def test_triangles_as_large_as_pixels_to_a_level(unit: float, thickness: float, smooth: bool) -> None:
    """In meshes of any unit, far from their own origin, upright and squashed."""
    rng = np.random.default_rng(5)
    rotation = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    sphere = ball(120, 0.9)
    offset = (3.0, -40.0, 7.0)
    positions = ((sphere.positions + np.array(offset, np.float32)) * unit).astype(np.float32)
    mesh = replace(sphere, positions=positions, uv0=None, tangents=None)
    if not smooth:
        mesh = replace(mesh, normals=None)
    X = np.eye(4)
    X[:3, :3] = rotation @ np.diag((1.0, 1.0, thickness)) / unit  # thickness 0: no mirror
    X[:3, 3] = (0.0, 0.0, 4.0) - X[:3, :3] @ (np.array(offset) * unit)
    scene = DrawList((Instance(mesh, Material((0.9, 0.3, 1.0, 1.0), double_sided=True), X),))
    for name in ("phong", "pbr"):
        # Rounding decides the visible side of triangles seen edge-on.
        assert_within_a_level(scene, view(83, 61), Look(name), exceptions=8)


@pytest.mark.parametrize("tilt", [0.0, 0.6, -1.1, 1.45])
@pytest.mark.parametrize("metallic", [0.0, 0.7, 1.0])
def test_walls_to_a_level(tilt: float, metallic: float) -> None:
    """Long spans of one normal, rough and glossy, from the front and at a grazing angle, at several focal lengths."""
    rotation = np.array(((np.cos(tilt), 0, np.sin(tilt)), (0, 1, 0), (-np.sin(tilt), 0, np.cos(tilt))))
    for roughness, blue in ((0.0, 0.0), (0.3, 0.9), (0.5, 0.0), (1.0, 0.9)):
        material = Material(
            (0.9, 0.3, 0.02, 1.0), metallic=metallic, roughness=roughness, emissive=(0.05, 0.0, blue), double_sided=True
        )
        ahead = placed(quad(0.3, 0.0), replace(material, base_color=(0.2, 0.9, 0.6, 1.0)), z=1.0)
        scene = DrawList((placed(quad(2.0, 0.0), material, z=2.0, linear=rotation), ahead))
        for focal in (60.0, 131.0, 300.0, 900.0):
            camera = Camera(203, 41, focal, focal + 5.0, 100.3, 20.2, 0.05, 50.0, np.eye(4))
            assert_within_a_level(scene, camera, Look("pbr"))


@pytest.mark.parametrize("roughness", [1.0, 0.97, 0.5, 0.1, 0.0])
@pytest.mark.parametrize("cells", [4, 30, 90])
def test_metal_balls_to_a_level(roughness: float, cells: int) -> None:
    """Few large triangles, whose normals turn much, and many; factors within and outside 0 .. 1."""
    for color in ((0.9, 0.3, 0.0, 1.0), (1.0, 1.0, 1.0, 1.0), (1.7, -0.2, 1e-5, 1.0)):
        gold = Material(color, metallic=1.0, roughness=roughness, double_sided=True)
        scene = DrawList((placed(ball(cells, 0.9), gold, z=3.0),))
        assert_within_a_level(scene, view(83, 61), Look("pbr"))


@pytest.mark.parametrize("focal", [300.0, 80.0])
def test_neighbouring_instances_to_a_level(focal: float) -> None:
    """Rows across many instances: metals and dielectrics, wide and narrow ones, next to each other."""
    rng = np.random.default_rng(3)
    camera = Camera(161, 120, focal, focal, 80.0, 60.0, 0.05, 50.0, np.eye(4))
    instances = []
    for _ in range(40):
        material = Material((*rng.uniform(0.0, 1.0, 3), 1.0), metallic=float(rng.choice((1.0, 1.0, 1.0, 0.3))))
        X = np.eye(4)
        X[:3, 3] = rng.uniform((-1.5, -1.0, 3.0), (1.5, 1.0, 5.0))
        instances.append(Instance(ball(int(rng.choice((4, 9, 40))), float(rng.choice((0.02, 0.3, 0.6)))), material, X))
    instances.append(placed(quad(9.0, 9.0), Material((1.0, 0.0, 0.5, 1.0)), z=5.5))
    color = assert_within_a_level(DrawList(tuple(instances)), camera, Look("pbr"))
    assert color.any()


@pytest.mark.parametrize("size", [(83, 61), (64, 40), (9, 70)])
def test_thread_count_does_not_change_the_image(size: tuple[int, int]) -> None:
    scene = random_scene(np.random.default_rng(7))
    for name in ("phong", "pbr"):
        images = []
        for threads in (1, 2, 4):
            renderer = CpuRenderer(threads)
            frame = renderer.render(scene, view(*size), Output.COLOR | Output.DEPTH, Look(name))
            images.append(frame.color.copy())
            renderer.close()
        assert all((p == images[0]).all() for p in images)


def test_buffers_keep_only_the_vertices_in_use() -> None:
    sphere = ball(24)
    few = replace(sphere, elements=sphere.elements[40:43])
    buffers = buffers_of(few, -1)
    assert len(buffers.vertices) == len(np.unique(few.elements))
    np.testing.assert_array_equal(buffers.vertices[buffers.indices, :3], sphere.positions[few.elements])
    assert buffers_of(few, -1) is buffers
    material = Material(double_sided=True)
    X = np.eye(4)
    X[2, 3] = 3.0
    assert_within_a_level(DrawList((Instance(few, material, X),)), view(40, 30), Look("phong"))
