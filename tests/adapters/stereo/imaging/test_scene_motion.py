"""Motion blur of moving boxes and of a moving camera."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from gateway.adapters.stereo.device.camera_config import StereoConfig
from gateway.adapters.stereo.imaging.rendered_images import Imaging
from gateway.adapters.stereo.imaging.scene_motion import (
    MAX_SUBFRAMES,
    Motion,
    MovingRectangle,
    moving_rectangles,
    subframe_count,
)
from gateway.adapters.stereo.imaging.scene_view import Capture, SceneState
from gateway.scene.draw.flatten import Flattener
from gateway.scene.tree.labels import LabelTable
from gateway.scene.tree.live import LiveTree
from gateway.scene.tree.transforms import from_pose
from renderers.drawlist import DrawList
from renderers.raster import CpuRenderer
from renderers.stereo.lens.motion_blur import poses_at
from renderers.stereo.sensor.exposure import Exposure
from scenegate.messages.geometry import Box
from tests.adapters.stereo.camera_images import expose
from tests.adapters.stereo.conftest import SMALL
from tests.adapters.stereo.scenes import part

FRAME_NS = 40_000_000
DEPTH = 1.0
"""Distance of the box, metres."""
CAMERA = np.array(((0.0, 0, 1, 0), (-1, 0, 0, 0), (0, -1, 0, 0), (0, 0, 0, 1)))
"""Camera at the origin that looks along the world's x axis; its image's x axis is the world's -y axis."""


class Scene:
    """A bright box of 10 cm in front of the camera and a small one beside it."""

    def __init__(self) -> None:
        self._tree, self._flattener = LiveTree(), Flattener(LabelTable())
        with self._tree.edit() as edit:
            edit.set_parts(("box",), (part(Box((0.1, 0.1, 0.1)), (1.0, 1.0, 1.0), 0.05, 0, 0),))
            edit.set_parts(("other",), (part(Box((0.1, 0.05, 0.05)), (1.0, 1.0, 1.0), 1.05, 0.2, 0.2),))

    def at(self, y: float) -> DrawList:
        with self._tree.edit() as edit:
            edit.set_pose(("box",), (DEPTH, y, 0, 1, 0, 0, 0))
        return self._flattener.flatten(self._tree.snapshot)


def image(
    renderer: CpuRenderer, now: DrawList, earlier: SceneState | None, time: float, pose: NDArray[np.float64] = CAMERA
) -> NDArray[np.float64]:
    """Return the light of a left image without noise, white is 1."""
    config = StereoConfig(
        model=SMALL, noise=False, background=(0, 0, 0), realism=frozenset({"motion-blur"}), look="phong"
    )
    capture = Capture(FRAME_NS, now, 2, pose, 0, 2, earlier)
    # The exposure's brightness stays the same at every exposure time.
    exposure = Exposure(time, 20.0 * np.log10(0.005 / time))
    return expose(Imaging(config, renderer), capture, exposure).image / 255.0


