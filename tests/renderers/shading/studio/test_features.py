"""Features of glTF files from their bytes to pixels: each on a sheet of its own, against arithmetic written from the
specifications, and as a golden image.

The sheet fills the view at z = -3 with texture coordinates 0 .. 1 and is lit by one lamp of the file. Textures are
sampled at the nearest texel, so that the expected image needs no filter (``test_reference`` tests filters).
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from types import SimpleNamespace
from typing import Any

import cv2
import numpy as np
import pytest

from gateway.scene.draw.flatten import flatten
from renderers.camera import OPENGL_FROM_OPTICAL, Camera
from renderers.light_rig import Hemisphere, Rig, Surroundings
from renderers.raster import CpuRenderer
from tests.files.gltf.builder import Builder, data_uri
from tests.renderers.golden_images import assert_equal_to_golden
from tests.renderers.shading.reference import rays
from tests.renderers.shading.studio import reference as ref
from tests.renderers.shading.studio.scenes import DARK, rendered

CORNERS = np.array([(-1.5, -1.2, 0), (1.5, -1.2, 0), (1.5, 1.2, 0), (-1.5, 1.2, 0)])
UV = np.array([(0, 1), (1, 1), (1, 0), (0, 0)], np.float64)
LAMP: dict[str, Any] = {"type": "directional", "intensity": 2.5, "color": [1.0, 0.9, 0.8]}
# Rotated about Y and X: it shines to the lower right.
LAMP_NODE: dict[str, Any] = {
    "rotation": [-0.2164396, -0.2164396, -0.0480066, 0.9508061],
    "extensions": {"KHR_lights_punctual": {"light": 0}},
}
SIDE = 8
TEXELS = np.random.default_rng(7).integers(0, 256, (SIDE, SIDE, 4)).astype(np.uint8)
TEXELS[..., 3] = np.where(np.arange(SIDE) % 3 == 0, 90, 255)
CAMERA = Camera(60, 45, 58.0, 58.0, 29.7, 22.9, 0.05, 100.0, OPENGL_FROM_OPTICAL)
PLAIN = {"baseColorFactor": [0.7, 0.6, 0.5, 1.0], "metallicFactor": 0.0, "roughnessFactor": 0.5}
GREY = Surroundings(Hemisphere((0.4, 0.5, 0.6), (0.4, 0.5, 0.6)))

Expected = Callable[["Point"], ref.Array]


@dataclass(frozen=True)
class Point:
    """Texture coordinates and positions at all pixels, row by row."""

    uv: ref.Array
    p: ref.Array

    def texel(self, uv: ref.Array | None = None) -> ref.Array:
        """Return stored values over 255 at coordinates, which repeat, (n, 4)."""
        at = np.floor((self.uv if uv is None else uv) * SIDE).astype(int) % SIDE
        values: ref.Array = TEXELS[at[:, 1], at[:, 0]] / 255.0
        return values

    def lit(self, base: ref.Array, metallic: Any = 0.0, roughness: Any = 0.5, **more: Any) -> ref.Array:
        """Return the radiance under the lamp alone."""
        material: Any = SimpleNamespace(**{"ior": 1.5, "specular": 1.0, "specular_color": (1.0, 1.0, 1.0)} | more)
        x, y, z, w = LAMP_NODE["rotation"]
        shines = np.array((2 * (x * z + w * y), 2 * (y * z - w * x), 1 - 2 * (x * x + y * y))) * -1.0
        n, v = np.array((0.0, 0.0, 1.0)) + 0 * self.p, ref.normalized(-self.p)
        one = np.ones((len(self.p), 1))
        f = ref.brdf(n, v, -shines + 0 * self.p, base + 0 * self.p, material, roughness * one, metallic * one)
        radiance: ref.Array = f * LAMP["intensity"] * np.array(LAMP["color"])
        return radiance


def png() -> bytes:
    return bytes(cv2.imencode(".png", TEXELS[..., [2, 1, 0, 3]])[1])


def webp() -> bytes:
    data = bytes(cv2.imencode(".webp", TEXELS[..., [2, 1, 0, 3]], (cv2.IMWRITE_WEBP_QUALITY, 101))[1])  # lossless
    assert data[8:12] == b"WEBP"
    return data


def document(
    material: dict[str, Any], attributes: dict[str, Any] | None = None, extensions: tuple[str, ...] = (), **node: Any
) -> Builder:
    """Return a document with the sheet; ``attributes`` replace its own: (values, type, more)."""
    b = Builder()
    every: dict[str, Any] = {
        "POSITION": (CORNERS - np.array((0, 0, 3)), "f", {}),
        "NORMAL": (np.tile((0, 0, 1), (4, 1)), "f", {}),
        "TEXCOORD_0": (UV, "f", {}),
        **(attributes or {}),
    }
    accessors = {name: b.accessor(values, dtype, **more) for name, (values, dtype, more) in every.items()}
    for index in accessors.values():
        stride = b.json["accessors"][index].pop("stride", None)
        if stride:
            b.json["bufferViews"][b.json["accessors"][index]["bufferView"]]["byteStride"] = stride
    mesh = b.mesh({"attributes": accessors, "indices": b.accessor([0, 1, 2, 0, 2, 3], "H"), "material": 0})
    b.add("materials", material)
    b.json["extensions"] = {"KHR_lights_punctual": {"lights": [LAMP]}}
    b.json["scenes"] = [{"nodes": [b.node(mesh=mesh, **node), b.node(**LAMP_NODE)]}]
    b.json["extensionsUsed"] = ["KHR_lights_punctual", *extensions]
    b.json["extensionsRequired"] = list(extensions)
    b.add("samplers", {"magFilter": 9728, "minFilter": 9728})
    return b


def textured(b: Builder, image: bytes | None = None, mime: str = "image/png", **texture: Any) -> Builder:
    """Add texture 0, of ``TEXELS``."""
    index = b.add("images", {"uri": data_uri(png() if image is None else image, mime)})
    b.add("textures", {"sampler": 0, "source": index} if not texture else {"sampler": 0, **texture})
    return b


def base_texture(**more: Any) -> dict[str, Any]:
    return {"pbrMetallicRoughness": {**PLAIN, "baseColorTexture": {"index": 0, **more}}}


def base_color(t: ref.Array) -> ref.Array:
    return np.array(PLAIN["baseColorFactor"])[:3] * ref.srgb_to_linear(t[:, :3])


TRANSFORM: dict[str, Any] = {"offset": [0.3, -0.2], "rotation": 0.5, "scale": [1.7, 0.6], "texCoord": 1}
SECOND = UV[:, ::-1] * 0.8 + 0.1


def second(at: Point) -> ref.Array:
    """Return TEXCOORD_1 at each pixel: linear over the sheet as TEXCOORD_0."""
    return at.uv[:, ::-1] * 0.8 + 0.1


def transformed(at: Point) -> ref.Array:
    """Return transformed coordinates: translation * rotation * scale, counter-clockwise if v is up."""
    c, s = np.cos(TRANSFORM["rotation"]), np.sin(TRANSFORM["rotation"])
    m = np.array(((c, s), (-s, c))) @ np.diag(TRANSFORM["scale"])
    uv: ref.Array = second(at) @ m.T + np.array(TRANSFORM["offset"])
    return uv


def quantized() -> Builder:
    """Return positions as int16 under a node that scales, normals as int8, coordinates as normalised uint16."""
    return textured(
        document(
            base_texture(),
            {
                "POSITION": (np.c_[CORNERS * 1000, np.zeros(4)].astype(int), "h", {"type": "VEC3", "stride": 8}),
                "NORMAL": (np.tile((0, 0, 127, 0), (4, 1)), "b", {"type": "VEC3", "stride": 4, "normalized": True}),
                "TEXCOORD_0": (UV * 65535, "H", {"normalized": True}),
            },
            ("KHR_mesh_quantization",),
            translation=[0, 0, -3],
            scale=[0.001] * 3,
        )
    )


def basisu() -> Builder:
    b = textured(document(base_texture(), extensions=()), extensions={"KHR_texture_basisu": {"source": 1}}, source=0)
    b.add("images", {"uri": data_uri(b"\xabKTX 20\xbb\r\n\x1a\n and no more", "image/ktx2")})
    b.json["extensionsUsed"].append("KHR_texture_basisu")
    return b


def material_document(required: tuple[str, ...] = (), **material: Any) -> Builder:
    return textured(document({"pbrMetallicRoughness": PLAIN, **material}, None, required))


COLORS = np.array([(255, 0, 0, 255), (0, 255, 0, 255), (0, 0, 255, 255), (255, 255, 255, 255)])


def vertex_color(at: Point) -> ref.Array:
    """Return the vertex colour at each pixel, linear over the triangles 0 1 2 and 0 2 3."""
    u, v = at.uv[:, :1], 1.0 - at.uv[:, 1:]
    c = COLORS[:, :3] / 255.0
    first, second_half = c[0] + u * (c[1] - c[0]) + v * (c[2] - c[1]), c[0] + v * (c[3] - c[0]) + u * (c[2] - c[3])
    color: ref.Array = np.where(u > v, first, second_half)
    return color


FLAT = np.array(PLAIN["baseColorFactor"])[:3]
FEATURES: dict[str, tuple[Builder, Expected]] = {
    "factors": (document({"pbrMetallicRoughness": PLAIN}), lambda at: at.lit(FLAT)),
    "base_color": (textured(document(base_texture())), lambda at: at.lit(base_color(at.texel()))),
    "webp": (
        textured(
            document(base_texture(), extensions=("EXT_texture_webp",)),
            webp(),
            "image/webp",
            extensions={"EXT_texture_webp": {"source": 0}},
        ),
        lambda at: at.lit(base_color(at.texel())),
    ),
    "basisu_fallback": (basisu(), lambda at: at.lit(base_color(at.texel()))),
    "texture_transform": (
        textured(
            document(
                base_texture(extensions={"KHR_texture_transform": TRANSFORM}),
                {"TEXCOORD_1": (SECOND, "f", {})},
                ("KHR_texture_transform",),
            )
        ),
        lambda at: at.lit(base_color(at.texel(transformed(at)))),
    ),
    "quantization": (quantized(), lambda at: at.lit(base_color(at.texel()))),
    "vertex_colors": (
        textured(document(base_texture(), {"COLOR_0": (COLORS, "B", {"normalized": True})})),
        lambda at: at.lit(base_color(at.texel()) * vertex_color(at)),
    ),
    "metallic_roughness": (
        textured(
            document(
                {
                    "pbrMetallicRoughness": {
                        **PLAIN,
                        "metallicFactor": 0.9,
                        "roughnessFactor": 0.8,
                        "metallicRoughnessTexture": {"index": 0, "texCoord": 1},
                    }
                },
                {"TEXCOORD_1": (SECOND, "f", {})},
            )
        ),
        lambda at: at.lit(FLAT, 0.9 * at.texel(second(at))[:, 2:3], 0.8 * at.texel(second(at))[:, 1:2]),
    ),
    "emissive_strength": (
        material_document(
            ("KHR_materials_emissive_strength",),
            emissiveFactor=[0.1, 0.05, 0.02],
            emissiveTexture={"index": 0},
            extensions={"KHR_materials_emissive_strength": {"emissiveStrength": 6.0}},
        ),
        lambda at: at.lit(FLAT) + 6.0 * np.array((0.1, 0.05, 0.02)) * ref.srgb_to_linear(at.texel()[:, :3]),
    ),
    "specular_and_ior": (
        material_document(
            ("KHR_materials_specular", "KHR_materials_ior"),
            extensions={
                "KHR_materials_ior": {"ior": 1.9},
                "KHR_materials_specular": {
                    "specularFactor": 0.9,
                    "specularTexture": {"index": 0},
                    "specularColorFactor": [1.0, 2.0, 0.5],
                    "specularColorTexture": {"index": 0},
                },
            },
        ),
        lambda at: at.lit(
            FLAT,
            ior=1.9,
            specular=0.9 * at.texel()[:, 3:],
            specular_color=np.array((1.0, 2.0, 0.5)) * ref.srgb_to_linear(at.texel()[:, :3]),
        ),
    ),
    "unlit": (
        textured(
            document({**base_texture(), "extensions": {"KHR_materials_unlit": {}}}, None, ("KHR_materials_unlit",))
        ),
        lambda at: base_color(at.texel()),
    ),
    "mask": (
        textured(document({**base_texture(), "alphaMode": "MASK", "alphaCutoff": 0.6})),
        lambda at: np.where(at.texel()[:, 3:] < 0.6, 0.0, at.lit(base_color(at.texel()))),
    ),
    "blend": (
        textured(document({**base_texture(), "alphaMode": "BLEND"})),
        lambda at: at.texel()[:, 3:] * at.lit(base_color(at.texel())),
    ),
}


def render_document(renderer: CpuRenderer, b: Builder, rig: Rig) -> np.ndarray[Any, Any]:
    read = b.read()
    assert not read.warnings
    return rendered(renderer, flatten(read.root), CAMERA, rig)


def sheet_pixels() -> tuple[Point, np.ndarray[Any, Any]]:
    """Return all pixels, and which of them lie on the sheet, (n,)."""
    p = rays(CAMERA) * 3.0 * (1, -1, -1)  # from the optical frame to the file's
    uv = (p[:, :2] / (CORNERS[2, :2] - CORNERS[0, :2])) * (1, -1) + 0.5
    return Point(uv, p), ((uv > 0.01) & (uv < 0.99)).all(axis=1)


def is_inside_texel(uv: ref.Array) -> np.ndarray[Any, Any]:
    """Return which coordinates are not within a hundredth of another texel, where rounding decides, (n,)."""
    position = uv * SIDE % 1.0
    return np.asarray(((position > 0.01) & (position < 0.99)).all(axis=1))


@pytest.mark.parametrize("name", FEATURES)
def test_feature(renderer: CpuRenderer, name: str) -> None:
    b, expected = FEATURES[name]
    at, inside = sheet_pixels()
    where = inside & is_inside_texel(at.uv) & is_inside_texel(second(at)) & is_inside_texel(transformed(at))
    assert where.mean() > 0.5
    expected_color = ref.srgb(expected(at))[where]
    wrong = np.abs(render_document(renderer, b, replace(DARK, tone="none")).reshape(-1, 3)[where] - expected_color)
    assert expected_color.std() > 3.0
    assert wrong.max() <= 0.52, (wrong.max(), wrong.mean())  # half a level of rounding, and float32


def test_occlusion_darkens_the_environment_but_not_lights(renderer: CpuRenderer) -> None:
    material = {"pbrMetallicRoughness": PLAIN}
    occluded = {**material, "occlusionTexture": {"index": 0, "strength": 0.7}}
    at, inside = sheet_pixels()
    where = inside & is_inside_texel(at.uv)
    unoccluded = 1.0 + 0.7 * (at.texel()[:, :1] - 1.0)
    rig = replace(DARK, tone="none", surroundings=GREY)
    direct = at.lit(FLAT)
    total = ref.srgb_to_linear(render_document(renderer, document(material), rig).reshape(-1, 3) / 255.0)
    expected = ref.srgb(direct + unoccluded * (total - direct))[where]
    wrong = np.abs(render_document(renderer, textured(document(occluded)), rig).reshape(-1, 3)[where] - expected)
    assert wrong.max() <= 2.0  # ``total`` is rounded to a level
    assert wrong.mean() < 0.5


def test_golden_images(renderer: CpuRenderer) -> None:
    rig = replace(DARK, surroundings=GREY)
    assert_equal_to_golden("features", **{name: render_document(renderer, b, rig) for name, (b, _) in FEATURES.items()})
