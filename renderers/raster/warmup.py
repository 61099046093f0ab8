"""Compilation of all kernels, and the first images of a process."""

import numpy as np

import renderers.depth_range
import renderers.fxaa  # noqa: F401 - both define kernels
from renderers.camera import Camera
from renderers.compiler.jit import compile_all
from renderers.drawlist import DrawList, Instance, Material, Mesh
from renderers.interface import Look, Output
from renderers.raster.renderer import CpuRenderer


def warmup() -> None:
    """Compile every kernel that a render can call, or load it from the cache, and render the first images.

    Takes up to a minute of one core if the cache is empty, and holds the GIL: run it in a process of its own then.
    """
    compile_all()
    everything = Output.COLOR | Output.DEPTH | Output.LABEL | Output.INSTANCE | Output.NORMAL
    render_first_images(everything)
    # Not the studio look: filtering its environment takes half a second.
    _render(everything, Look("pbr", samples=4))


def render_first_images(outputs: Output = Output.COLOR | Output.DEPTH | Output.LABEL) -> None:
    """Render small images, which imports and initialises what the first request would wait for."""
    _render(outputs, Look("phong"))
    _render(outputs, Look("pbr"))


def _render(outputs: Output, look: Look) -> None:
    corners = np.array(((-1, -1, 2), (1, -1, 2), (1, 1, 2)), dtype=np.float32)
    instances = tuple(
        Instance(Mesh(corners, np.arange(n, dtype=np.uint32)[None]), Material(), np.eye(4)) for n in (1, 2, 3)
    )
    camera = Camera(16, 16, 16.0, 16.0, 8.0, 8.0, 0.1, 10.0, np.eye(4))
    CpuRenderer(threads=1).render(DrawList(instances), camera, outputs, look)
