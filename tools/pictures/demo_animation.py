"""The README's animation: the demo scene, the left image of its stereo camera, and the disparity image.

    python -m tools.pictures.demo_animation [OUT.webp [QUALITY]]

OUT (default: docs/images/demo.webp) shows one period of the demo at twice its speed. The pixels are reproducible.
"""

import sys
from pathlib import Path
from typing import Any, Final

import cv2
import numpy as np
from numpy.typing import NDArray
from PIL import Image

from gateway.demo import Demo
from gateway.demo.objects import PERIOD
from gateway.scene.draw.flatten import flatten
from gateway.scene.tree.live import LiveTree
from renderers.drawlist import DrawList
from renderers.interface import Look, Output
from renderers.raster import CpuRenderer, warmup
from tools.pictures.gallery import camera, stereo_tiles

WIDTH, HEIGHT = 640, 480
"""Size of the scene's image, pixels. The two others have half of it."""
FRAMES, SPEED = 120, 2.0
"""Number of frames, and factor of the demo's speed."""
QUALITY: Final = 60
"""Quality of lossy WebP, 0 to 100."""
VIEW_CAMERA: Final = "eye=2.6,-2.3,1.95;target=0.15,0.03,0.82;fovy=40"
STEREO_CAMERA: Final = "eye=1.05,-0.95,2.1;target=0.0,0.08,0.74"
MAX_DISPARITY: Final = 80.0
"""Disparity of the last colour of the colour map, pixels."""


def main() -> None:
    out = Path(sys.argv[1] if len(sys.argv) > 1 else "docs/images/demo.webp")
    quality = int(sys.argv[2]) if len(sys.argv) > 2 else QUALITY
    warmup()
    renderer, tree = CpuRenderer(), LiveTree()
    demo = Demo(tree)
    demo.populate()
    frames: list[Image.Image] = []
    for number in range(FRAMES):
        demo.move_to(number * PERIOD / FRAMES)
        frames.append(Image.fromarray(draw_frame(renderer, flatten(tree.snapshot.root), number)))
    frame_ms = round(1000.0 * PERIOD / SPEED / FRAMES)
    frames[0].save(out, save_all=True, append_images=frames[1:], duration=frame_ms, loop=0, quality=quality, method=6)
    print(f"{out}: {len(frames)} frames of {frame_ms} ms, {out.stat().st_size / 1e6:.2f} MB")


def draw_frame(renderer: CpuRenderer, draw_list: DrawList, number: int) -> NDArray[np.uint8]:
    """Return a frame, (480, 960, 3) uint8 RGB. Its number chooses the noise of the stereo images."""
    view = camera(VIEW_CAMERA, WIDTH, HEIGHT, draw_list)
    rendered = renderer.render(draw_list, view, Output.COLOR, Look("studio", background=(236, 239, 243), samples=8))
    assert rendered.color is not None
    large = rendered.color
    pose = camera(STEREO_CAMERA, drawn=draw_list).X_world_camera
    left, _, disparity, _ = stereo_tiles(renderer, draw_list, pose, number, MAX_DISPARITY)
    small = [cv2.resize(tile, (WIDTH // 2, HEIGHT // 2), interpolation=cv2.INTER_AREA) for tile in (left, disparity)]
    caption(large, "scene")
    caption(small[0], "stereo camera, left image")
    caption(small[1], "disparity")
    return np.asarray(np.hstack((large, np.vstack(small))), np.uint8)


def caption(image: NDArray[Any], text: str) -> None:
    """Write a text into the lower left corner, on a darkened background."""
    (width, height), _ = cv2.getTextSize(text, cv2.FONT_HERSHEY_SIMPLEX, 0.45, 1)
    bottom = image.shape[0]
    image[bottom - height - 12 :, : width + 16] //= 4
    cv2.putText(image, text, (8, bottom - 7), cv2.FONT_HERSHEY_SIMPLEX, 0.45, (255, 255, 255), 1, cv2.LINE_AA)


if __name__ == "__main__":
    main()
