"""Errors of matched depth on a real pair, as it is and as a scene: ``python -m tools.calibration.real_pair FOLDER``.

FOLDER has the pair ``motorcycle`` of Middlebury 2014, as ``skimage/data`` in scikit-image's wheel. The scene is the
pair's true surface with the left image on it; behind its edges, the background goes on below the foreground, with the
right image on it. It fills the camera's images, without and with realism.
"""

import argparse
from dataclasses import replace
from pathlib import Path
from typing import Final

import cv2
import numpy as np
from numpy.typing import NDArray

from gateway.adapters.stereo.device.camera_config import StereoConfig
from gateway.adapters.stereo.device.parameters import Parameters
from gateway.adapters.stereo.device.stream_settings import read_settings
from gateway.adapters.stereo.imaging.rendered_images import Imaging
from gateway.adapters.stereo.imaging.scene_view import Capture
from renderers.drawlist import DrawList, Image, Instance, Material, Mesh, Sampler, Texture
from renderers.stereo.depth.depth_images import DepthImages
from renderers.stereo.depth.match_confidence import EVEN_NOISE
from renderers.stereo.depth.matching import FINE, match_pair
from renderers.stereo.model import DISPARITY_SCALE, Quality, StereoModel
from renderers.stereo.realism import REALISM_PARTS
from tools.calibration.errors import NO_FILTERS, match, print_reliability, reliability_of
from tools.calibration.samples import make_sample, renderer

MAX_STEP: Final = 1.0
"""Difference of the disparities of neighbours beyond which they are not one surface, pixels."""
HIDDEN_COLUMNS: Final = 61
"""Columns of the window in which the background goes on below the foreground, pixels."""


def background_below(disparity: NDArray[np.float32]) -> NDArray[np.float32]:
    """Return the disparity of what lies behind each pixel: the lowest one beside it in its row."""
    return np.asarray(cv2.erode(disparity, np.ones((1, HIDDEN_COLUMNS))), np.float32)


def without_holes(disparity: NDArray[np.float32]) -> NDArray[np.float32]:
    """Return a disparity image whose unknown pixels, 0, have the lower disparity of both neighbours in their row."""
    filled = disparity.copy()
    for row in filled:
        known = np.flatnonzero(row > 0.0)
        after = np.clip(np.searchsorted(known, np.arange(len(row))), 1, len(known) - 1)
        row[:] = np.where(row > 0.0, row, np.minimum(row[known[after - 1]], row[known[after]]))
    return filled


def surface(
    image: NDArray[np.uint8],
    columns: NDArray[np.float32],
    disparity: NDArray[np.float32],
    kept: NDArray[np.bool_],
    model: StereoModel,
    number: int,
) -> Instance:
    """Return an unlit surface in the left camera's frame, as large in its image as the pair.

    Args:
        image: (H, W, 3), BGR, the texture.
        columns: (H, W), column of the texture at each pixel of the left image.
        disparity: (H, W), pixels.
        kept: (H, W), pixels whose surface is drawn.
    """
    height, width = disparity.shape
    k, v, u = model.intrinsics(), *np.mgrid[0:height, 0:width] + 0.5
    scale = k.height / height
    z = model.focal_times_baseline(1) / (scale * disparity)
    rays = np.stack(((u - width / 2) * scale, (v - height / 2) * scale, np.full_like(u, k.focal_length)), -1)
    points = (rays / k.focal_length * z[:, :, None]).reshape(-1, 3)
    uv = np.stack(((columns + 0.5) / width, v / height), -1).reshape(-1, 2)
    number_of = np.arange(height * width).reshape(height, width)
    corners = [np.s_[:-1, :-1], np.s_[:-1, 1:], np.s_[1:, :-1], np.s_[1:, 1:]]
    around = np.stack([disparity[corner] for corner in corners])
    flat = kept[:-1, :-1] & (np.ptp(around, axis=0) < MAX_STEP)
    a, b, c, d = (number_of[corner][flat] for corner in corners)
    triangles = np.concatenate((np.stack((a, c, b), -1), np.stack((b, c, d), -1)))
    pixels = np.dstack((image[:, :, ::-1], np.full((height, width), 255, np.uint8)))
    texture = Texture(Image(b"pair %d" % number, lambda: pixels), Sampler())
    material = Material(base_color_texture=texture, metallic=0.0, double_sided=True, unlit=True)
    mesh = Mesh(points.astype(np.float32), triangles.astype(np.uint32), uv0=uv.astype(np.float32))
    return Instance(mesh, material, np.eye(4), number, number)


def scene_of(
    left: NDArray[np.uint8], right: NDArray[np.uint8], truth: NDArray[np.float32], model: StereoModel
) -> DrawList:
    """Return the pair as a scene in the left camera's frame; ``left``, ``right``: (H, W, 3), BGR."""
    near = without_holes(truth)
    far = background_below(near)
    hidden = cv2.dilate((near - far > MAX_STEP).astype(np.uint8), np.ones((3, 3))) > 0
    columns = np.broadcast_to(np.arange(near.shape[1], dtype=np.float32), near.shape)
    instances = (
        surface(left, columns, near, np.ones_like(hidden), model, 0),
        surface(right, np.maximum(columns - far, 0.0), far - np.float32(0.02), hidden, model, 1),
    )
    return DrawList(instances)


