"""Draws something with every kernel, so that each gets compiled into the cache, or loaded from it."""

from __future__ import annotations

from typing import get_args

import numpy as np

from gateway.ops import kernels
from renderers.camera import Camera
from renderers.drawlist import AlphaMode, DrawList, Image, Instance, Material, Mesh, Sampler, Texture
from renderers.port import Look, LookName, Output


def run() -> None:
    """Blocks until every kernel is loaded. In a serving process: only when ``kernels.are_cached``."""
    kernels.configure()
    from renderers.cpu import CpuRenderer

    renderer = CpuRenderer(1)
    scene = _scene()
    camera = Camera(64, 48, 50.0, 50.0, 32.0, 24.0, 0.1, 10.0, np.eye(4))
    everything = Output.COLOR | Output.DEPTH | Output.LABEL | Output.INSTANCE | Output.NORMAL
    for outputs in (everything, Output.COLOR, Output.DEPTH, Output.LABEL, Output.INSTANCE, Output.NORMAL):
        for name in get_args(LookName):
            renderer.render(scene, camera, outputs, Look(name)).close()


def _scene() -> DrawList:
    """Triangles (plain, coloured, textured, cut out, blended, mirrored, across the near plane), lines and points."""
    corners = np.array([(-1, -1, 2), (1, -1, 2), (1, 1, 3), (-1, 1, -1)], np.float32)
    faces = np.array([(0, 1, 2), (0, 2, 3)], np.uint32)
    uv = np.array([(0, 0), (3, 0), (3, 3), (0, 3)], np.float32)
    normals = np.tile(np.array((0, 0, -1), np.float32), (4, 1))
    colors = np.full((4, 4), 0.5, np.float32)
    plain = Mesh(corners, faces, normals)
    rich = Mesh(corners, faces, normals, uv0=uv, uv1=uv, colors=colors)
    pixels = np.full((4, 4, 4), 128, np.uint8)
    image = Image(b"warm-up", lambda: pixels, "warm-up")
    smooth = Texture(image)
    blocky = Texture(image, Sampler(mag_linear=False, min_linear=False, mipmaps=False))
    materials = [
        (plain, Material()),
        (Mesh(corners, faces), Material(double_sided=True)),
        (rich, Material(base_color_texture=blocky, unlit=True)),
        (
            rich,
            Material(
                base_color_texture=smooth,
                metallic_roughness_texture=smooth,
                normal_texture=smooth,
                occlusion_texture=smooth,
                emissive_texture=smooth,
            ),
        ),
        (rich, Material(base_color_texture=smooth, alpha_mode=AlphaMode.MASK)),
        (rich, Material((1.0, 1.0, 1.0, 0.5), base_color_texture=smooth, alpha_mode=AlphaMode.BLEND)),
        (plain, Material((1.0, 1.0, 1.0, 0.5), alpha_mode=AlphaMode.BLEND)),
        (Mesh(corners, np.array([(0, 1), (2, 3)], np.uint32)), Material(line_width=2.0)),
        (Mesh(corners, np.arange(4, dtype=np.uint32)[:, None], colors=colors), Material(point_size=3.0)),
    ]
    poses = (np.eye(4), np.diag((-1.0, 1.0, 1.0, 1.0)))
    instances = tuple(
        Instance(mesh, material, pose, label=i, instance_id=i)
        for i, (mesh, material) in enumerate(materials)
        for pose in poses
    )
    return DrawList(instances, (image,))
