"""After ``warmup`` nothing is compiled by a process that finds the cache."""

import subprocess
import sys

import pytest

from gateway.runtime.kernels import parts
from tests.support.waiting import SECONDS

PROGRAM = """
from renderers.raster import warmup
warmup()
from numba.core.event import install_recorder
import numpy as np
from renderers.camera import Camera
from renderers.raster import CpuRenderer
from renderers.drawlist import AlphaMode, DrawList, Instance, Material, Mesh
from renderers.interface import Look, Output

corners = np.array(((-1, -1, 2), (1, -1, 2), (1, 1, 2), (-1, 1, 1)), dtype=np.float32)
instances = tuple(
    Instance(
        Mesh(corners, np.arange(n, dtype=np.uint32)[None], corners if smooth else None, corners[:, :2].copy()),
        Material(base_color=(1, 0, 0, 0.5), alpha_mode=mode, double_sided=double),
        np.eye(4),
    )
    for n in (1, 2, 3)
    for smooth in (False, True)
    for mode in AlphaMode
    for double in (False, True)
)
opaque = tuple(i for i in instances if i.material.alpha_mode is AlphaMode.OPAQUE)
camera = Camera(40, 30, 40.0, 40.0, 20.0, 15.0, 0.1, 10.0, np.eye(4))
everything = Output.COLOR | Output.DEPTH | Output.LABEL | Output.INSTANCE | Output.NORMAL
with install_recorder("numba:compile") as recorder:
    for threads in (1, 2):
        renderer = CpuRenderer(threads)
        for look in (Look("phong"), Look("pbr", samples=4), Look("pbr"), Look("studio", samples=4)):
            for outputs in (everything, Output.DEPTH, Output.COLOR):
                renderer.render(DrawList(instances), camera, outputs, look)
                renderer.render(DrawList(opaque), camera, outputs, look)
        renderer.close()
print(len(recorder.buffer), "compilations")

from renderers.compiler.jit import KERNELS
assert KERNELS
for kernel in KERNELS:
    assert len(kernel.signatures) == 1, (kernel, kernel.signatures)
print(sum(sum(k.stats.cache_misses.values()) for k in KERNELS), "misses")
"""


def _run(program: str = PROGRAM) -> list[str]:
    done = subprocess.run([sys.executable, "-c", program], check=True, capture_output=True, text=True, timeout=SECONDS)
    return done.stdout.splitlines()


@pytest.mark.slow
def test_nothing_is_compiled_after_warmup() -> None:
    parts.ensure_compiled()
    assert _run() == ["0 compilations", "0 misses"]
    # Whoever does not load them all beforehand finds the same ones at the first call.
    assert _run(PROGRAM.replace("warmup()\n", "", 1).replace("== 1,", "<= 1,"))[1] == "0 misses"
