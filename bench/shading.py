"""Shading: nanoseconds a visible pixel by feature, and whole frames against VTK and llvmpipe with multisampling.

    python -m bench.shading [THREADS]

First, one thread on a screen full of one sphere: what each step of the studio look adds, and Drake's looks beside it
(medians of CPU time, divided by the pixels that are covered). Then whole frames of a hundred and one objects, colour
read back, in turn: VTK's physically based shading, VTK with 8 samples and llvmpipe through OpenGL with 4 samples,
against ours with the same number of samples. VTK and moderngl are peers: what is not installed is left out. Columns are
medians in ms, wall and CPU of all threads; ``ratio`` is theirs over ours.
"""

from __future__ import annotations

import statistics
import sys
import time
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np

from bench.gallery import checks, dents, sphere
from bench.raster import scenes, view
from renderers.camera import Camera
from renderers.cpu import CpuRenderer, warmup
from renderers.drawlist import DrawList, Instance, Light, LightKind, Material, Sampler, Texture
from renderers.port import Look, Output
from renderers.studio.rig import STUDIO, Rig

FRAMES = 11
DARK = Rig(surroundings=None, shadow_size=0)
KEY = STUDIO.lights
POINT = (Light(LightKind.POINT, intensity=10.0, position=(0.0, -1.0, -2.0)),)


def median(calls: dict[str, Callable[[], object]], frames: int = FRAMES) -> dict[str, tuple[float, float]]:
    """Wall and CPU ms of each, in turn."""
    times: dict[str, list[tuple[float, float]]] = {name: [] for name in calls}
    for _ in range(frames + 2):
        for name, call in calls.items():
            wall, cpu = time.perf_counter(), time.process_time()
            call()
            times[name].append((time.perf_counter() - wall, time.process_time() - cpu))
    return {
        name: tuple(1e3 * statistics.median(t[k] for t in values[2:]) for k in (0, 1))  # type: ignore[misc]  # two of them
        for name, values in times.items()
    }


def features() -> None:
    """Prints the table of features."""
    renderer = CpuRenderer(1)
    camera = Camera(640, 480, 600.0, 600.0, 320.0, 240.0, 0.05, 10.0, np.eye(4))
    X = np.eye(4)
    X[2, 3] = 1.5
    mesh = sphere(64, 0.75)
    plain = Material((0.7, 0.6, 0.5, 1.0), metallic=0.0, roughness=0.5)
    texture = Texture(checks())

    def ball(**material: Any) -> DrawList:
        return DrawList((Instance(mesh, replace(plain, **material), X),))

    def studio(rig: Rig = DARK, **material: Any) -> tuple[DrawList, Look]:
        return ball(**material), Look("studio", rig=rig)

    lit = replace(DARK, lights=KEY)
    cases: dict[str, tuple[DrawList, Look]] = {
        "phong": (ball(), Look("phong")),
        "pbr": (ball(), Look("pbr")),
        "pbr, texture": (ball(base_color_texture=texture), Look("pbr")),
        "studio, unlit": studio(unlit=True),
        "+ bilinear texture": studio(unlit=True, base_color_texture=Texture(texture.image, Sampler(mipmaps=False))),
        "+ trilinear texture": studio(unlit=True, base_color_texture=texture),
        "studio, 1 directional light": studio(lit),
        "+ normal map": studio(lit, normal_texture=Texture(dents())),
        "1 point light": studio(replace(DARK, lights=POINT)),
        "4 directional lights": studio(replace(DARK, lights=KEY * 4)),
        "shadow map, radius 0": studio(replace(lit, shadow_size=1024, shadow_radius=0)),
        "shadow map, radius 2": studio(replace(lit, shadow_size=1024, shadow_radius=2)),
        "surroundings": studio(replace(DARK, surroundings=STUDIO.surroundings)),
        "all of the default rig": studio(STUDIO),
    }

    def draw(scene: DrawList, look: Look) -> None:
        renderer.render(scene, camera, Output.COLOR, look).close()

    with renderer.render(cases["phong"][0], camera, Output.INSTANCE | Output.DEPTH) as frame:
        assert frame.depth is not None
        pixels = int(np.isfinite(frame.depth).sum())
    times = median({name: partial(draw, *case) for name, case in cases.items()})
    print(f"{'one thread, 640x480':30}  {'ms':>7}  ns/visible pixel")
    for name, (_, cpu) in times.items():
        print(f"{name:30}  {cpu:7.2f}  {1e6 * cpu / pixels:7.1f}")


