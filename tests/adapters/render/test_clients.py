"""Undocumented properties of the requests of real clients, and of the responses that they can read.

Found in live traffic of Drake 1.51.1 and 1.58.0 and in the tests of drake-blender; see docs/conventions.md for Drake's
labels and depth.
"""

import asyncio
import base64
import json
import struct
from collections.abc import AsyncIterator
from typing import Any

import cv2
import httpx2
import numpy as np
import pytest
import structlog
from numpy.typing import NDArray

from renderers.raster import CpuRenderer
from tests.adapters.render.conftest import Running, Start, assert_refused, decoded
from tests.support.corpus import DONT_CARE_LABEL, decode_label
from tests.support.forms import CONTENT_TYPE, body, drake_fields, gltf

BACKGROUND = (204, 229, 255)
WHITE = (255, 255, 255)
TYPES = ("color", "depth", "label")
PIXEL = (24, 32)
"""Row and column that the test triangle covers."""


@pytest.fixture
async def server(start: Start, renderer: CpuRenderer) -> AsyncIterator[Running]:
    async with start(renderer) as running:
        yield running


async def answer(
    server: Running, scene: dict[str, Any] | bytes, kind: str = "color", **changes: Any
) -> httpx2.Response:
    return await server.post(body(scene, drake_fields(kind, **changes)), CONTENT_TYPE)


async def picture(server: Running, scene: dict[str, Any] | bytes, kind: str = "color", **changes: Any) -> NDArray[Any]:
    response = await answer(server, scene, kind, **changes)
    assert response.status_code == 200, response.text
    return decoded(response)


def uri(data: bytes) -> str:
    return "data:application/octet-stream;base64," + base64.b64encode(data).decode()


def textured(scene: dict[str, Any]) -> dict[str, Any]:
    """Give the triangle of a scene texture coordinates."""
    scene["accessors"].append({"bufferView": 0, "componentType": 5126, "count": 3, "type": "VEC2"})
    attributes = scene["meshes"][0]["primitives"][0]["attributes"]
    attributes["TEXCOORD_0"] = len(scene["accessors"]) - 1
    return scene


async def test_the_test_scene_is_visible(server: Running) -> None:
    color, depth, label = [await picture(server, gltf(), kind) for kind in TYPES]
    assert tuple(color[PIXEL]) == (255, 0, 0)
    assert tuple(color[0, 0]) == BACKGROUND
    assert depth[PIXEL] == pytest.approx(1.0, rel=1e-6)
    assert np.isposinf(depth[0, 0])
    assert tuple(label[PIXEL]) == (255, 0, 0)
    assert tuple(label[0, 0]) == WHITE


async def test_glb_scenes(server: Running) -> None:
    text = json.dumps(gltf()).encode()
    text += b" " * (-len(text) % 4)
    glb = struct.pack("<4sIII4s", b"glTF", 2, 20 + len(text), len(text), b"JSON") + text
    assert tuple((await picture(server, glb))[PIXEL]) == (255, 0, 0)


async def test_images_are_readable_by_drakes_client(server: Running) -> None:
    """It sniffs the first bytes, takes 8-bit RGB for colour and label, and crashes on a truncated PNG."""
    for kind in ("color", "label"):
        data = (await answer(server, gltf(), kind)).content
        assert data.startswith(b"\x89PNG\r\n\x1a\n")
        assert struct.unpack(">IIBBBBB", data[16:29]) == (64, 48, 8, 2, 0, 0, 0)
        assert data.endswith(b"IEND\xaeB`\x82")
    data = (await answer(server, gltf(), "depth")).content
    assert data.startswith(b"II*\0")
    assert len(data) == 136 + 64 * 48 * 4


# --- Scenes without a camera, or with too many


async def test_a_scene_of_gltf_meshes_only_has_no_camera(server: Running) -> None:
    """VTK's exporter writes the camera only when it has something else to write."""
    nodes = [{"mesh": 0}]
    no_cameras: tuple[list[Any] | None, ...] = (None, [])
    for cameras in no_cameras:
        scene = gltf(generator="Drake glTF merger", cameras=cameras, nodes=nodes)
        for kind in TYPES:
            response = await answer(server, scene, kind)
            assert_refused(response, 400, "no camera", "Add any other geometry with a perception role")


