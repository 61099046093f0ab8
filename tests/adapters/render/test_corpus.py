"""Recorded requests of Drake's real client against the pictures that RenderEngineVtk made of the same scenes.

Each body is posted byte for byte with its recorded headers.
"""

import json

import cv2
import httpx2
import numpy as np
import pytest
from numpy.typing import NDArray

from renderers.raster import CpuRenderer
from tests.adapters.render.conftest import Start, decoded
from tests.support.corpus import DrakeScene, decode_label, drake_scene, drake_scenes

pytestmark = pytest.mark.corpus

MAX_WRONG_PIXELS = 10
MAX_DEPTH_ERROR = 1e-5
"""Metres, 99th percentile."""
REFERENCE_PRECISION = 2e-6
"""Relative error of RenderEngineVtk's own depth at its 99th percentile (012, against the exact plane,
see ``test_depth_of_a_plane_is_exact``): beyond 5 m it is more than MAX_DEPTH_ERROR."""
COLOR_STEP = 20
"""Difference of a channel, of 255, that Drake's integration test tolerates."""
MAX_COLOR_FRACTION = 0.01
"""Fraction of values that may differ by more; Drake's test accepts 0.2."""
MAX_INNER_ERROR = 1.0
"""Largest mean colour difference (of 255) away from edges, on scenes whose colour must match."""
SCENES = drake_scenes() or (None,)


def inner(scene: DrakeScene) -> NDArray[np.bool_]:
    """(H, W): pixels whose neighbourhood, two pixels each way, is one surface of the reference: one label, and depth
    without a step. FXAA blurs what is left out: both pictures have it, but not of the very same pixels."""
    depth, around = scene.reference_depth(), np.ones((5, 5), np.uint8)
    label = scene.reference_label().astype(np.float32)
    near = np.where(depth > 0, 1.0 / np.where(depth > 0, depth, 1.0), 0.0).astype(np.float32)  # 0 of infinity
    # Of a plane, inverse depth is linear over the picture: its second differences tell edges, not slopes.
    bent = np.zeros_like(near)
    bent[1:-1] = np.abs(near[2:] - 2 * near[1:-1] + near[:-2])
    bent[:, 1:-1] = np.maximum(bent[:, 1:-1], np.abs(near[:, 2:] - 2 * near[:, 1:-1] + near[:, :-2]))
    same = cv2.dilate(label, around) == cv2.erode(label, around)
    smooth = cv2.dilate((bent > 0.01 * np.maximum(near, 1e-3)).astype(np.uint8), around) == 0
    result: NDArray[np.bool_] = same & smooth
    return result


async def ask(start: Start, renderer: CpuRenderer, scene: DrakeScene, kind: str) -> NDArray[np.generic]:
    request = scene.request(kind)
    async with start(renderer) as server:
        headers = httpx2.Headers(request.headers)
        response = await server.client.post("/render", content=request.body, headers=headers)
    assert response.status_code == 200, response.text
    return decoded(response)


def present(scene: DrakeScene | None) -> DrakeScene:
    if scene is None:
        pytest.skip("SCENEGATE_CORPUS does not name a folder with recorded requests")
    return scene


@pytest.mark.parametrize("scene", SCENES, ids=str)
async def test_labels(start: Start, renderer: CpuRenderer, scene: DrakeScene | None) -> None:
    scene = present(scene)
    picture = await ask(start, renderer, scene, "label")
    labels, reference = decode_label(picture.astype(np.uint8)), scene.reference_label()
    assert labels.shape == reference.shape
    assert (labels != reference).sum() <= MAX_WRONG_PIXELS
    assert (picture[..., 2][labels != 32764] == 0).all()  # only white has blue


@pytest.mark.parametrize("scene", SCENES, ids=str)
async def test_depth(start: Start, renderer: CpuRenderer, scene: DrakeScene | None) -> None:
    scene = present(scene)
    image = await ask(start, renderer, scene, "depth")
    depth = image.astype(np.float32, copy=False)
    reference = scene.reference_depth()
    assert image.dtype == np.float32
    assert depth.shape == reference.shape
    measured, expected = np.isfinite(depth) & (depth > 0), np.isfinite(reference) & (reference > 0)
    coverage = (measured != expected) | ((depth == 0) != (reference == 0))
    both = measured & expected
    error = np.abs(depth[both] - reference[both])
    beyond = error - np.maximum(0.0, REFERENCE_PRECISION * reference[both] - MAX_DEPTH_ERROR)
    assert not np.isnan(depth).any()
    assert coverage.sum() <= MAX_WRONG_PIXELS
    assert error.size == 0 or np.percentile(beyond, 99) < MAX_DEPTH_ERROR


@pytest.mark.parametrize("scene", SCENES, ids=str)
async def test_color(start: Start, renderer: CpuRenderer, scene: DrakeScene | None) -> None:
    scene = present(scene)
    picture = await ask(start, renderer, scene, "color")
    reference = scene.reference_color()
    assert picture.shape == reference.shape
    difference = np.abs(picture.astype(np.int16) - reference)
    within = inner(scene)
    assert within.mean() > 0.5
    assert difference[within].mean() <= MAX_INNER_ERROR
    assert (difference > COLOR_STEP).mean() < MAX_COLOR_FRACTION


async def test_depth_of_a_plane_is_exact(start: Start, renderer: CpuRenderer) -> None:
    """The 100 m half space of 012 lies at z = -1; its depth follows from the camera in float64."""
    scene = drake_scene("012_halfspace_pendulum")
    depth = await ask(start, renderer, scene, "depth")
    reference = scene.reference_depth()
    fields = scene.request("depth").fields
    gltf = json.loads(scene.request("depth").scene)
    X = np.array(next(node["matrix"] for node in gltf["nodes"] if node.get("camera") == 0)).reshape(4, 4).T
    rows, columns = np.mgrid[0 : depth.shape[0], 0 : depth.shape[1]]
    x = (columns + 0.5 - float(fields["center_x"])) / float(fields["focal_x"])
    y = (rows + 0.5 - float(fields["center_y"])) / float(fields["focal_y"])
    downwards = X[2, 0] * x - X[2, 1] * y - X[2, 2]  # of the ray, for one metre of depth
    exact = (-1.0 - X[2, 3]) / downwards
    plane = np.isfinite(depth) & (np.abs(exact - reference) < 1e-3 * exact)
    assert plane.mean() > 0.5
    error = np.abs(depth[plane] - exact[plane])
    assert np.percentile(error, 99) < 5e-6
    assert (error / exact[plane]).max() < 5e-7