def edge_width(light: NDArray[np.float64]) -> float:
    """Return the width of the box's left edge in its middle row, pixels, from its light."""
    row = light[SMALL.height // 2 - 5 : SMALL.height // 2 + 5].mean(axis=0)
    plateau = row.max()
    first, last = np.flatnonzero(row > 0.01 * plateau)[0], np.flatnonzero(row > 0.99 * plateau)[0]
    return float(last - first)


@pytest.mark.parametrize("speed", [1.5, -1.5])
def test_blur_is_as_long_as_the_motion_during_the_exposure(renderer: CpuRenderer, speed: float) -> None:
    scene, time = Scene(), 0.016
    before = scene.at(-speed * 0.04)
    now = scene.at(0.0)
    earlier = SceneState(0, before, CAMERA)
    sharp, blurred = image(renderer, now, None, time), image(renderer, now, earlier, time)
    motion = abs(speed) * time * SMALL.intrinsics().focal_length / DEPTH  # 6.5 pixels
    assert edge_width(sharp) <= 1.0
    assert edge_width(blurred) == pytest.approx(motion, abs=1.5)
    assert blurred.sum() == pytest.approx(sharp.sum(), rel=0.04)
    centers = [(light * np.arange(SMALL.width)).sum() / light.sum() for light in (sharp, blurred)]
    assert centers[0] == pytest.approx(centers[1], abs=0.3), "the timestamp is the middle of the exposure"
    shorter = image(renderer, now, earlier, time / 3)
    assert edge_width(shorter) == pytest.approx(motion / 3, abs=1.5)


def test_what_stands_still_stays_sharp(renderer: CpuRenderer) -> None:
    scene = Scene()
    before, now = scene.at(-0.06), scene.at(0.0)
    sharp, blurred = (image(renderer, now, earlier, 0.016) for earlier in (None, SceneState(0, before, CAMERA)))
    other = np.s_[: SMALL.height // 2 - 30]
    assert sharp[other].max() > 0.5
    assert (sharp[other] == blurred[other]).all()
    for earlier in (
        SceneState(0, now, CAMERA),
        SceneState(FRAME_NS, before, CAMERA),  # a frozen clock
        SceneState(-1_000_000_000, before, CAMERA),  # too long ago
        SceneState(0, DrawList(tuple(before.instances)[:1]), CAMERA),  # other things
    ):
        assert (image(renderer, now, earlier, 0.016) == sharp).all()


def test_a_moving_camera_blurs_everything(renderer: CpuRenderer) -> None:
    now = Scene().at(0.0)
    before = CAMERA.copy()
    before[1, 3] = 0.06
    sharp, blurred = (image(renderer, now, earlier, 0.016) for earlier in (None, SceneState(0, now, before)))
    assert edge_width(blurred) == pytest.approx(0.024 * SMALL.intrinsics().focal_length, abs=1.5)
    other = np.s_[: SMALL.height // 2 - 30]
    assert np.abs(sharp[other] - blurred[other]).max() > 0.2


def test_turns_are_interpolated_along_the_arc() -> None:
    turn = from_pose((0.1, 0.2, 0.3), (np.cos(0.2), 0.0, 0.0, np.sin(0.2)))
    scaled = np.diag((2.0, 2.0, 2.0, 1.0))
    before, now = np.array((np.eye(4), np.eye(4), turn)), np.array((turn, scaled, turn))
    half, half_scaled, still = poses_at(before, now, -0.5)
    assert half == pytest.approx(from_pose((0.05, 0.1, 0.15), (np.cos(0.1), 0.0, 0.0, np.sin(0.1))))
    assert half_scaled == pytest.approx(np.diag((1.5, 1.5, 1.5, 1.0)))
    assert (still == turn).all()
    assert poses_at(before, now, -1.0) == pytest.approx(before)


def test_number_of_images_is_bounded() -> None:
    def rectangle(blur: float) -> MovingRectangle:
        return MovingRectangle(0, 0, 100, 100, blur)

    assert [subframe_count(rectangle(blur), 10_000, 1_000_000) for blur in (1.2, 3.5, 6.2, 200.0)] == [3, 5, 7, 7]
    assert subframe_count(rectangle(200.0), 1_000_000, 1_000_000) == 5
    assert subframe_count(rectangle(200.0), 10_000_000, 1_000_000) == 3


def test_rectangles_are_disjoint_and_inside_the_image() -> None:
    scene = Scene()
    before, now = scene.at(-0.06), scene.at(0.0)
    camera = SMALL.camera(CAMERA, offset=0.0, divisor=1, near=0.01, far=100.0)
    moved = CAMERA.copy()
    moved[0, 3] = -0.2
    (one,) = moving_rectangles(Motion(before, now, CAMERA, CAMERA), camera, 0.4)
    assert one.left > 100
    assert one.right < 220
    both = moving_rectangles(Motion(before, now, moved, CAMERA), camera, 0.4)
    assert len(both) == 2
    assert both[0].right <= both[1].left or both[1].right <= both[0].left or both[0].top >= both[1].bottom
    nothing = moving_rectangles(Motion(before, now, CAMERA, CAMERA), camera, 0.01)
    assert nothing == []
    behind = replace(camera, X_world_camera=CAMERA @ np.diag((-1.0, 1.0, -1.0, 1.0)))
    assert moving_rectangles(Motion(before, now, behind.X_world_camera, behind.X_world_camera), behind, 0.4) == []
    inside = CAMERA.copy()
    inside[0, 3] = 1.05
    (whole,) = moving_rectangles(Motion(before, now, inside, inside), replace(camera, X_world_camera=inside), 0.4)
    assert (whole.left, whole.top, whole.right, whole.bottom) == (0, 0, SMALL.width, SMALL.height)
    assert whole.blur == MAX_SUBFRAMES