class Vtk:
    """A scene in VTK, offscreen."""

    def __init__(self, scene: DrawList, camera: Camera, samples: int, pbr: bool) -> None:
        import vtk  # type: ignore[import-not-found, unused-ignore]  # a peer's interpreter has it
        from vtk.util import numpy_support as convert  # type: ignore[import-not-found, unused-ignore]

        self._window = window = vtk.vtkRenderWindow()
        window.SetOffScreenRendering(1)
        window.SetMultiSamples(samples)
        window.SetSize(camera.width, camera.height)
        renderer = vtk.vtkRenderer()
        window.AddRenderer(renderer)
        self._image = vtk.vtkWindowToImageFilter()
        self._image.SetInput(window)
        self._image.ReadFrontBufferOff()
        self._image.ShouldRerenderOff()
        self._convert = convert
        for instance in scene.instances:
            mesh = instance.mesh
            data = vtk.vtkPolyData()
            points = vtk.vtkPoints()
            points.SetData(convert.numpy_to_vtk(mesh.positions, deep=1))
            data.SetPoints(points)
            cells = vtk.vtkCellArray()
            flat = np.hstack((np.full((len(mesh.elements), 1), 3), mesh.elements)).astype(np.int64).ravel()
            cells.SetCells(len(mesh.elements), convert.numpy_to_vtkIdTypeArray(flat, deep=1))
            data.SetPolys(cells)
            data.GetPointData().SetNormals(convert.numpy_to_vtk(mesh.normals, deep=1))
            mapper = vtk.vtkPolyDataMapper()
            mapper.SetInputData(data)
            actor = vtk.vtkActor()
            actor.SetMapper(mapper)
            matrix = vtk.vtkMatrix4x4()
            matrix.DeepCopy(instance.X_world_mesh.ravel().tolist())
            actor.SetUserMatrix(matrix)
            if pbr:
                actor.GetProperty().SetInterpolationToPBR()
            actor.GetProperty().SetColor(*instance.material.base_color[:3])
            renderer.AddActor(actor)
        self._camera = renderer.GetActiveCamera()
        X = camera.X_world_camera
        self._camera.SetPosition(*X[:3, 3])
        self._camera.SetFocalPoint(*(X[:3, 3] + X[:3, 2]))
        self._camera.SetViewUp(*(-X[:3, 1]))
        self._camera.SetViewAngle(2 * np.degrees(np.arctan(0.5 * camera.height / camera.fy)))
        self._camera.SetClippingRange(camera.near, camera.far)
        self._angle = 0.1

    def draw(self) -> Any:
        """One frame, read back."""
        self._angle = -self._angle
        self._camera.Azimuth(self._angle)
        self._window.Render()
        self._image.Modified()
        self._image.Update()
        return self._convert.vtk_to_numpy(self._image.GetOutput().GetPointData().GetScalars())


class OpenGl4:
    """``bench.raster``'s shader, colour only, with 4 samples."""

    def __init__(self, scene: DrawList, camera: Camera) -> None:
        from bench.raster import OpenGl

        gl = self._gl = OpenGl(scene, camera.width, camera.height)
        size = (camera.width, camera.height)
        self._color, self._picture = gl.targets[0], gl.pictures[0]
        gl.targets, gl.pictures = [], []
        self._single = gl.context.framebuffer([self._color])
        gl.buffer = gl.context.framebuffer(
            [gl.context.renderbuffer(size, 4, samples=4)], gl.context.depth_renderbuffer(size, samples=4)
        )
        self._camera = camera
        self.draw()
        if np.ptp(self._picture) == 0:
            raise RuntimeError("multisampling draws nothing here")

    def draw(self) -> None:
        """One frame, resolved and read back."""
        self._gl.draw(self._camera)
        self._gl.context.copy_framebuffer(self._single, self._gl.buffer)
        self._color.read_into(self._picture)


def frames(threads: int | None) -> None:
    """Prints whole frames against the peers."""
    renderer = CpuRenderer(threads)
    scene = scenes()["101 objects"]
    print(f"\n{'101 objects, colour':34}  {'ours, ms wall/CPU':>18}  {'peer':>18}  ratio")
    for width, height in ((640, 480), (1280, 960)):
        camera = view(width, height, 0)
        peers: list[tuple[str, Look, Callable[[], Any]]] = [
            ("VTK PBR", Look("pbr"), lambda c=camera: Vtk(scene, c, 0, True)),
            ("VTK, 8 samples", Look("phong", samples=8), lambda c=camera: Vtk(scene, c, 8, False)),
            ("llvmpipe, 4 samples", Look("phong", samples=4), lambda c=camera: OpenGl4(scene, c)),
        ]
        for name, look, make in peers:
            try:
                peer = make()
            except (ImportError, RuntimeError, ValueError) as error:
                print(f"{name}: {error}", file=sys.stderr)
                continue

            def ours(look: Look = look, camera: Camera = camera) -> None:
                renderer.render(scene, camera, Output.COLOR, look).close()

            times = median({"ours": ours, "peer": peer.draw})
            cells = "  ".join(f"{wall:8.2f}/{cpu:9.2f}" for wall, cpu in times.values())
            ratio = "/".join(f"{theirs / our:.1f}" for theirs, our in zip(times["peer"], times["ours"], strict=True))
            print(f"{name + f' {width}x{height}':34}  {cells}  {ratio}", flush=True)


def main() -> None:
    warmup()
    features()
    frames(int(sys.argv[1]) if len(sys.argv) > 1 else None)


if __name__ == "__main__":
    main()
