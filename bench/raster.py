"""Drawing: our rasterizer against Mesa's llvmpipe through OpenGL (moderngl on EGL), in one run, interleaved.

    python -m bench.raster [THREADS]

Both draw colour (one head light, both sides), depth and label of the same warm scene and leave them in numpy arrays:
we in one call, OpenGL in one pass into three render targets that are read back. Every frame has another camera.
Columns are medians in ms, wall and CPU of all threads; ``ratio`` is OpenGL's time over ours. Ours without colour is
timed, too: what a request for depth or label costs. THREADS (default: this
machine's) are ours; llvmpipe takes what LP_NUM_THREADS says, or all.
"""

from __future__ import annotations

import math
import statistics
import sys
import time
from collections.abc import Callable
from functools import partial
from typing import Any

import moderngl
import numpy as np

from renderers.camera import Camera
from renderers.cpu import CpuRenderer, warmup
from renderers.drawlist import DrawList, Instance, Material, Mesh
from renderers.port import Look, Output

FRAMES = 25
WARM = 3
SIZES = ((640, 480), (1280, 960))
VERTEX = """
#version 330
uniform mat4 clip_from_camera; uniform mat4 camera_from_mesh; uniform mat3 normal_from_mesh;
in vec3 position; in vec3 normal; out vec3 n; out float z;
void main() {
    vec4 p = camera_from_mesh * vec4(position, 1.0);
    n = normal_from_mesh * normal; z = p.z; gl_Position = clip_from_camera * p;
}"""
FRAGMENT = """
#version 330
uniform vec3 base; uniform uint label; in vec3 n; in float z;
layout(location = 0) out vec4 color; layout(location = 1) out float depth; layout(location = 2) out uint name;
void main() { color = vec4(base * abs(normalize(n).z), 1.0); depth = z; name = label; }"""


def sphere(columns: int, rows: int, bumps: float = 0.0) -> Mesh:
    """Around the origin, with shared vertices and normals."""
    u, v = np.meshgrid(np.linspace(0, 2 * np.pi, columns + 1), np.linspace(0, np.pi, rows + 1))
    n = np.stack((np.cos(u) * np.sin(v), np.sin(u) * np.sin(v), np.cos(v)), axis=-1)
    points = n * (1 + bumps * np.sin(9 * u) * np.sin(7 * v))[..., None]
    a = (np.arange(rows)[:, None] * (columns + 1) + np.arange(columns)).ravel()
    below = a + columns + 1
    elements = np.concatenate((np.stack((a, below, a + 1), 1), np.stack((a + 1, below, below + 1), 1)))
    flat = (x.reshape(-1, 3).astype(np.float32) for x in (points, n))
    return Mesh(next(flat), elements.astype(np.uint32), next(flat))


def scenes() -> dict[str, DrawList]:
    """Ten objects, a hundred and one, and one mesh of a million triangles."""
    rng = np.random.default_rng(0)

    def at(place: Any, scale: float) -> np.ndarray[Any, Any]:
        X = np.diag((scale, scale, scale, 1.0))
        X[:3, 3] = place
        return X

    def some(count: int, mesh: Mesh, scale: float, spread: float) -> DrawList:
        wall = Mesh(
            np.array(((-4, -4, 2), (4, -4, 2), (4, 4, 2), (-4, 4, 2)), np.float32),
            np.array(((0, 2, 1), (0, 3, 2)), np.uint32),
            np.tile(np.array((0, 0, -1), np.float32), (4, 1)),
        )
        places = rng.uniform((-spread, -spread, -1), (spread, spread, 1), size=(count, 3))
        looks = [Material((*rng.uniform(0.2, 1.0, 3), 1.0), double_sided=True) for _ in range(count + 1)]
        balls = [Instance(mesh, looks[k], at(places[k], scale), k, k) for k in range(count)]
        return DrawList((*balls, Instance(wall, looks[-1], np.eye(4), count, count)))

    fine = Instance(sphere(1000, 501, 0.1), Material((0.5, 0.5, 0.9, 1.0), double_sided=True), at((0, 0, 0), 1.3), 1, 1)
    return {
        "10 objects": some(9, sphere(24, 12), 0.5, 1.2),
        "101 objects": some(100, sphere(24, 10), 0.3, 2.0),
        "1 mesh": DrawList((fine,)),
    }


def view(width: int, height: int, frame: int) -> Camera:
    """Nearly the same every frame."""
    X = np.eye(4)
    X[:3, 3] = 0.01 * math.sin(frame), 0.01 * math.cos(frame), -3.0
    return Camera(width, height, 0.9 * width, 0.9 * width, width / 2, height / 2, 0.05, 10.0, X)


