"""Materials and light, drawn by the page in a real browser and by ``/scene/render``."""

import io
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
import trimesh
from numpy.typing import NDArray
from PIL import Image

from tests.adapters.viewer.browser.page import Publisher, View
from tests.files.gltf.builder import Builder, data_uri
from tests.support import clients

pytestmark = [pytest.mark.browser, pytest.mark.slow]

COLUMNS, ROWS = 5, 4
CORNERS = np.array([(-0.4, -0.4, 0), (0.4, -0.4, 0), (0.4, 0.4, 0), (-0.4, 0.4, 0)], np.float32)
HALF_RED = np.array([[[255, 0, 0, 255], [0, 0, 255, 64]]], np.uint8)
DULL = {"metallicFactor": 0.0, "roughnessFactor": 1.0}


def pbr(*color: float, **more: Any) -> dict[str, Any]:
    """Return glTF's pbrMetallicRoughness, not metallic and rough by default."""
    return {**DULL, "baseColorFactor": [*color], **more}


UNLIT: dict[str, Any] = {"extensions": {"KHR_materials_unlit": {}}}
MATERIALS: list[dict[str, Any]] = [
    {"pbrMetallicRoughness": pbr(0.8, 0.1, 0.1, 1.0)},
    {"pbrMetallicRoughness": pbr(0.2, 0.2, 0.2, 1.0)},
    {"pbrMetallicRoughness": pbr(0.1, 0.6, 0.1, 1.0, roughnessFactor=0.6)},
    {"pbrMetallicRoughness": pbr(0.0, 0.0, 0.0, 1.0), "emissiveFactor": [0.2, 0.5, 0.0]},
    {"pbrMetallicRoughness": pbr(1.0, 1.0, 1.0, 1.0)},
    *({"pbrMetallicRoughness": pbr(1.0, 0.0, 0.0, alpha), "alphaMode": "BLEND"} for alpha in (0.1, 0.3, 0.5, 0.7, 0.9)),
    *({"pbrMetallicRoughness": pbr(0.0, 0.2, 1.0, alpha), "alphaMode": "BLEND", **UNLIT} for alpha in (0.1, 0.5, 0.9)),
    {"pbrMetallicRoughness": pbr(0.0, 0.0, 0.0, 0.3), "alphaMode": "BLEND", "doubleSided": True},
    {"pbrMetallicRoughness": pbr(0.0, 1.0, 0.0, 0.3), "alphaMode": "OPAQUE"},
    {"pbrMetallicRoughness": pbr(1.0, 1.0, 1.0, 1.0, baseColorTexture={"index": 0}), **UNLIT},
    {"pbrMetallicRoughness": pbr(1.0, 1.0, 1.0, 1.0, baseColorTexture={"index": 0}), "alphaMode": "BLEND", **UNLIT},
    {"pbrMetallicRoughness": pbr(1.0, 1.0, 1.0, 1.0, baseColorTexture={"index": 0}), "alphaMode": "MASK", **UNLIT},
    {"pbrMetallicRoughness": pbr(1.0, 1.0, 1.0, 0.4, baseColorTexture={"index": 0}), "alphaMode": "BLEND"},
    {"pbrMetallicRoughness": pbr(0.5, 0.5, 0.0, 1.0), **UNLIT},
]


def document() -> bytes:
    """Return squares in the plane of the image, one for each material."""
    builder = Builder()
    file = io.BytesIO()
    Image.fromarray(HALF_RED).save(file, "PNG")
    builder.add("images", {"uri": data_uri(file.getvalue(), "image/png")})
    builder.add("samplers", {"magFilter": 9728, "minFilter": 9728})
    builder.add("textures", {"source": 0, "sampler": 0})
    builder.json["extensionsUsed"] = ["KHR_materials_unlit"]
    attributes = {
        "POSITION": builder.accessor(CORNERS),
        "NORMAL": builder.accessor(np.tile((0, 0, 1), (4, 1))),
        "TEXCOORD_0": builder.accessor([(0, 1), (1, 1), (1, 0), (0, 0)]),
    }
    indices = builder.accessor([0, 1, 2, 0, 2, 3], "H")
    for number, material in enumerate(MATERIALS):
        primitive = {"attributes": attributes, "indices": indices, "material": builder.add("materials", material)}
        x, y = number % COLUMNS - (COLUMNS - 1) / 2, (ROWS - 1) / 2 - number // COLUMNS
        builder.node(mesh=builder.mesh(primitive), translation=[x, y, 0.0])
    return builder.text()


def means(pixels: NDArray[np.uint8]) -> NDArray[np.float64]:
    """Return the mean colours of the left and the right half of each square, (20, 2, 3).

    A square is 80 pixels wide in an image of 500 x 400 pixels, in cells of 100 pixels.
    """
    cells = pixels.reshape(ROWS, 100, COLUMNS, 100, 3).transpose(0, 2, 1, 3, 4).reshape(-1, 100, 100, 3)
    return np.stack([cells[:, 20:80, 20:45].mean(axis=(1, 2)), cells[:, 20:80, 55:80].mean(axis=(1, 2))], axis=1)


def place(view: View, eye: tuple[float, float, float], *, orthographic: bool) -> None:
    """Show 500 x 400 pixels of the scene alone, seen from a point."""
    view.page.evaluate(
        """([eye, orthographic]) => {
          const { stage, frustum } = scenegate;
          for (const object of [stage.grid, stage.axes, frustum.object]) stage.show(object, false);
          stage.renderer.setPixelRatio(1);
          stage.holder.style.cssText = "position: fixed; inset: 0; width: 500px; height: 400px";
          stage.setOrthographic(orthographic);
          scenegate.rig.place({ eye, target: [0, 0, 0], up: [0, 0, 1], halfHeight: 2 });
          stage.setBackground("#cce5ff", "#cce5ff");
        }""",
        [eye, orthographic],
    )
    view.until(lambda: view.colors().shape == (400, 500, 3), "the size")


