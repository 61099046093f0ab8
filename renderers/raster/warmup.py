"""Filling the kernel cache, so that nothing is compiled while serving."""

from __future__ import annotations

import numpy as np

import renderers.depth_range
import renderers.fxaa  # noqa: F401 - their kernels are some of all
from renderers.camera import Camera
from renderers.compiler.jit import compile_all
from renderers.drawlist import DrawList, Instance, Material, Mesh
from renderers.interface import Look, Output
from renderers.raster.renderer import CpuRenderer
from renderers.shading import warmup as warm_shading


def warmup() -> None:
    """Compile every kernel that a render can call, or load it from the cache. Takes up to a minute of one core when
    the cache is empty; run it in a process of its own, since compiling holds the GIL."""
    compile_all()
    warm_shading()
    corners = np.array(((-1, -1, 2), (1, -1, 2), (1, 1, 2)), dtype=np.float32)
    instances = tuple(
        Instance(Mesh(corners, np.arange(n, dtype=np.uint32)[None]), Material(), np.eye(4)) for n in (1, 2, 3)
    )
    camera = Camera(16, 16, 16.0, 16.0, 8.0, 8.0, 0.1, 10.0, np.eye(4))
    renderer = CpuRenderer(threads=1)
    everything = Output.COLOR | Output.DEPTH | Output.LABEL | Output.INSTANCE | Output.NORMAL
    # Not the studio look: its kernels are loaded, too, but its surroundings take half a second, and few ask for it.
    for look in (Look("phong"), Look("pbr", samples=4)):
        renderer.render(DrawList(instances), camera, everything, look).close()
