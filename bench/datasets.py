"""Samples per second of ``scenegate render`` beside pyrender: scenes of ten textured objects, 640x480.

    python -m bench.datasets [--samples 1000] [--peers PYTHON]

PYTHON is an interpreter with pyrender, Pillow and OpenCV. Ours writes colour, depth, instances and normals with poses,
boxes and visible fractions of all objects. pyrender draws colour, depth and a segmentation of the same views, without
normals, shadows or annotations, and writes them with OpenCV; as many processes as cores, each with its own share. Both
include start, reading and writing. Ours comes first, since pyrender takes the views from its manifest.
"""

import argparse
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np
import trimesh as typed_trimesh
from PIL import Image

from bench.table import Row, show
from gateway.runtime.workers.scheduling import usable_cpus

trimesh: Any = typed_trimesh  # typed in parts
SCENES = 10
OBJECTS = 10
PEER = Path(__file__).with_name("datasets_peer.py")


def scene(seed: int) -> Any:
    """Return ten objects of 1,000 to 5,000 triangles on a floor, each with a texture of its own."""
    rng = np.random.default_rng(seed)
    result = trimesh.Scene()
    floor = trimesh.creation.box((2.0, 2.0, 0.02))
    floor.apply_translation((0.0, 0.0, -0.01))
    result.add_geometry(floor, node_name="floor")
    for k in range(OBJECTS):
        mesh = trimesh.creation.uv_sphere(0.1, count=(int(rng.integers(24, 50)),) * 2)
        mesh.apply_scale(rng.uniform(0.6, 1.3, 3))
        side = 512
        texture = np.repeat(np.repeat(rng.integers(0, 255, (16, 16, 3), np.uint8), side // 16, 0), side // 16, 1)
        uv = np.column_stack((np.arctan2(mesh.vertices[:, 1], mesh.vertices[:, 0]) / 6.2832 + 0.5, mesh.vertices[:, 2]))
        material = trimesh.visual.material.PBRMaterial(
            baseColorTexture=Image.fromarray(texture), metallicFactor=0.0, roughnessFactor=0.6
        )
        mesh.visual = trimesh.visual.TextureVisuals(uv, material=material)
        angle = 2.0 * np.pi * k / OBJECTS
        pose = trimesh.transformations.rotation_matrix(rng.uniform(0, 6), rng.normal(size=3))
        pose[:3, 3] = 0.35 * np.cos(angle), 0.35 * np.sin(angle), 0.1
        result.add_geometry(mesh, node_name=f"object-{k}", geom_name=f"object-{seed}-{k}", transform=pose)
    # glTF is Y up.
    result.apply_transform(trimesh.transformations.rotation_matrix(-np.pi / 2, (1, 0, 0)))
    return result


def timed(commands: list[list[str]], **environment: str) -> float:
    """Run commands side by side; return seconds."""
    begin = time.perf_counter()
    running = [subprocess.Popen(command, env={**os.environ, **environment}) for command in commands]
    codes = [process.wait() for process in running]
    if any(codes):
        sys.exit(f"{commands[0][0]} failed")
    return time.perf_counter() - begin


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--samples", type=int, default=1000)
    parser.add_argument("--peers", metavar="PYTHON", help="interpreter with pyrender")
    options = parser.parse_args()
    views, cores = max(options.samples // SCENES, 1), usable_cpus()
    samples = views * SCENES
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        (folder / "scenes").mkdir()
        for seed in range(SCENES):
            scene(seed).export(folder / "scenes" / f"scene-{seed:02d}.glb")
        command = [sys.executable, "-m", "scenegate", "render", str(folder / "scenes"), "--orbit", str(views)]
        command += ["--type", "color,depth,instance,normal"]
        rates = {
            look: samples / timed([[*command, "-o", str(folder / look), "--look", look]]) for look in ("studio", "gltf")
        }
        if options.peers:
            manifest = str(folder / "studio" / "manifest.jsonl")
            shares = [
                [
                    options.peers,
                    str(PEER),
                    str(folder / "scenes"),
                    manifest,
                    str(folder / f"peer-{k}"),
                    str(k),
                    str(cores),
                ]
                for k in range(cores)
            ]
            rates["pyrender"] = samples / timed(shares, PYOPENGL_PLATFORM="egl", LP_NUM_THREADS="1")
        print(f"{samples} samples of {SCENES} scenes, {cores} cores, load {os.getloadavg()[0]:.1f}")
        theirs = f"pyrender {1e3 / rates['pyrender']:.0f} ms" if options.peers else ""
        show(Row(f"sample of a dataset, {what}", f"{1e3 / rates[what]:.0f} ms", theirs) for what in ("studio", "gltf"))


if __name__ == "__main__":
    main()
