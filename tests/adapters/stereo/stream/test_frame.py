"""Sets of one frame for several kinds of requests."""

import numpy as np
import pytest

from gateway.adapters.stereo.device.camera_config import StereoConfig
from gateway.adapters.stereo.device.parameters import Parameters
from gateway.adapters.stereo.device.stream_settings import read_settings
from gateway.adapters.stereo.imaging.rendered_images import Imaging
from gateway.adapters.stereo.imaging.scene_view import Capture
from gateway.adapters.stereo.stream.frame import FrameImages, FrameRecord
from gateway.adapters.stereo.stream.set_kind import SetKind
from gateway.runtime.workers.worker_pool import WorkerPool
from renderers.raster import CpuRenderer
from renderers.stereo.mesh.disparity_mesh import MeshOptions
from scenegate.camera import image_interface_pb2 as pb
from tests.adapters.stereo.conftest import SMALL
from tests.adapters.stereo.scenes import pose, table


def frame_of(imaging: Imaging, workers: WorkerPool, *kinds: SetKind) -> FrameImages:
    capture = Capture(10**9, table(), 1, pose(), 0, 1)
    return FrameImages(FrameRecord(imaging, read_settings(Parameters()), capture, capture), workers, kinds)


@pytest.mark.parametrize(("textured", "shared"), [(True, False), (False, True)])
async def test_grey_and_coloured_meshes_of_a_frame(renderer: CpuRenderer, textured: bool, shared: bool) -> None:
    imaging, workers = Imaging(StereoConfig(model=SMALL, look="phong"), renderer), WorkerPool(1)
    grey, color = (SetKind(mesh=MeshOptions(textured=textured), color=color) for color in (False, True))
    both = frame_of(imaging, workers, grey, color)
    meshes = [pb.ImageSet.FromString(await both.serialised(kind)).mesh.data for kind in (grey, color)]
    assert (meshes[0] == meshes[1]) == shared
    alone = frame_of(imaging, workers, color)
    assert pb.ImageSet.FromString(await alone.serialised(color)).mesh.data == meshes[1]
    assert await workers.close()


async def test_a_kind_that_was_not_expected_is_made_too(renderer: CpuRenderer) -> None:
    imaging, workers = Imaging(StereoConfig(model=SMALL, look="phong"), renderer), WorkerPool(1)
    frame = frame_of(imaging, workers, SetKind(left=True))
    image = pb.ImageSet.FromString(await frame.serialised(SetKind(left=True, color=True))).left
    assert (image.encoding, image.width, image.height) == ("rgb8", 320, 240)
    expected = pb.ImageSet.FromString(
        await frame_of(imaging, workers, SetKind(left=True, color=True)).serialised(SetKind(left=True, color=True))
    ).left
    assert np.array_equal(np.frombuffer(image.data, np.uint8), np.frombuffer(expected.data, np.uint8))
    assert await workers.close()


async def test_exact_depth_has_the_brightness_of_the_colour_image_beside_it(renderer: CpuRenderer) -> None:
    imaging = Imaging(StereoConfig(model=SMALL, look="phong", depth_mode="ground_truth"), renderer)
    workers, kind = WorkerPool(1), SetKind(disparity=True, color_camera=True)
    images = pb.ImageSet.FromString(await frame_of(imaging, workers, kind).serialised(kind))
    assert images.disparity.image.brightness == images.color_camera.brightness > 0
    assert await workers.close()
