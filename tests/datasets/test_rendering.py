"""Encoded images of a scene, and the style in a dataset's settings."""

from pathlib import Path

import cv2
import msgspec
import numpy as np
import pytest
from numpy.typing import NDArray

from gateway.datasets.rendering import render_images, render_request, style_of
from gateway.datasets.scenes import LoadedScene, load_scene
from gateway.datasets.views import View, camera_of
from gateway.scene.draw.style import Style
from renderers.camera import Camera
from renderers.light_rig import STUDIO
from renderers.raster import CpuRenderer
from scenegate.datasets.manifest import ImageType
from tests.datasets.conftest import SETTINGS, loaded, named
from tests.files.gltf.builder import Builder, data_uri
from tests.support import forms


@pytest.fixture
def robot(scenes: Path) -> LoadedScene:
    return load_scene(named(scenes, "robot.tree.json"))


def fit(scene: LoadedScene) -> Camera:
    return camera_of(View("v", "fit"), scene.root, scene.draw_list, None, 32, 24, 45.0)


def color(renderer: CpuRenderer, scene: LoadedScene, style: Style) -> NDArray[np.uint8]:
    data = render_images(renderer, scene, fit(scene), {"color": "png"}, style)["color"]
    return np.asarray(cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_COLOR), np.uint8)


@pytest.mark.parametrize(
    ("image_type", "file_format", "start"),
    [
        ("color", "png", b"\x89PNG"),
        ("color", "jpg", b"\xff\xd8"),
        ("color", "jpeg", b"\xff\xd8"),
        ("depth", "tiff", b"II*\0"),
        ("depth", "tif", b"II*\0"),
        ("depth", "png", b"\x89PNG"),
        ("label", "png", b"\x89PNG"),
    ],
)
def test_file_formats(
    renderer: CpuRenderer, robot: LoadedScene, image_type: ImageType, file_format: str, start: bytes
) -> None:
    (image,) = render_images(renderer, robot, fit(robot), {image_type: file_format}, Style()).values()
    assert image.startswith(start)


def test_style_of_settings(tmp_path: Path) -> None:
    settings = msgspec.structs.replace(
        SETTINGS, look="phong", background=(1, 2, 3), antialias="none", samples=8, rig=None
    )
    assert style_of(settings) == Style("phong", (1, 2, 3), "none", 8, STUDIO)
    rig = tmp_path / "rig.toml"
    rig.write_text("exposure = 0.25\n")
    assert style_of(msgspec.structs.replace(settings, rig=str(rig))).rig.exposure == 0.25


def test_samples_and_antialiasing_by_look(renderer: CpuRenderer, robot: LoadedScene) -> None:
    """The studio look has 4 samples, the others have one. Every look has FXAA with one sample."""
    studio = color(renderer, robot, Style())
    np.testing.assert_array_equal(studio, color(renderer, robot, Style("studio", antialias="none", samples=4)))
    smooth = color(renderer, robot, Style("studio", samples=1))
    assert (smooth != color(renderer, robot, Style("studio", antialias="none", samples=1))).any()
    assert (studio != smooth).any()
    smooth = color(renderer, robot, Style("phong"))
    np.testing.assert_array_equal(smooth, color(renderer, robot, Style("phong", samples=1)))
    assert (smooth != color(renderer, robot, Style("phong", antialias="none"))).any()
    many = color(renderer, robot, Style("phong", samples=8))
    np.testing.assert_array_equal(many, color(renderer, robot, Style("phong", antialias="none", samples=8)))


def test_requests_are_rendered_with_one_sample_by_default(renderer: CpuRenderer, scenes: Path) -> None:
    source = named(scenes, "depth.multipart")
    request = load_scene(source).request
    assert request is not None
    for settings in (SETTINGS, msgspec.structs.replace(SETTINGS, samples=4, depth_format="png")):
        camera, image_type, data = render_request(renderer, request, settings)
        assert (camera.width, camera.height, image_type) == (64, 48, "depth")
        assert data.startswith(b"II*\0" if settings.depth_format == "tiff" else b"\x89PNG")
    (scenes / "depth.multipart").write_bytes(forms.body(forms.gltf(), forms.drake_fields("color")))
    colored = load_scene(source).request
    assert colored is not None
    settings = msgspec.structs.replace(SETTINGS, antialias="none")
    one, four = (msgspec.structs.replace(settings, samples=samples) for samples in (1, 4))
    images = [render_request(renderer, colored, each)[2] for each in (settings, one, four)]
    assert images[0] == images[1] != images[2]


