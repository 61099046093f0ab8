"""The HTTP interface from outside, without any of the gateway's code."""

import base64
import io
import json
from typing import Any

import cv2
import httpx2
import numpy as np
import pytest
import tifffile

pytestmark = pytest.mark.compose

WIDTH, HEIGHT = 64, 48
FIELDS = {
    "width": f"{WIDTH}",
    "height": f"{HEIGHT}",
    "near": "0.1",
    "far": "10",
    "focal_x": "32",
    "focal_y": "32",
    "center_x": "32",
    "center_y": "24",
    "min_depth": "0.5",
    "max_depth": "5",
    "submit": "Render",
}
LABEL = (7, 2, 1)
"""Red, green, blue: the colour that Drake's client gives to a body."""


def half_a_wall() -> dict[str, Any]:
    """A square that covers the left half of the picture, two metres before a camera at the origin, as VTK writes it.

    glTF cameras look along -Z: x from -2 to 0 and y from -2 to 2 at z = -2; with 32 pixels of focal length, a metre
    is 16 pixels.
    """
    corners = np.array([(-2, -2, -2), (0, -2, -2), (0, 2, -2), (-2, 2, -2)], "<f4")
    faces = np.array((0, 1, 2, 0, 2, 3), "<u2")
    data = corners.tobytes() + faces.tobytes()
    return {
        "asset": {"version": "2.0", "generator": "VTK"},
        "scene": 0,
        "scenes": [{"nodes": [0, 1]}],
        "nodes": [{"mesh": 0}, {"camera": 0}],
        "cameras": [{"type": "perspective", "perspective": {"yfov": 1.287, "znear": 0.1, "zfar": 10.0}}],
        "materials": [{"pbrMetallicRoughness": {"baseColorFactor": [*(channel / 255 for channel in LABEL), 1.0]}}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}, "indices": 1, "material": 0}]}],
        "buffers": [
            {"byteLength": len(data), "uri": "data:application/octet-stream;base64," + base64.b64encode(data).decode()}
        ],
        "bufferViews": [
            {"buffer": 0, "byteLength": corners.nbytes},
            {"buffer": 0, "byteOffset": corners.nbytes, "byteLength": faces.nbytes},
        ],
        "accessors": [
            {"bufferView": 0, "componentType": 5126, "count": 4, "type": "VEC3"},
            {"bufferView": 1, "componentType": 5123, "count": 6, "type": "SCALAR"},
        ],
    }


def render(http: httpx2.Client, image_type: str, scene: dict[str, Any], **changes: str) -> httpx2.Response:
    fields = {**FIELDS, "image_type": image_type, **changes}
    files = {"scene": ("scene.gltf", json.dumps(scene).encode(), "model/gltf+json")}
    return http.post("/render", data=fields, files=files)


def decode(answer: httpx2.Response) -> np.ndarray:
    bgr = cv2.imdecode(np.frombuffer(answer.content, np.uint8), cv2.IMREAD_UNCHANGED)
    assert bgr is not None
    return bgr[:, :, ::-1]


def test_it_becomes_ready(http: httpx2.Client) -> None:
    ready = http.get("/readyz")
    assert ready.status_code == 200, ready.text
    assert ready.json()["interfaces"]["render"]["state"] == "ready"


def test_a_label_picture_is_exact(http: httpx2.Client) -> None:
    answer = render(http, "label", half_a_wall())
    assert answer.status_code == 200, answer.text
    assert answer.headers["content-type"] == "image/png"
    expected = np.full((HEIGHT, WIDTH, 3), 255, np.uint8)
    expected[:, : WIDTH // 2] = LABEL
    assert np.array_equal(decode(answer), expected)


def test_a_depth_picture_is_in_metres(http: httpx2.Client) -> None:
    answer = render(http, "depth", half_a_wall())
    assert answer.status_code == 200, answer.text
    assert answer.headers["content-type"] == "image/tiff"
    depth = tifffile.imread(io.BytesIO(answer.content))
    assert depth.dtype == np.float32
    assert depth.shape == (HEIGHT, WIDTH)
    assert np.allclose(depth[:, : WIDTH // 2], 2.0, rtol=0, atol=1e-6)
    assert np.isposinf(depth[:, WIDTH // 2 :]).all()


def test_a_colour_picture_shows_wall_and_background(http: httpx2.Client) -> None:
    scene = half_a_wall()
    scene["materials"][0]["pbrMetallicRoughness"]["baseColorFactor"] = [1.0, 0.0, 0.0, 1.0]
    answer = render(http, "color", scene)
    assert answer.status_code == 200, answer.text
    picture = decode(answer)
    assert picture.shape == (HEIGHT, WIDTH, 3)
    left, right = picture[HEIGHT // 2, WIDTH // 4], picture[HEIGHT // 2, WIDTH - 4]
    assert left[0] > 200
    assert left[1:].max() < 30
    assert tuple(right) == (204, 229, 255)


def test_the_demo_scene_is_listed_and_drawn(http: httpx2.Client) -> None:
    listed = http.get("/scene").json()
    assert ["demo", "robot"] in [node["path"] for node in listed["nodes"]]
    answer = http.get("/scene/render", params={"camera": "fit", "width": 160, "height": 120})
    assert answer.status_code == 200, answer.text
    picture = decode(answer)
    assert picture.shape == (120, 160, 3)
    assert len(np.unique(picture.reshape(-1, 3), axis=0)) > 100


def test_a_bad_request_is_told_in_plain_text(http: httpx2.Client) -> None:
    answer = render(http, "color", half_a_wall(), width="-3")
    assert answer.status_code == 400
    assert answer.headers["content-type"].startswith("text/plain")
    assert "width" in answer.text


def test_an_answer_carries_the_id_of_its_request(http: httpx2.Client) -> None:
    answer = http.get("/healthz", headers={"X-Request-ID": "compose-1"})
    assert answer.headers["x-request-id"] == "compose-1"


def test_metrics_count_renders(http: httpx2.Client) -> None:
    render(http, "label", half_a_wall())
    text = http.get("/metrics").text
    assert 'scenegate_http_requests_total{method="POST",route="/render",status="200"}' in text
