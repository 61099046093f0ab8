"""Coverage and depth against Mesa's llvmpipe through OpenGL: another rasterizer, other authors."""

from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from renderers.camera import Camera
from renderers.drawlist import DrawList, Instance, Material
from renderers.interface import Output
from renderers.raster import CpuRenderer
from tests.renderers.scenes import camera, draw_list, grid, mesh, pose, soup, sphere

moderngl = pytest.importorskip("moderngl", reason="moderngl is not installed")
pytestmark = pytest.mark.egl

VERTEX = """
#version 330
uniform mat4 clip_from_camera;
in vec3 position;
void main() { gl_Position = clip_from_camera * vec4(position, 1.0); }
"""
FRAGMENT = """
#version 330
uniform float identity;
out float label;
void main() { label = identity; }
"""


@pytest.fixture(scope="module")
def context() -> Iterator[Any]:
    try:
        context = moderngl.create_standalone_context(backend="egl")
    except Exception as error:  # noqa: BLE001  whatever moderngl raises without a driver
        pytest.skip(f"no OpenGL by EGL: {error}")
    yield context
    context.release()


def clip_from_camera(view: Camera) -> NDArray[np.float64]:
    """Optical frame to clip space; y is not turned, so that row 0 of the framebuffer's memory is our row 0."""
    near, far = view.near, view.far
    return np.array(
        (
            (2 * view.fx / view.width, 0, 2 * view.cx / view.width - 1, 0),
            (0, 2 * view.fy / view.height, 2 * view.cy / view.height - 1, 0),
            (0, 0, (far + near) / (far - near), -2 * far * near / (far - near)),
            (0, 0, 1, 0),
        )
    )


def by_opengl(context: Any, scene: DrawList, view: Camera) -> tuple[NDArray[np.int32], NDArray[np.float64]]:
    """Labels (-1: background) and metric depth."""
    program = context.program(vertex_shader=VERTEX, fragment_shader=FRAGMENT)
    program["clip_from_camera"].write(clip_from_camera(view).T.astype(np.float32).tobytes())
    labels = context.texture((view.width, view.height), 1, dtype="f4")
    depths = context.depth_texture((view.width, view.height))
    target = context.framebuffer([labels], depths)
    target.use()
    target.clear(-1.0, depth=1.0)
    context.enable_only(moderngl.DEPTH_TEST)
    context.depth_func = "<"
    for instance in scene.instances:
        X = view.X_camera_world @ instance.X_world_mesh
        points = instance.mesh.positions.astype(np.float64) @ X[:3, :3].T + X[:3, 3]
        corners = points[instance.mesh.elements.ravel()].astype(np.float32)
        buffer = context.buffer(corners.tobytes())
        program["identity"] = float(instance.label)
        context.vertex_array(program, [(buffer, "3f", "position")]).render()
    shape = (view.height, view.width)
    d = np.frombuffer(depths.read(alignment=1), np.float32).reshape(shape).astype(np.float64)
    near, far = view.near, view.far
    z = 2 * far * near / (far + near - (2 * d - 1) * (far - near))
    found = np.frombuffer(labels.read(alignment=1), np.float32).reshape(shape).astype(np.int32)
    for thing in (program, labels, depths, target):
        thing.release()
    return found, z


def _spheres(rng: np.random.Generator) -> DrawList:
    ball = sphere(24, 12, 0.4)
    places = rng.uniform((-1.5, -1, 2), (1.5, 1, 5), size=(25, 3))
    instances = []
    for label, place in enumerate(places):
        X = pose(rng)
        X[:3, 3] = place
        instances.append(Instance(ball, Material(), X, label, label))
    return DrawList(tuple(instances))


def _ground(rng: np.random.Generator) -> DrawList:
    return draw_list(
        mesh(((-50, 0.7, -50), (50, 0.7, -50), (50, 0.7, 50), (-50, 0.7, 50)), ((0, 1, 2), (0, 2, 3))),
        Instance(sphere(16, 8, 0.5), Material(), pose(rng, z=3.0), 2, 2),
    )


SCENES: dict[str, tuple[Callable[[np.random.Generator], DrawList], dict[str, Any]]] = {
    "spheres": (_spheres, {"width": 320, "height": 240}),
    "odd size": (_spheres, {"width": 333, "height": 217}),
    "small triangles": (lambda r: draw_list(soup(r, 5000, size=0.02, low=(-2, -2, 1), high=(2, 2, 5))), {}),
    "large triangles": (lambda r: draw_list(soup(r, 20, size=2.0, low=(-1, -1, 3), high=(1, 1, 6))), {}),
    "fine mesh": (lambda _: draw_list(grid(200, 150, ((-1, -1, 2), (1.1, -1, 3), (1, 1, 3), (-1, 0.9, 2.5)))), {}),
    "dense sphere": (lambda r: draw_list(Instance(sphere(300, 150), Material(), pose(r, z=2.5), 1, 1)), {}),
    "ground across the near plane": (_ground, {"near": 0.05, "far": 100.0}),
    "triangles across the near plane": (
        lambda r: draw_list(soup(r, 12, size=1.0, low=(-1, -1, 0), high=(1, 1, 2))),
        {"near": 0.3},
    ),
    "inside a sphere": (lambda r: draw_list(Instance(sphere(30, 15, 2.0), Material(), pose(r), 1, 1)), {}),
    "far plane": (
        lambda _: draw_list(mesh(((-9, 2, 1), (9, 2, 1), (9, -6, 9), (-9, -6, 9)), ((0, 1, 2), (0, 2, 3)))),
        {"far": 3.01},
    ),
}


@pytest.mark.parametrize("name", SCENES)
def test_coverage_labels_and_depth(context: Any, name: str) -> None:
    make, changes = SCENES[name]
    scene, view = make(np.random.default_rng(7)), camera(**{"width": 200, "height": 150, **changes})
    theirs, their_depth = by_opengl(context, scene, view)
    frame = CpuRenderer(1).render(scene, view, Output.DEPTH | Output.INSTANCE | Output.LABEL)
    ours = np.where(np.isfinite(frame.depth), frame.label.astype(np.int64), -1)
    depth = frame.depth.astype(np.float64)
    print(name, "coverage", np.count_nonzero((ours >= 0) != (theirs >= 0)), "labels", np.count_nonzero(ours != theirs))
    assert np.count_nonzero(theirs >= 0) > 300
    assert np.count_nonzero((ours >= 0) != (theirs >= 0)) <= 1
    same = (ours == theirs) & (ours >= 0)
    assert np.count_nonzero((ours != theirs) & (ours >= 0) & (theirs >= 0)) <= 3
    # Their depth buffer holds 24 bits of a hyperbola, and planes through snapped vertices.
    step = their_depth[same] ** 2 / view.near / 2**23
    assert np.quantile(np.abs(depth[same] - their_depth[same]) / (2e-5 * depth[same] + step), 0.99) < 1.0
