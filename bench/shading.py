"""Shading: nanoseconds a visible pixel by feature, and whole frames against VTK and llvmpipe with multisampling.

    python -m bench.shading [--peers PYTHON] [--threads 2] [--frames 11]

First, one thread on a screen full of one sphere: what each step of the studio look adds, and Drake's looks beside it
(medians of CPU time, divided by the pixels that are covered). Then whole frames of a hundred and one objects, colour
read back, in turn: VTK's physically based shading, VTK with 8 samples and llvmpipe through OpenGL with 4 samples,
against ours with the same number of samples. Each peer is a process of its own (``raster_peer.py``); PYTHON is an
interpreter that has vtk, moderngl runs in this one. Figures are medians in ms, wall and CPU of all threads; ``ratio``
is theirs over ours, wall/CPU.
"""

import argparse
import sys
import tempfile
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from bench.raster import SIZES, Process, scenes, view, write
from bench.table import Row, at_least, show, skipped
from bench.turns import Time, in_turns, median, timed
from gateway.runtime.workers.process_tuning import tune
from renderers.camera import Camera
from renderers.drawlist import AlphaMode, DrawList, Instance, Light, LightKind, Material, Sampler, Texture
from renderers.interface import Look, Output
from renderers.light_rig import STUDIO, Rig
from renderers.raster import CpuRenderer, warmup
from tools.pictures.gallery import checks, dents, sphere

FRAMES = 11
DARK = Rig(surroundings=None, shadow_size=0)
KEY = STUDIO.lights
POINT = (Light(LightKind.POINT, intensity=10.0, position=(-0.5, -2.0, 1.0)),)


def features() -> None:
    """Prints the table of features."""
    renderer = CpuRenderer(1)
    ahead = np.array(((1.0, 0.0, 0.0, 0.0), (0.0, 0.0, 1.0, -1.5), (0.0, -1.0, 0.0, 0.0), (0.0, 0.0, 0.0, 1.0)))
    camera = Camera(640, 480, 600.0, 600.0, 320.0, 240.0, 0.05, 10.0, ahead)
    X = np.eye(4)
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
        "pbr, translucent": (ball(base_color=(0.7, 0.6, 0.5, 0.5), alpha_mode=AlphaMode.BLEND), Look("pbr")),
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
        "all of the default rig, 8 samples": (ball(), Look("studio", rig=STUDIO, samples=8)),
    }

    def draw(scene: DrawList, look: Look) -> None:
        renderer.render(scene, camera, Output.COLOR, look)

    frame = renderer.render(cases["phong"][0], camera, Output.INSTANCE | Output.DEPTH)
    assert frame.depth is not None
    pixels = int(np.isfinite(frame.depth).sum())

    def draw_anew() -> None:
        """With a shadow map of its own: maps are kept while a scene is."""
        scene = replace(cases["phong"][0])
        draw(scene, Look("studio", rig=STUDIO))

    calls = {name: partial(draw, *case) for name, case in cases.items()}
    cases_and_calls = {**calls, "all of the default rig, a new scene": draw_anew}
    in_order = {name: lambda _, call=call: timed(call) for name, call in cases_and_calls.items()}
    times = {name: median(values) for name, values in in_turns(in_order, FRAMES, warm=2, turn=1).items()}
    print(f"{'one thread, 640x480':36}  {'ms':>7}  ns/visible pixel")
    for name, (_, cpu) in times.items():
        print(f"{name:36}  {cpu:7.2f}  {1e6 * cpu / pixels:7.1f}")


PEERS: dict[str, tuple[str, Look, float]] = {
    "vtk-pbr": ("VTK PBR", Look("pbr"), 8.0),
    "vtk-8": ("VTK, 8 samples", Look("phong", samples=8), 9.0),
    "moderngl-4": ("llvmpipe, 4 samples", Look("phong", samples=4), 4.0),
}
"""Display name, our look that does equal work, and the goal."""


def frames(threads: int, python: str | None, count: int) -> list[Row]:
    """Prints whole frames against the peers; the rows of their ratios by CPU time."""
    renderer = CpuRenderer(threads)
    scene = scenes()["50k"]
    rows: list[Row] = []
    print(f"\n{'101 objects, colour, ms wall/CPU':34}  {'ours':>18}  {'peer':>18}  ratio")
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "scene.npz"
        write(scene, path)
        for kind, (name, look, goal) in PEERS.items():
            try:
                peer = Process.start(sys.executable if kind.startswith("moderngl") else python or "", kind)
            except (OSError, RuntimeError) as error:
                rows.append(skipped(name, str(error) if python else "no --peers"))
                continue
            for width, height in SIZES:
                peer.ask(f"load {path} {width} {height}")

                def ours(frame: int, look: Look = look, width: int = width, height: int = height) -> Time:
                    camera = view(width, height, frame)
                    return timed(lambda: renderer.render(scene, camera, Output.COLOR, look))

                def theirs(frame: int, peer: Process = peer) -> Time:
                    return peer.ask(f"draw {frame}")

                medians = [median(times) for times in in_turns({"ours": ours, "theirs": theirs}, count).values()]
                wall, cpu = (other / our for our, other in zip(*medians, strict=True))
                cells = "  ".join(f"{each[0]:8.2f}/{each[1]:9.2f}" for each in medians)
                print(f"{name + f' {width}x{height}':34}  {cells}  {wall:.1f}/{cpu:.1f}", flush=True)
                what = f"frame, 101 objects, {width}x{height}, {look.name} x{look.samples} (by CPU time {cpu:.1f}×)"
                rows.append(at_least(what, f"{medians[0].wall:.2f} ms", f"{name} {medians[1].wall:.2f} ms", wall, goal))
            peer.close()
    return rows


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--peers", help="a Python that has vtk")
    parser.add_argument("--threads", type=int, default=2, help="ours; llvmpipe takes what LP_NUM_THREADS says, or all")
    parser.add_argument("--frames", type=int, default=FRAMES)
    parser.add_argument("--part", choices=("features", "frames"), help="only this one")
    options = parser.parse_args()
    tune()  # malloc as in a server: without, frames of eight samples take up to four times as long
    warmup()
    if options.part in (None, "features"):
        features()
    if options.part in (None, "frames"):
        show(frames(options.threads, options.peers, options.frames))


if __name__ == "__main__":
    main()
