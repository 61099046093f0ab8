"""A share of the samples of ``datasets.py``, drawn by pyrender.

    python bench/datasets_peer.py SCENES MANIFEST OUT SHARE SHARES

Needs nothing of the repository, so that it runs in pyrender's own environment.
"""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pyrender
import trimesh as typed_trimesh

trimesh: Any = typed_trimesh  # typed in parts
OPENGL_FROM_OPTICAL = np.diag((1.0, -1.0, -1.0, 1.0))
Y_UP_FROM_Z_UP = trimesh.transformations.rotation_matrix(-np.pi / 2, (1, 0, 0))


def main() -> None:
    scenes, manifest, out, share, shares = sys.argv[1:]
    Path(out).mkdir()
    samples = [json.loads(line) for line in Path(manifest).read_text().splitlines()]
    renderer: Any = None
    last = ""
    scene: Any = None
    labels: dict[Any, tuple[int, int, int]] = {}
    count = -(-len(samples) // int(shares))
    for number, sample in enumerate(samples[count * int(share) : count * (int(share) + 1)]):
        camera = sample["camera"]
        if sample["scene"] != last:
            last = sample["scene"]
            scene = pyrender.Scene.from_trimesh_scene(trimesh.load(Path(scenes) / last), bg_color=(0.8, 0.9, 1.0))
            labels = {node: (k + 1, 0, 0) for k, node in enumerate(scene.mesh_nodes)}
        renderer = renderer or pyrender.OffscreenRenderer(camera["width"], camera["height"])
        pose = Y_UP_FROM_Z_UP @ np.array(camera["X_world_camera"]) @ OPENGL_FROM_OPTICAL
        lens = pyrender.IntrinsicsCamera(camera["fx"], camera["fy"], camera["cx"], camera["cy"], 0.05, 10.0)
        nodes = [scene.add(lens, pose=pose), scene.add(pyrender.DirectionalLight(intensity=3.0), pose=pose)]
        color, depth = renderer.render(scene)
        segmentation, _ = renderer.render(scene, flags=pyrender.RenderFlags.SEG, seg_node_map=labels)
        for node in nodes:
            scene.remove_node(node)
        cv2.imwrite(f"{out}/{number}.color.png", color[..., ::-1])
        cv2.imwrite(f"{out}/{number}.depth.tiff", depth)
        cv2.imwrite(f"{out}/{number}.instance.png", np.ascontiguousarray(segmentation[..., 0]))


if __name__ == "__main__":
    main()
