"""Drawing: our rasterizer against other renderers, in one run, a few frames each in turn.

    python -m bench.raster [--peers PYTHON] [--threads 2] [--frames 25]

All draw the same warm scenes (one head light, fronts only) into arrays: colour, depth and label, in panda3d's case
colour only. Each peer is a process of its own (``raster_peer.py``) whose context or window lives on: moderngl on EGL,
one pass into three targets; VTK, a lit pass with its depth and a flat pass of labels; panda3d's software renderer.
PYTHON is an interpreter that has vtk and panda3d; moderngl runs in this one. Every frame has another camera. Figures
are medians in ms, wall and CPU of all threads; the ratio is the peer's over ours.
"""

from __future__ import annotations

import argparse
import math
import subprocess
import sys
import tempfile
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from bench.table import Row, at_least, at_most, geometric_mean, show, skipped
from bench.turns import Time, in_turns, median, timed
from gateway.runtime.workers.process_tuning import tune
from renderers.camera import Camera
from renderers.drawlist import DrawList, Image, Instance, Material, Mesh, Sampler, Texture
from renderers.interface import Look, Output
from renderers.raster import CpuRenderer, warmup

SIZES = ((640, 480), (1280, 960))
OURS = "ours"
GOALS = {"moderngl": (4.0, 3.0), "vtk": (10.0, 7.0), "panda3d": (2.0, 1.0)}
"""Geometric mean, and the least of any row."""
MIPMAPPED = "20k mipmapped"
EVERYTHING = Output.COLOR | Output.DEPTH | Output.LABEL


def sphere(columns: int, rows: int, bumps: float = 0.0) -> Mesh:
    """Around the origin, with shared vertices, normals and texture coordinates; fronts outside."""
    u, v = np.meshgrid(np.linspace(0, 2 * np.pi, columns + 1), np.linspace(0, np.pi, rows + 1))
    n = np.stack((np.cos(u) * np.sin(v), np.sin(u) * np.sin(v), np.cos(v)), axis=-1)
    points = n * (1 + bumps * np.sin(9 * u) * np.sin(7 * v))[..., None]
    a = (np.arange(rows)[:, None] * (columns + 1) + np.arange(columns)).ravel()
    below = a + columns + 1
    elements = np.concatenate((np.stack((a, below, a + 1), 1), np.stack((a + 1, below, below + 1), 1)))
    uv = np.stack((u / (2 * np.pi), v / np.pi), axis=-1)
    positions, normals, uv0 = (x.reshape(u.size, -1).astype(np.float32) for x in (points, n, uv))
    return Mesh(positions, elements.astype(np.uint32), normals, uv0)


def pattern(size: int) -> np.ndarray[Any, Any]:
    """(size, size, 4) uint8: smooth waves with grain, opaque."""
    y, x = np.mgrid[0:size, 0:size] / size
    grain = np.random.default_rng(1).normal(scale=12.0, size=(size, size, 3))
    waves = np.stack((np.sin(40 * x), np.sin(31 * y), np.sin(23 * (x + y))), axis=-1)
    pixels = np.full((size, size, 4), 255, np.uint8)
    pixels[..., :3] = np.clip(128 + 90 * waves + grain, 0, 255)
    return pixels


def scenes() -> dict[str, DrawList]:
    """Ten objects, a hundred and one, one mesh of a million triangles, and a ball with a picture on it."""
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
        looks = [Material((*rng.uniform(0.2, 1.0, 3), 1.0)) for _ in range(count + 1)]
        balls = [Instance(mesh, looks[k], at(places[k], scale), k, k) for k in range(count)]
        return DrawList((*balls, Instance(wall, looks[-1], np.eye(4), count, count)))

    fine = Instance(sphere(1000, 501, 0.1), Material((0.5, 0.5, 0.9, 1.0)), at((0, 0, 0), 1.3), 1, 1)
    pixels = pattern(2048)
    image = Image(b"pattern", lambda: pixels)
    painted = Material(base_color_texture=Texture(image, Sampler(mipmaps=False)))
    mipmapped = Material(base_color_texture=Texture(image))
    return {
        "5k": some(9, sphere(24, 12), 0.5, 1.2),
        "50k": some(100, sphere(24, 10), 0.3, 2.0),
        "1M": DrawList((fine,)),
        "20k textured": DrawList((Instance(sphere(101, 100), painted, at((0, 0, 0), 1.3), 1, 1),)),
        MIPMAPPED: DrawList((Instance(sphere(101, 100), mipmapped, at((0, 0, 0), 1.3), 1, 1),)),
    }


def view(width: int, height: int, frame: int) -> Camera:
    """Nearly the same every frame."""
    X = np.eye(4)
    X[:3, 3] = 0.01 * math.sin(frame), 0.01 * math.cos(frame), -3.0
    return Camera(width, height, 0.9 * width, 0.9 * width, width / 2, height / 2, 0.05, 10.0, X)


def write(scene: DrawList, path: Path) -> None:
    """Write the scene for ``raster_peer.py``: meshes by number; mesh, pose, colour and label of each instance."""
    meshes = list(dict.fromkeys(i.mesh for i in scene.instances))
    arrays: dict[str, Any] = {"meshes": len(meshes)}
    for k, mesh in enumerate(meshes):
        arrays |= {f"positions{k}": mesh.positions, f"normals{k}": mesh.normals, f"elements{k}": mesh.elements}
        if mesh.uv0 is not None:
            arrays[f"uv{k}"] = mesh.uv0
    texture = scene.instances[0].material.base_color_texture
    if texture is not None:
        arrays["texture"] = texture.image.decode()
        arrays["mipmaps"] = np.array(texture.sampler.mipmaps)
    arrays["mesh"] = [meshes.index(i.mesh) for i in scene.instances]
    arrays["pose"] = [i.X_world_mesh for i in scene.instances]
    arrays["color"] = [i.material.base_color[:3] for i in scene.instances]
    arrays["label"] = [i.label for i in scene.instances]
    np.savez(path, **arrays)


