"""Images for docs/stereo-models.md's section on realism, and the CPU time of each part.

python -m tools.pictures.realism docs/images      (writes realism-demo.webp and realism-parts.webp)
python -m tools.pictures.realism --seconds 3      (prints the CPU ms of both grey images of the demo, for each part)
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path
from typing import Any, Final

import cv2
import numpy as np
from numpy.typing import NDArray

from gateway.adapters.stereo.device.camera_config import StereoConfig
from gateway.adapters.stereo.device.parameters import Parameters
from gateway.adapters.stereo.device.stream_settings import read_settings
from gateway.adapters.stereo.imaging.rendered_images import ImageRequest, Imaging
from gateway.adapters.stereo.imaging.scene_view import Capture, SceneState
from gateway.demo import Demo
from gateway.runtime.settings import Settings
from gateway.scene.draw.flatten import Flattener
from gateway.scene.draw.mount import parse_mount_pose
from gateway.scene.tree.labels import LabelTable
from gateway.scene.tree.live import LiveTree
from renderers.raster import CpuRenderer
from renderers.stereo.realism import REALISM_PARTS, RealismPart
from renderers.stereo.sensor.camera_image import NoiseStream

SECONDS: Final = 5.1
"""Time of the demo scene in the images, seconds."""
FRAME_SECONDS: Final = 0.04
"""Time since the frame before, seconds."""
CAPTION_ROWS: Final = 22
"""Height of a caption, pixels."""
MAX_BYTES: Final = 150_000
"""Maximum size of a file."""


def captures(speed: float = 1.0) -> tuple[Capture, Capture]:
    """Return a capture with the projector off, and one with the projector on.

    Args:
        speed: factor of the demo scene's speed.
    """
    tree, flattener = LiveTree(), Flattener(LabelTable())
    demo = Demo(tree)
    demo.populate()
    demo.move_to(SECONDS - speed * FRAME_SECONDS)
    before = flattener.flatten(tree.snapshot)
    demo.move_to(SECONDS)
    pose = parse_mount_pose(Settings.model_fields["stereo_pose"].default)
    capture = Capture(int(FRAME_SECONDS * 1e9), flattener.flatten(tree.snapshot), 2, pose, 0, 2)
    capture = replace(capture, earlier=SceneState(0, before, pose))
    return capture, replace(capture, gpio=1)


def left_image(
    renderer: CpuRenderer, capture: Capture, parts: Iterable[RealismPart], color: bool = True
) -> NDArray[Any]:
    """Return the left image with automatic exposure and a gamma for people, (H, W, 3) uint8 RGB or (H, W) uint8."""
    imaging = Imaging(StereoConfig(realism=frozenset(parts)), renderer)
    parameters = Parameters()
    parameters.set("rc_camera", [("gamma", 0.45)])
    exposure = imaging.meter(capture, read_settings(parameters)).exposure
    return imaging.expose(capture, ImageRequest(exposure, NoiseStream.LEFT, frozenset((color,))))[color].image


def captioned(image: NDArray[Any], caption: str) -> NDArray[Any]:
    """Return a grey or RGB image below its caption, (H + ``CAPTION_ROWS``, W, 3) uint8."""
    if image.ndim == 2:
        image = np.repeat(image[:, :, None], 3, axis=2)
    result = np.full((image.shape[0] + CAPTION_ROWS, image.shape[1], 3), 255, np.uint8)
    result[CAPTION_ROWS:] = image
    cv2.putText(result, caption, (4, 16), cv2.FONT_HERSHEY_SIMPLEX, 0.5, (40, 40, 40), 1, cv2.LINE_AA)
    return result


def write_webp(path: Path, image: NDArray[Any]) -> None:
    """Write a WebP file with the best quality that keeps it below ``MAX_BYTES``."""
    for quality in range(92, 20, -4):
        _, data = cv2.imencode(".webp", image[:, :, ::-1], [cv2.IMWRITE_WEBP_QUALITY, quality])
        if len(data) < MAX_BYTES:
            break
    path.write_bytes(data.tobytes())
    print(f"{path}: {len(data)} bytes, quality {quality}")


def write_images(renderer: CpuRenderer, folder: Path) -> None:
    """Write both images of the documentation into a folder."""
    dark, lit = captures()
    fast, _ = captures(speed=8.0)
    panels = [
        captioned(cv2.resize(left_image(renderer, capture, parts), (640, 480), interpolation=cv2.INTER_AREA), caption)
        for capture, parts, caption in (
            (dark, (), "off"),
            (dark, REALISM_PARTS, "all"),
            (lit, (), "off, projector on"),
            (lit, REALISM_PARTS, "all, projector on"),
        )
    ]
    write_webp(folder / "realism-demo.webp", np.vstack((np.hstack(panels[:2]), np.hstack(panels[2:]))))
    panels = []
    for capture, parts, caption, (column, row) in (
        (dark, (), "off", (545, 515)),
        (dark, ("lens-blur",), "lens-blur", (545, 515)),
        (dark, ("shadows", "lens-blur"), "shadows, lens-blur", (545, 515)),
        (fast, (), "off, eight times as fast", (750, 170)),
        (fast, ("motion-blur",), "motion-blur", (750, 170)),
        (fast, REALISM_PARTS, "all", (750, 170)),
        (lit, (), "off, projector on", (300, 640)),
        (lit, ("projector",), "projector", (300, 640)),
        (lit, REALISM_PARTS, "all, projector on", (300, 640)),
    ):
        part = left_image(renderer, capture, parts, color=False)[row : row + 120, column : column + 160]
        panels.append(captioned(cv2.resize(part, (480, 360), interpolation=cv2.INTER_NEAREST), caption))
    write_webp(folder / "realism-parts.webp", np.vstack([np.hstack(panels[k : k + 3]) for k in (0, 3, 6)]))


def print_times(renderer: CpuRenderer, seconds: float) -> None:
    """Print the CPU time without and with each part, measured for ``seconds`` each."""
    print("CPU ms of both grey images")
    for capture in captures():
        print("projector on" if capture.out1_high else "projector off")
        for parts in ((), *((part,) for part in REALISM_PARTS), REALISM_PARTS):
            imaging = Imaging(StereoConfig(realism=frozenset(parts)), renderer)
            exposure = imaging.meter(capture, read_settings(Parameters())).exposure
            costs: list[float] = []
            end = time.monotonic() + seconds
            while time.monotonic() < end or len(costs) < 3:
                before = time.process_time()
                for stream in (NoiseStream.LEFT, NoiseStream.RIGHT):
                    imaging.expose(capture, ImageRequest(exposure, stream, frozenset((False,))))
                costs.append(time.process_time() - before)
            name = "all" if parts == REALISM_PARTS else ", ".join(parts) or "off"
            print(f"  {name:<32}{1e3 * float(np.median(costs)):8.1f}   {exposure.time * 1e3:.1f} ms exposed")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path, nargs="?")
    parser.add_argument("--seconds", type=float, default=3.0)
    options = parser.parse_args()
    renderer = CpuRenderer(2)
    if options.folder is not None:
        write_images(renderer, options.folder)
    else:
        print_times(renderer, options.seconds)
    renderer.close()


if __name__ == "__main__":
    main()