async def test_empty_scenes(server: Running) -> None:
    """All nulls, nothing, and what Drake's acceptance test sends: neither nodes nor scenes."""
    names = ("accessors", "bufferViews", "buffers", "cameras", "materials", "meshes", "nodes")
    nulls = {"asset": {"generator": "VTK", "version": "2.0"}, "scene": 0, "scenes": [{"nodes": None}]}
    lens = {"aspectRatio": 1.3, "yfov": 0.78, "zfar": 10, "znear": 0.01}
    minimal = {"asset": {"version": "2.0"}, "scene": 0, "cameras": [{"perspective": lens, "type": "perspective"}]}
    for scene in (nulls | dict.fromkeys(names), {"asset": {"version": "2.0"}}, minimal):
        for kind, empty in (("color", BACKGROUND), ("depth", np.inf), ("label", WHITE)):
            assert (await picture(server, scene, kind) == empty).all()


async def test_merged_scenes_without_images_have_nulls(server: Running) -> None:
    scene = gltf(generator="Drake glTF merger", images=None, textures=None, samplers=None, extensionsUsed=None)
    assert (await picture(server, scene, "label"))[PIXEL].tolist() == [255, 0, 0]


async def test_a_camera_without_a_node_is_at_the_origin(server: Running) -> None:
    scene = gltf(nodes=[{"mesh": 0}])
    assert (await picture(server, scene, "depth"))[PIXEL] == pytest.approx(1.0, rel=1e-6)


async def test_the_first_node_with_camera_0_counts(server: Running) -> None:
    """Cameras of merged files are appended, and may be called "Camera Node" as well."""
    closer = [1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, -0.5, 1]
    camera = gltf()["cameras"][0]
    nodes = [
        {"children": [1, 2, 3, 4], "name": "Renderer Node"},
        {"mesh": 0},
        {"camera": 1, "name": "Camera Node", "translation": [0, 0, 5]},
        {"camera": 0, "name": "Camera Node", "matrix": closer},
        {"camera": 0, "translation": [0, 0, 7]},
    ]
    depth = await picture(server, gltf(cameras=[camera, camera], nodes=nodes), "depth")
    assert depth[PIXEL] == pytest.approx(0.5, rel=1e-6)


# --- Labels


@pytest.mark.parametrize("label", [0, 1, 128, 255, 256, 257, 4660, 32763, DONT_CARE_LABEL])
async def test_label_colours_come_back_unchanged(server: Running, label: int) -> None:
    color = ((label & 255) / 255, (label >> 8) / 255, 0.0, 1.0)
    rgb = await picture(server, gltf(color=color), "label")
    assert tuple(rgb[PIXEL]) == (label & 255, label >> 8, 0)
    assert set(np.unique(decode_label(rgb))) == {label, DONT_CARE_LABEL}


async def test_labels_ignore_light_alpha_textures_vertex_colours_and_emission(server: Running) -> None:
    factor = [2 / 255, 1 / 255, 0.0, 0.2]
    material = {
        "emissiveFactor": factor[:3],
        "alphaMode": "MASK",
        "alphaCutoff": 0.9,
        "pbrMetallicRoughness": {"baseColorFactor": factor, "baseColorTexture": {"index": 0}},
    }
    scene = gltf(
        materials=[material],
        images=[{"uri": uri(b"not an image at all")}],
        textures=[{"source": 0}],
        accessors=[*gltf()["accessors"], {"bufferView": 0, "componentType": 5126, "count": 3, "type": "VEC3"}],
        meshes=[{"primitives": [{"attributes": {"POSITION": 0, "COLOR_0": 1}, "material": 0}]}],
    )
    label = await picture(server, textured(scene), "label")
    assert tuple(label[PIXEL]) == (2, 1, 0)
    assert {tuple(pixel) for pixel in label.reshape(-1, 3)} == {(2, 1, 0), WHITE}
    assert (await picture(server, scene, "depth"))[PIXEL] == pytest.approx(1.0, rel=1e-6)
    # Without the image, the colour is that of the factor.
    assert (await picture(server, scene, "color"))[PIXEL].tolist() != list(BACKGROUND)


