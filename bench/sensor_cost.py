"""CPU time of the stereo camera's sets with exact and with modelled depth: ``python -m bench.sensor_cost``.

A set is both grey images and the depth images at ``High``. Times are those of all threads of this process, the least
of frames of which each is measured in both modes.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from functools import partial
from typing import Final

import cv2

from bench.sensor import MODES
from bench.sensor_images import Sample, demo_samples, make_sample, renderer
from bench.sensor_scenes import POSE, make_scene, mixed_room, plain_room
from gateway.adapters.stereo.device.camera_config import StereoConfig
from gateway.adapters.stereo.device.parameters import Parameters
from gateway.adapters.stereo.device.stream_settings import read_settings
from gateway.adapters.stereo.imaging.rendered_images import ImageRequest, Imaging
from gateway.adapters.stereo.imaging.scene_view import Capture
from gateway.runtime.workers.process_tuning import tune
from renderers.interface import Output
from renderers.stereo.sensor.camera_image import NoiseStream

FRAMES: Final = 12
"""Number of measured frames, after two that warm up."""
SEED: Final = 1
"""Seed of the rooms and of the noise."""


def cost_samples() -> Iterator[Sample]:
    """Yield a mixed room, a plain room and the demo, without and with the projector."""
    imaging, settings = Imaging(StereoConfig(seed=SEED), renderer()), read_settings(Parameters())
    for number, scene in ((2, mixed_room), (1, plain_room)):  # numbers as in sensor_scenes.SCENES
        draw_list = make_scene(scene, (SEED, number))
        for projector in (0, 1):
            yield make_sample(scene.__name__, imaging, settings, Capture(0, draw_list, 1, POSE, projector, SEED))
    samples = list(demo_samples())
    yield from samples[2:4]


def milliseconds(call: Callable[[], object]) -> float:
    """Return the CPU time of a call in all threads of this process."""
    start = time.process_time()
    call()
    return 1e3 * (time.process_time() - start)


def render_inputs(sample: Sample) -> None:
    """Render what depth is measured from: both grey images, and exact depth of both cameras."""
    imaging, capture = sample.imaging, sample.capture
    exposure = imaging.meter(capture, sample.settings).exposure
    for stream in (NoiseStream.LEFT, NoiseStream.RIGHT):
        imaging.expose(capture, ImageRequest(exposure, stream, frozenset((False,))))
    for offset in (0.0, imaging.config.model.baseline):
        imaging.render_lit(capture, offset, sample.settings.quality.divisor, Output.DEPTH)


def main() -> None:
    tune()
    cv2.setNumThreads(1)  # as the gateway does
    print(f"{'scene':12} {'projector':9} {'images ms':>9} {'exact ms':>9} {'modelled ms':>11} {'ratio of sets':>13}")
    for sample in cost_samples():
        rows = [
            (
                milliseconds(partial(render_inputs, sample)),
                milliseconds(partial(MODES["ground_truth"], sample)),
                milliseconds(partial(MODES["modelled"], sample)),
            )
            for _ in range(FRAMES + 2)
        ]
        images, exact, modelled = (min(values) for values in zip(*rows[2:], strict=True))
        projector = "on" if sample.projector else "off"
        ratio = (images + modelled) / (images + exact)
        print(f"{sample.name:12} {projector:9} {images:9.1f} {exact:9.2f} {modelled:11.2f} {ratio:13.2f}", flush=True)


if __name__ == "__main__":
    main()
