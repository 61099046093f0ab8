"""Renders from several threads at a time, and ends with 1 if images differ from those of one thread.

Run by ``test_concurrent_frames`` in a process of its own, where the C library overwrites memory that is freed.
"""

import itertools
import random
import sys
import threading
from typing import get_args

import numpy as np

from renderers.drawlist import DrawList
from renderers.interface import Look, LookName, Output, SampleCount
from renderers.light_rig import CameraLight
from renderers.raster import CpuRenderer
from tests.renderers.scenes import images
from tests.renderers.shading.test_layers import VIEW, crossing
from tests.renderers.shading.test_pixels import random_scene

THREADS = 4
FRAMES = 150
"""Number of frames of each thread."""
OUTPUTS = Output.COLOR | Output.DEPTH | Output.LABEL
LIGHT = CameraLight(position=(0.1, 0.0, 0.0), lamp=0.6, sky=1.6, ground=1.2)


def main() -> None:
    renderer = CpuRenderer(2)
    scenes = [DrawList(crossing()), *(random_scene(np.random.default_rng(seed)) for seed in (7, 8))]
    samples: tuple[SampleCount, ...] = (1, 4)
    looks = [Look(name, samples=count) for name in get_args(LookName) for count in samples]
    looks.append(Look("gltf", camera_light=LIGHT, area_filter=True))
    frames = list(itertools.product(scenes, looks))

    def render(frame: tuple[DrawList, Look]) -> dict[str, bytes]:
        scene, look = frame
        return {name: image.tobytes() for name, image in images(renderer.render(scene, VIEW, OUTPUTS, look)).items()}

    expected = [render(frame) for frame in frames]
    wrong: list[Look] = []

    def work(seed: int) -> None:
        chosen = random.Random(seed).choices(range(len(frames)), k=FRAMES)
        wrong.extend(frames[index][1] for index in chosen if render(frames[index]) != expected[index])

    threads = [threading.Thread(target=work, args=(seed,)) for seed in range(THREADS)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    renderer.close()
    if wrong:
        sys.exit(f"{len(wrong)} of {THREADS * FRAMES} frames are wrong, the first with {wrong[0]}")


if __name__ == "__main__":
    main()