PNG_HEAD = b"\x89PNG\r\n\x1a\n\0\0\0\rIHDR" + bytes((0, 0, 0, 8, 0, 0, 0, 8, 8, 6, 0, 0, 0))


@pytest.mark.parametrize("generator", ["VTK", "Drake glTF merger"])
async def test_a_broken_image_is_left_out_and_named_as_in_the_document(server: Running, generator: str) -> None:
    """Two clients may send the same bytes: neither reads what the other calls them."""
    data = PNG_HEAD + bytes(200) + generator.encode()
    for place, name in ((0, "mine"), (1, "yours"), (0, None), (0, "mine")):
        spare = {"uri": uri(b"unused")}
        scene = gltf(
            generator=generator,
            images=[*[spare] * place, {"uri": uri(data), **({"name": name} if name else {})}],
            textures=[{"source": place}],
            materials=[{"pbrMetallicRoughness": {"baseColorTexture": {"index": 0}}}],
        )
        with structlog.testing.capture_logs() as lines:
            assert (await picture(server, textured(scene)))[PIXEL].tolist() != list(BACKGROUND)
        called = f"images[{place}] ({name})" if name else f"images[{place}]"
        (warning,) = [line["warning"] for line in lines if line.get("warning", "").startswith(f"{called}: ")]
        assert warning.endswith("; textures[0] is left out")


async def test_a_primitive_without_material_has_the_label_of_its_file_or_none(server: Running) -> None:
    """Drake's client writes labels into materials; its own node of each glTF file says what belongs together."""
    red, bare = gltf()["meshes"][0], {"primitives": [{"attributes": {"POSITION": 0}}]}
    alone = gltf(meshes=[bare])
    assert tuple((await picture(server, alone, "label"))[PIXEL]) == WHITE
    nodes = [
        {"children": [1], "name": "Renderer Node"},
        {"camera": 0},
        {"name": "g1", "children": [3, 4]},
        {"mesh": 0, "translation": [50, 0, 0]},
        {"mesh": 1},
    ]
    together = gltf(generator="Drake glTF merger", meshes=[red, bare], nodes=nodes, scenes=[{"nodes": [0, 2]}])
    assert tuple((await picture(server, together, "label"))[PIXEL]) == (255, 0, 0)
    assert (await picture(server, together, "color"))[PIXEL].tolist() != list(BACKGROUND)


# --- Colour


async def test_unusable_sources_of_texture_extensions_are_ignored(server: Running) -> None:
    """The client's merge does not re-base ``extensions.*.source``: it may point anywhere. ``source`` is right."""
    ok, png = cv2.imencode(".png", np.full((2, 2, 3), (0, 255, 0), np.uint8))
    assert ok
    texture = {"source": 1, "extensions": {"KHR_texture_basisu": {"source": 99}, "EXT_texture_webp": {"source": 0}}}
    scene = gltf(
        images=[{"uri": uri(b"\xabKTX 20\xbb")}, {"uri": uri(png.tobytes())}],
        textures=[texture],
        extensionsUsed=["KHR_texture_basisu"],
        materials=[{"doubleSided": True, "pbrMetallicRoughness": {"baseColorTexture": {"index": 0}}}],
    )
    assert tuple((await picture(server, textured(scene)))[PIXEL]) == (0, 255, 0)


async def test_sparse_accessors_garbled_by_drakes_merger_are_400(server: Running) -> None:
    sparse = {"count": 1, "indices": {"bufferView": 7, "componentType": 5123}, "values": {"bufferView": 8}}
    scene = gltf()
    scene["accessors"][0]["sparse"] = sparse
    assert_refused(await answer(server, scene), 400, "accessors[0].sparse")