def render(
    url: str, camera: str, image_type: str = "color", light: dict[str, float] | None = None
) -> NDArray[np.uint8]:
    """Return the gateway's image, (400, 500, 3) uint8."""
    query: dict[str, str | float] = {"camera": camera, "width": 500, "height": 400, "type": image_type, **(light or {})}
    with clients.Client(base_url=url) as http:
        response = http.get("/scene/render", params=query)
    return np.asarray(Image.open(io.BytesIO(response.content)).convert("RGB"))


def test_page_and_gateway_draw_the_same_materials(shown: View, publisher: Publisher, url: str, tmp_path: Path) -> None:
    """Blended surfaces are mixed in linear light by both."""
    assert len(MATERIALS) == COLUMNS * ROWS
    (tmp_path / "materials.gltf").write_bytes(document())
    geometry = {"type": "mesh_file", "filename": str(tmp_path / "materials.gltf"), "scale": [1, 1, 1]}
    publisher.send(setgeometry=[{"path": ["materials"], "geometry": geometry}])
    shown.wait_for_node("materials")
    place(shown, (0.0, -9.0, 0.0), orthographic=True)
    rendered = means(render(url, "eye=0,-9,0;target=0,0,0;up=0,0,1;xmag=2.5"))
    textured = 15
    shown.until(lambda: means(shown.colors())[textured, 0, 1] < 100, "the texture")
    difference = np.abs(means(shown.colors()) - rendered).max(axis=2)
    for material, levels in zip(MATERIALS, difference.max(axis=1), strict=True):
        assert levels <= 6.0, material


SET_LIGHT = """(light) => {
  const change = { azimuth: null, elevation: null, strength: 1, ambient: 1, ...light };
  scenegate.light.change.value = change;
}"""


def test_page_and_gateway_light_the_same_scene(browser: Any, publisher: Publisher, url: str, tmp_path: Path) -> None:
    """A floor, and spheres: diffuse, two that are glossy, two of metal. All but the floor cast shadows on it."""
    materials = [(0.0, 1.0), (0.0, 1.0), (0.0, 0.15), (0.0, 0.5), (1.0, 0.2), (1.0, 0.6)]  # metallic, roughness
    builder = Builder()
    for number, (metallic, roughness) in enumerate(materials):
        is_floor = number == 0
        mesh = trimesh.creation.box((8.0, 0.1, 8.0)) if is_floor else trimesh.creation.uv_sphere(0.4, count=(48, 96))
        corners = mesh.vertices[mesh.faces].reshape(-1, 3) if is_floor else mesh.vertices
        attributes = {"POSITION": builder.accessor(corners.astype(np.float32))}
        surface = pbr(0.58, 0.35, 0.19, 1.0, metallicFactor=metallic, roughnessFactor=roughness)
        primitive = {"attributes": attributes, "material": builder.add("materials", {"pbrMetallicRoughness": surface})}
        if not is_floor:
            attributes["NORMAL"] = builder.accessor((mesh.vertices / 0.4).astype(np.float32))
            primitive["indices"] = builder.accessor(mesh.faces.ravel().tolist(), "I")
        place_at = [0.0, -0.45, 0.0] if is_floor else [number - 3.0, 0.0, 0.0]
        builder.node(mesh=builder.mesh(primitive), translation=place_at)
    (tmp_path / "scene.gltf").write_bytes(builder.text())
    geometry = {"type": "mesh_file", "filename": str(tmp_path / "scene.gltf"), "scale": [1, 1, 1]}
    publisher.send(setgeometry=[{"path": ["spheres"], "geometry": geometry}])
    with View(browser, url) as view:
        view.page.goto(f"{url}/view?shadows=on")
        view.wait_for_node("spheres")
        place(view, (0.0, -4.0, 3.0), orthographic=False)
        lights: list[dict[str, float]] = [
            {},
            {"light_azimuth": 45, "light_elevation": 35, "light_strength": 1.5, "light_ambient": 0.3},
            {"light_strength": 0, "light_ambient": 2},
        ]
        for light in lights:
            view.page.evaluate(SET_LIGHT, {name.removeprefix("light_"): value for name, value in light.items()})
            image = render(url, "eye=0,-4,3;target=0,0,0;up=0,0,1;fovy=45", light=light).astype(int)
            view.until(lambda: np.abs(view.colors() - image).mean() < 2.0, f"the gateway's image with {light}")  # noqa: B023 - used at once
            difference = np.abs(view.colors() - image).max(axis=2)
            gray = image.max(axis=2).astype(np.uint8)
            kernel = np.ones((5, 5), np.uint8)
            is_smooth = cv2.dilate(gray, kernel) - cv2.erode(gray, kernel) < 32  # no silhouette or border of a shadow
            assert (difference[is_smooth] > 16).mean() < 0.02
            y, x = np.mgrid[:400, :500]
            metres = 400 / (2 * np.tan(np.radians(22.5)) * 5.0)  # pixels a metre at the spheres
            for number in range(1, len(materials)):
                is_sphere = np.hypot(x - 250 - metres * (number - 3), y - 200) < 0.35 * metres
                assert difference[is_sphere].mean() < 8.0, (materials[number], light)