def visible_in_both(truth: NDArray[np.float32]) -> NDArray[np.bool_]:
    """Return the pixels of a left disparity image that the right camera sees, too, (H, W) bool."""
    rows, columns = np.mgrid[0 : truth.shape[0], 0 : truth.shape[1]]
    in_right = np.rint(columns - truth).astype(np.int64)
    inside = (truth > 0.0) & (in_right >= 0)
    nearest = np.zeros_like(truth)
    np.maximum.at(nearest, (rows[inside], in_right[inside]), truth[inside])
    return np.asarray(inside & (nearest[rows, np.maximum(in_right, 0)] <= truth + 1.0), np.bool_)


def report(name: str, truth: NDArray[np.float32], visible: NDArray[np.bool_], images: DepthImages) -> None:
    """Print fill and errors where both cameras see the surface and elsewhere, near edges and off them.

    Args:
        truth: (H, W) float32, exact disparity, pixels, 0: unknown.
        visible: (H, W) bool, seen by both cameras.
    """
    print(name)
    known = truth > 0.0
    highest = cv2.dilate(truth, np.ones((3, 3)))
    lowest = cv2.erode(np.where(known, truth, np.float32(np.inf)), np.ones((3, 3)))
    near_edge = cv2.dilate(((highest - lowest > 2.0) & np.isfinite(lowest)).astype(np.uint8), np.ones((9, 9))) > 0
    matched, deviation = images.disparity > 0, images.disparity * np.float32(DISPARITY_SCALE) - truth
    parts = (visible, known & ~visible, visible & near_edge, visible & ~near_edge)
    for part_name, part in zip(("visible", "occluded", "near edges", "off edges"), parts, strict=True):
        errors = deviation[part & matched]
        small = np.abs(errors) < 1.0
        fill, wrong, bias = matched[part].mean(), 1.0 - small.mean(), errors[small].mean()
        stated = images.error[part & matched][small] * DISPARITY_SCALE
        error, stated_error = (np.sqrt((each.astype(float) ** 2).mean()) for each in (errors[small], stated))
        print(f"  {part_name:12} fill {fill:.3f}, off by > 1 px {wrong:.3f}, bias of the others {bias:+.3f} px", end="")
        print(f", their error {error:.2f} px, stated {stated_error:.2f} px")
    good = visible & matched & (np.abs(deviation) < 1.0)
    for step in (4, 10):
        both = good[:, :-step] & good[:, step:]
        correlation = np.corrcoef(deviation[:, :-step][both], deviation[:, step:][both])[0, 1]
        print(f"  correlation of errors {step} px apart: {correlation:.2f}")


def report_confidence(truth: NDArray[np.float32], images: DepthImages) -> None:
    """Print the share of right pixels minus the confidence; ``images``: without post-processing."""
    deviation = np.abs(images.disparity * np.float32(DISPARITY_SCALE) - truth)
    both = (images.disparity > 0) & (truth > 0.0)
    is_right = deviation[both] <= 3.0 * images.error[both] * DISPARITY_SCALE + 1e-6
    print_reliability("confidence", reliability_of(images.confidence[both] / 255.0, is_right))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0] if __doc__ else None)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--quality", choices=[each.value for each in Quality], default="High", help="of the scene")
    options = parser.parse_args()
    folder: Path = options.folder
    left, right = (
        np.asarray(cv2.imread(str(folder / f"motorcycle_{side}.png")), np.uint8) for side in ("left", "right")
    )
    truth = np.nan_to_num(np.load(folder / "motorcycle_disp.npz")["arr_0"].astype(np.float32), posinf=0.0)
    grey = [np.multiply(cv2.cvtColor(each, cv2.COLOR_BGR2GRAY), FINE, dtype=np.uint16) for each in (left, right)]
    images = match_pair(grey[0], grey[1], 96, np.full(256, EVEN_NOISE), Quality.HIGH.divisor)
    report("the pair itself", truth, visible_in_both(truth), images)
    report_confidence(truth, images)
    for realism in ((), REALISM_PARTS):
        imaging, settings = Imaging(StereoConfig(realism=frozenset(realism)), renderer()), read_settings(Parameters())
        settings = replace(settings, quality=Quality(options.quality))
        scene = scene_of(left, right, truth, imaging.config.model)
        sample = make_sample("pair", imaging, settings, Capture(0, scene, 1, np.eye(4), 0, 1))
        report(f"as a scene, realism {'all' if realism else 'off'}", sample.exact, sample.visible > 0.0, match(sample))
        report_confidence(sample.exact, match(replace(sample, settings=replace(settings, filters=NO_FILTERS))))


if __name__ == "__main__":
    main()