async def test_vtk_ignores_specular_glossiness(server: Running) -> None:
    """Drake replaces ``baseColorFactor`` by the label and keeps the extension."""
    red = {"baseColorFactor": [1, 0, 0, 1], "metallicFactor": 0.0}
    glossy = {"KHR_materials_pbrSpecularGlossiness": {"diffuseFactor": [0, 0, 1, 0.5]}}
    for generator in ("VTK", "Drake glTF merger", "Blender"):
        images = []
        for extensions in ({}, {"extensions": glossy}):
            scene = gltf(generator=generator, materials=[{"pbrMetallicRoughness": red, **extensions}])
            assert (await picture(server, scene, "label"))[PIXEL].tolist() == [255, 0, 0]
            images.append(await picture(server, scene))
        assert np.array_equal(images[0], images[1]) == (generator != "Blender")


async def test_mirrored_nodes_are_lit_and_those_of_vtk_black(server: Running) -> None:
    nodes = [{"children": [1, 2]}, {"mesh": 0, "scale": [-1, 1, 1]}, {"camera": 0}]
    plain, mirrored = gltf(generator="Blender"), gltf(nodes=nodes, generator="Blender")
    np.testing.assert_array_equal(await picture(server, plain), await picture(server, mirrored))
    red = {"pbrMetallicRoughness": {"baseColorFactor": [1, 0, 0, 1], "metallicFactor": 0.0, "roughnessFactor": 1.0}}
    assert tuple((await picture(server, gltf(nodes=nodes, materials=[red])))[PIXEL]) == (0, 0, 0)


async def test_translucent_vtk_materials_are_blended(server: Running) -> None:
    """Alpha below one arrives without an alphaMode, which means opaque in glTF but not to RenderEngineVtk."""
    color = {"pbrMetallicRoughness": {"baseColorFactor": [1, 0, 0, 0.5], "metallicFactor": 0.0, "roughnessFactor": 1.0}}
    rgb = await picture(server, gltf(materials=[color]))
    np.testing.assert_allclose(rgb[PIXEL], np.array(BACKGROUND) / 2 + np.array((127.5, 0, 0)), atol=1.5)


# --- Depth and clipping


async def test_depth_limits_and_clipping_planes(server: Running) -> None:
    assert (await picture(server, gltf(), "depth", min_depth="1.5"))[PIXEL] == 0.0
    assert np.isposinf((await picture(server, gltf(), "depth", max_depth="0.5", min_depth="0.1"))[PIXEL])
    nodes = [{"children": [1, 2, 3]}, {"mesh": 0}, {"camera": 0}, {"mesh": 0, "scale": [3, 3, 3]}]
    two = gltf(nodes=nodes)  # one at 1 m, three times as large at 3 m
    assert (await picture(server, two, "depth"))[PIXEL] == pytest.approx(1.0, rel=1e-6)
    assert (await picture(server, two, "depth", near="1.5"))[PIXEL] == pytest.approx(3.0, rel=1e-6)
    assert np.isposinf((await picture(server, two, "depth", near="1.5", far="2"))[PIXEL])
    assert tuple((await picture(server, two, "label", near="1.5", far="2"))[PIXEL]) == WHITE


async def test_principal_point(server: Running) -> None:
    """Drake's default principal point is w/2 - 0.5; the picture moves with it by exactly as many pixels."""
    centred = await picture(server, gltf(), "label", center_x="30.5", center_y="20.5")
    moved = await picture(server, gltf(), "label", center_x="37.5", center_y="24.5")
    np.testing.assert_array_equal(moved[4:, 7:], centred[:-4, :-7])


# --- Repetition


async def test_concurrent_equal_requests_get_equal_bytes(server: Running) -> None:
    single = {kind: (await answer(server, gltf(), kind)).content for kind in TYPES}
    together = await asyncio.gather(*(answer(server, gltf(), kind) for kind in TYPES * 4))
    for kind, response in zip(TYPES * 4, together, strict=True):
        assert response.content == single[kind]


async def test_drake_blenders_form(server: Running) -> None:
    """Its tests send a made-up hash and a scene without content type; Drake's own demo server answers 500."""
    fields = drake_fields("depth", scene_sha256="NOT_USED_IN_THE_TEST", submit=None, min_depth="0.01", max_depth="10")
    fields |= {"width": "640", "height": "480", "center_x": "319.5", "center_y": "239.5", "focal_x": "579.411"}
    response = await server.post(body(gltf(), fields, scene_headers=(), filename="depth.gltf"), CONTENT_TYPE)
    assert response.status_code == 200