@dataclass(slots=True)
class Process:
    """A peer at work."""

    pipe: subprocess.Popen[str]

    @staticmethod
    def start(python: str, name: str) -> Process:
        """Raises RuntimeError when it does not come up: the renderer is not installed, or finds no EGL."""
        script = str(Path(__file__).with_name("raster_peer.py"))
        pipe = subprocess.Popen(
            [python, script, name],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            text=True,
            bufsize=1,
        )
        process = Process(pipe)
        if process._line() != "ready":
            raise RuntimeError(f"{name} did not start")
        return process

    def ask(self, command: str) -> Time:
        """Return the time of a command as the peer says it."""
        assert self.pipe.stdin is not None
        self.pipe.stdin.write(command + "\n")
        self.pipe.stdin.flush()
        return Time(*map(float, self._line().split()))

    def _line(self) -> str:
        assert self.pipe.stdout is not None
        line = self.pipe.stdout.readline()
        if not line:
            raise RuntimeError("the peer ended")
        return line.strip()

    def close(self) -> None:
        assert self.pipe.stdin is not None
        self.pipe.stdin.close()
        self.pipe.wait()


def drawn(renderer: CpuRenderer, scene: DrawList, camera: Camera) -> Time:
    """Time of one of our frames with all outputs."""
    return timed(lambda: renderer.render(scene, camera, EVERYTHING, Look()))


def measured(
    renderer: CpuRenderer, scene: DrawList, peers: dict[str, Process], width: int, height: int, frames: int
) -> dict[str, Time]:
    """Median times of ours and the peers."""
    calls = {OURS: lambda frame: drawn(renderer, scene, view(width, height, frame))}
    for name, peer in peers.items():
        calls[name] = partial(lambda peer, frame: peer.ask(f"draw {frame}"), peer)
    return {name: median(times) for name, times in in_turns(calls, frames).items()}


def moved(renderer: CpuRenderer, scene: DrawList, frames: int) -> float:
    """Our time for a scene whose meshes were seen and whose poses are new, over that of the unchanged one."""
    camera = view(640, 480, 0)

    def changed(frame: int) -> Time:
        X = np.eye(4)
        X[0, 3] = 0.001 * frame
        other = DrawList(tuple(Instance(i.mesh, i.material, X @ i.X_world_mesh, i.label) for i in scene.instances))
        return drawn(renderer, other, camera)

    times = in_turns({"changed": changed, "same": lambda _: drawn(renderer, scene, camera)}, frames, turn=1)
    return median(times["changed"]).wall / median(times["same"]).wall


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--peers", help="a Python that has vtk and panda3d")
    parser.add_argument("--threads", type=int, default=2, help="ours; llvmpipe takes what LP_NUM_THREADS says, or all")
    parser.add_argument("--frames", type=int, default=25)
    options = parser.parse_args()
    tune()  # malloc as in a server: without, rows with four samples vary by 1.4 times
    warmup()
    renderer = CpuRenderer(options.threads)
    rows: list[Row] = []
    peers: dict[str, Process] = {}
    for name in GOALS:
        try:
            peers[name] = Process.start(sys.executable if name == "moderngl" else options.peers or "", name)
        except (OSError, RuntimeError) as error:
            rows.append(skipped(f"frames against {name}", str(error) if options.peers else "no --peers"))
    ratios: dict[str, list[float]] = {name: [] for name in peers}
    processor: dict[str, list[float]] = {name: [] for name in peers}
    everything = scenes()
    print(f"{'ms wall/CPU':20}" + "".join(f"{name:>18}" for name in (OURS, *peers)), flush=True)
    with tempfile.TemporaryDirectory() as folder:
        for name, scene in everything.items():
            path = Path(folder) / "scene.npz"
            write(scene, path)
            for width, height in SIZES:
                for peer in peers.values():
                    peer.ask(f"load {path} {width} {height}")
                medians = measured(renderer, scene, peers, width, height, options.frames)
                cells = "".join(f"{f'{wall:.2f}/{cpu:.2f}':>18}" for wall, cpu in medians.values())
                print(f"{name:12} {width:4}x{height:<4}" + cells, flush=True)
                for peer_name in peers:
                    wall, cpu = (theirs / our for theirs, our in zip(medians[peer_name], medians[OURS], strict=True))
                    if name != MIPMAPPED:  # the goals of the means are older than this scene
                        ratios[peer_name].append(wall)
                        processor[peer_name].append(cpu)
                    what = f"frame, {name} triangles, {width}x{height}"
                    least = GOALS[peer_name][1]
                    shown = f"{peer_name} {medians[peer_name][0]:.2f} ms; by CPU time {cpu:.1f}×"
                    rows.append(at_least(what, f"{medians[OURS][0]:.2f} ms", shown, wall, least))
    for peer_name, values in ratios.items():
        cpu, least_cpu = geometric_mean(processor[peer_name]), min(processor[peer_name])
        least_text = f"least {min(values):.1f}×; by CPU time {cpu:.1f}×, least {least_cpu:.1f}×"
        what = f"frames without mip levels, geometric mean ({least_text})"
        rows.append(at_least(what, "", peer_name, geometric_mean(values), GOALS[peer_name][0]))
    ratio = moved(renderer, everything["50k"], options.frames)
    rows.append(at_most("frame of moved meshes over that of the same scene", ratio, 1.5, "×"))
    for peer in peers.values():
        peer.close()
    show(rows)


if __name__ == "__main__":
    main()