class OpenGl:
    """One scene on a context of its own size."""

    def __init__(self, scene: DrawList, width: int, height: int) -> None:
        self.context: Any = moderngl.create_standalone_context(backend="egl")
        self.program = self.context.program(vertex_shader=VERTEX, fragment_shader=FRAGMENT)
        targets = [
            self.context.texture((width, height), 4),
            self.context.texture((width, height), 1, dtype="f4"),
            self.context.texture((width, height), 1, dtype="u4"),
        ]
        self.targets = targets
        self.buffer = self.context.framebuffer(targets, self.context.depth_renderbuffer((width, height)))
        self.draws = []
        meshes: dict[int, Any] = {}
        for instance in scene.instances:
            mesh = instance.mesh
            if id(mesh) not in meshes:
                both = np.concatenate((mesh.positions, mesh.normals), axis=1)  # type: ignore[arg-type]  # they have normals
                vertices = self.context.buffer(np.ascontiguousarray(both, np.float32).tobytes())
                indices = self.context.buffer(mesh.elements.tobytes())
                meshes[id(mesh)] = self.context.vertex_array(
                    self.program, [(vertices, "3f 3f", "position", "normal")], indices
                )
            self.draws.append((instance, meshes[id(mesh)]))
        self.pictures = [
            np.empty((height, width, 4), np.uint8),
            np.empty((height, width), np.float32),
            np.empty((height, width), np.uint32),
        ]

    def draw(self, camera: Camera) -> None:
        """One frame, read back."""
        w, h, near, far = camera.width, camera.height, camera.near, camera.far
        clip = np.array(
            (
                (2 * camera.fx / w, 0, 2 * camera.cx / w - 1, 0),
                (0, 2 * camera.fy / h, 2 * camera.cy / h - 1, 0),
                (0, 0, (far + near) / (far - near), -2 * far * near / (far - near)),
                (0, 0, 1, 0),
            )
        )
        self.buffer.use()
        self.buffer.clear(0.8, 0.9, 1.0, depth=1.0)
        self.context.enable_only(moderngl.DEPTH_TEST)
        self.program["clip_from_camera"].write(clip.T.astype(np.float32).tobytes())
        from_world = camera.X_camera_world
        for instance, mesh in self.draws:
            X = from_world @ instance.X_world_mesh
            self.program["camera_from_mesh"].write(X.T.astype(np.float32).tobytes())
            self.program["normal_from_mesh"].write(np.linalg.inv(X[:3, :3]).astype(np.float32).tobytes())
            self.program["base"] = instance.material.base_color[:3]
            self.program["label"] = instance.label
            mesh.render()
        for texture, picture in zip(self.targets, self.pictures, strict=True):
            texture.read_into(picture)


def timed(call: Callable[[], object]) -> tuple[float, float]:
    """Wall and CPU time of all threads, ms."""
    wall, cpu = time.perf_counter(), time.process_time()
    call()
    return 1e3 * (time.perf_counter() - wall), 1e3 * (time.process_time() - cpu)


def ours(renderer: CpuRenderer, scene: DrawList, outputs: Output, camera: Camera) -> None:
    """One frame in pooled arrays."""
    renderer.render(scene, camera, outputs, Look()).close()


def compared(calls: dict[str, Callable[[Camera], None]], width: int, height: int) -> dict[str, tuple[float, float]]:
    """Median wall and CPU time of each, frame by frame in turn."""
    times: dict[str, list[tuple[float, float]]] = {name: [] for name in calls}
    for frame in range(FRAMES + WARM):
        camera = view(width, height, frame)
        for name, call in calls.items():
            times[name].append(timed(partial(call, camera)))
    return {
        name: (statistics.median(t[0] for t in values[WARM:]), statistics.median(t[1] for t in values[WARM:]))
        for name, values in times.items()
    }


def main() -> None:
    warmup()
    renderer = CpuRenderer(int(sys.argv[1]) if len(sys.argv) > 1 else None)
    geometry = Output.DEPTH | Output.LABEL
    print(f"{'ms wall/CPU':22}  {'depth+label':>15}  {'and colour':>15}  {'OpenGL':>15}  {'ratio of all three':>18}")
    for name, scene in scenes().items():
        for width, height in SIZES:
            other = OpenGl(scene, width, height)
            median = compared(
                {
                    "geometry": partial(ours, renderer, scene, geometry),
                    "all": partial(ours, renderer, scene, geometry | Output.COLOR),
                    "OpenGL": other.draw,
                },
                width,
                height,
            )
            cells = "  ".join(f"{wall:7.2f}/{cpu:7.2f}" for wall, cpu in median.values())
            ratios = "/".join(
                f"{theirs / our:.1f}" for theirs, our in zip(median["OpenGL"], median["all"], strict=True)
            )
            print(f"{name:12} {width:4}x{height:<4}  {cells}  {ratios:>18}", flush=True)
            other.context.release()


if __name__ == "__main__":
    main()