def test_labels_and_depth_of_a_leaf_with_a_hole_before_a_wall(renderer: CpuRenderer, tmp_path: Path) -> None:
    """As scenegate render draws them; the looks of RenderEngineVtk ignore alpha."""
    pixels = np.full((4, 4, 4), 255, np.uint8)
    pixels[:, :2, 3] = 0
    b = Builder()
    square = {
        "POSITION": b.accessor([(-1, -1, 0), (1, -1, 0), (1, 1, 0), (-1, 1, 0)]),
        "TEXCOORD_0": b.accessor([(0, 1), (1, 1), (1, 0), (0, 0)]),
    }
    indices = b.accessor([0, 1, 2, 0, 2, 3], "B")
    b.add("images", {"uri": data_uri(cv2.imencode(".png", pixels)[1].tobytes(), "image/png")})
    b.add("textures", {"source": 0})
    b.add("materials", {"pbrMetallicRoughness": {"baseColorTexture": {"index": 0}}, "alphaMode": "MASK"})
    b.add("materials", {"pbrMetallicRoughness": {"baseColorFactor": [1, 0, 0, 0.25]}, "alphaMode": "BLEND"})
    for name, z, material in (("leaf", 0, {"material": 0}), ("film", -1, {"material": 1}), ("wall", -2, {})):
        mesh = b.mesh({"attributes": square, "indices": indices, **material})
        b.node(name=name, mesh=mesh, translation=[0, 0, z])
    b.add("cameras", {"type": "perspective", "perspective": {"yfov": 0.5, "znear": 0.1, "zfar": 100}})
    b.node(camera=0, translation=[0, 0, 4])
    path = tmp_path / "leaf.gltf"
    path.write_bytes(b.text())
    scene = loaded(path)
    view = camera_of(View("v", None), scene.root, scene.draw_list, scene.file_camera, 32, 24, 45.0)
    labels = {paths[0][-1]: int(label) for label, paths in scene.description.labels.items()}
    for style, seen, depth in (
        (Style(), "film", 5.0),
        (Style(alpha_threshold=0.5), "wall", 6.0),
        (style_of(msgspec.structs.replace(SETTINGS, look="gltf", alpha_threshold=0.5)), "wall", 6.0),
        (Style("pbr", alpha_threshold=0.5), "leaf", 4.0),
    ):
        images = render_images(renderer, scene, view, {"label": "png", "depth": "tiff"}, style)
        label = cv2.imdecode(np.frombuffer(images["label"], np.uint8), cv2.IMREAD_COLOR)
        tiff = cv2.imdecode(np.frombuffer(images["depth"], np.uint8), cv2.IMREAD_UNCHANGED)
        assert label is not None
        assert tiff is not None
        assert label[12, 14, 2] == labels[seen]
        assert label[12, 18, 2] == labels["leaf"]
        assert tiff[12, 14] == pytest.approx(depth, rel=1e-6)


def test_a_texture_that_cannot_be_decoded_is_left_out(renderer: CpuRenderer, tmp_path: Path) -> None:
    png = cv2.imencode(".png", np.zeros((64, 64, 3), np.uint8))[1].tobytes()
    b = Builder()
    b.add("images", {"uri": data_uri(png[:60], "image/png"), "name": "skin"})
    b.add("textures", {"source": 0})
    pbr = {"baseColorFactor": [0, 1, 0, 1], "baseColorTexture": {"index": 0}}
    b.node(mesh=b.triangle(material=b.add("materials", {"pbrMetallicRoughness": pbr, "doubleSided": True})))
    path = tmp_path / "broken.gltf"
    path.write_bytes(b.text())
    scene = loaded(path)
    (warning,) = scene.description.warnings
    assert warning.startswith("images[0] (skin): ")
    assert warning.endswith("; textures[0] is left out")
    image = color(renderer, scene, Style("plain"))
    assert ((image[..., 1] > 100) & (image[..., 0] == 0)).any()
