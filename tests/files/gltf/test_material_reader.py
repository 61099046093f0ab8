import itertools
import math
from typing import Any

import cv2
import numpy as np
import pytest

from gateway.adapters.stereo.imaging.rendered_images import DOT_ALPHA
from gateway.files.gltf import DEFAULT_MATERIAL, GltfCache, GltfError, GltfLimits, GltfScene, label_from_material
from renderers.drawlist import LABEL_NONE, AlphaMode, Material, Sampler, Texture, Wrap
from scenegate.warning_text import warnings_and_notes
from tests.files.gltf.builder import TRIANGLE, Builder, data_uri, parts


def png(color: tuple[int, int, int] = (10, 20, 30), size: tuple[int, int] = (2, 3)) -> bytes:
    """BGR ``color``, (height, width)."""
    ok, data = cv2.imencode(".png", np.full((*size, 3), color, np.uint8))
    assert ok
    return bytes(data.tobytes())


def read_material(material: dict[str, Any] | None, b: Builder | None = None) -> tuple[Material, GltfScene]:
    b = b or Builder()
    primitive = {} if material is None else {"material": b.add("materials", material)}
    scene = b.draw(TEXCOORD_0=TRIANGLE[:, :2], TEXCOORD_1=TRIANGLE[:, :2], **primitive).read()
    ((_, part),) = parts(scene)
    return part.material, scene


def with_texture(*images: bytes, generator: str = "test", **texture: Any) -> Builder:
    """A document with a texture for each image."""
    b = Builder(generator)
    for number, image in enumerate(images or (png(),)):
        b.add("images", {"uri": data_uri(image, "image/png")})
        b.add("textures", {"source": number, **texture})
    return b


def test_defaults_of_the_specification() -> None:
    material, scene = read_material({})
    assert material == Material()
    assert material is not DEFAULT_MATERIAL
    assert scene.warnings == ()
    assert read_material({"pbrMetallicRoughness": None, "alphaMode": None, "normalTexture": None})[0] == Material()


@pytest.mark.parametrize(
    ("factors", "warnings"),
    [
        ({"metallicFactor": 2, "roughnessFactor": -1}, ["metallicFactor: 2 is not", "roughnessFactor: -1 is not"]),
        ({"baseColorFactor": [-5, 0, 0, 1]}, ["baseColorFactor: (-5.0, 0.0, 0.0, 1.0) is not"]),
        ({"baseColorFactor": [1.0000001, 0, 0, 1], "metallicFactor": 1.0000001}, []),
    ],
)
def test_factors_out_of_range_are_reported(factors: dict[str, Any], warnings: list[str]) -> None:
    material, scene = read_material({"pbrMetallicRoughness": factors})
    assert 0 <= material.metallic <= 1
    assert 0 <= material.roughness <= 1
    assert len(scene.warnings) == len(warnings)
    for text, start in zip(scene.warnings, warnings, strict=True):
        assert text.startswith(f"materials[0].pbrMetallicRoughness.{start}")


def test_absent_material_is_recognisable_white_and_not_metallic() -> None:
    material, _ = read_material(None)
    assert material is DEFAULT_MATERIAL
    assert (material.base_color, material.metallic) == ((1, 1, 1, 1), 0)
    assert label_from_material(material) == LABEL_NONE


def test_everything_is_read() -> None:
    b = with_texture(sampler=0)
    b.add("samplers", {"magFilter": 9728, "minFilter": 9985, "wrapS": 33071, "wrapT": 33648})
    material, _ = read_material(
        {
            "pbrMetallicRoughness": {
                "baseColorFactor": [0.1, 0.2, 0.3, 0.4],
                "baseColorTexture": {"index": 0},
                "metallicFactor": 0.5,
                "roughnessFactor": 0.25,
                "metallicRoughnessTexture": {"index": 0, "texCoord": 1},
            },
            "normalTexture": {"index": 0, "scale": 2},
            "occlusionTexture": {"index": 0, "strength": 0.75},
            "emissiveTexture": {"index": 0},
            "emissiveFactor": [1, 0.5, 0],
            "alphaMode": "MASK",
            "alphaCutoff": 0.3,
            "doubleSided": True,
            "extensions": {"KHR_materials_unlit": {}},
        },
        b,
    )
    sampler = Sampler(Wrap.CLAMP_TO_EDGE, Wrap.MIRRORED_REPEAT, mag_linear=False, mip_linear=False)
    image = material.base_color_texture.image
    texture = Texture(image, sampler, name="images[0]")
    assert material == Material(
        base_color=(0.1, 0.2, 0.3, 0.4),
        base_color_texture=texture,
        metallic=0.5,
        roughness=0.25,
        metallic_roughness_texture=Texture(image, sampler, uv_set=1, name="images[0]"),
        normal_texture=texture,
        normal_scale=2,
        occlusion_texture=texture,
        occlusion_strength=0.75,
        emissive=(1, 0.5, 0),
        emissive_texture=texture,
        alpha_mode=AlphaMode.MASK,
        alpha_cutoff=0.3,
        double_sided=True,
        unlit=True,
    )
    assert image.decode().tolist() == np.full((2, 3, 4), (30, 20, 10, 255)).tolist()


@pytest.mark.parametrize(
    ("min_filter", "linear", "mipmaps"),
    [
        (None, True, True),
        (9728, False, False),
        (9729, True, False),
        (9984, False, True),
        (9985, True, True),
        (9986, False, True),
        (9987, True, True),
    ],
)
def test_min_filters(min_filter: int | None, linear: bool, mipmaps: bool) -> None:
    b = with_texture(sampler=0)
    b.add("samplers", {"minFilter": min_filter})
    material, _ = read_material({"emissiveTexture": {"index": 0}}, b)
    assert material.emissive_texture.sampler == Sampler(
        min_linear=linear, mipmaps=mipmaps, mip_linear=min_filter not in (9984, 9985)
    )


VTK = {"pbrMetallicRoughness": {"baseColorFactor": [1, 0.5, 0, 1], "metallicFactor": 0, "roughnessFactor": 1}}


@pytest.mark.parametrize("generator", ["VTK", "Drake glTF merger"])
@pytest.mark.parametrize("texture", [{}, {"baseColorTexture": {"index": 0}}])
@pytest.mark.parametrize(("alpha", "mode"), [(1.0, AlphaMode.OPAQUE), (0.999, AlphaMode.BLEND)])
def test_vtks_materials_are_double_sided_and_blend_by_alpha(
    generator: str, texture: dict[str, Any], alpha: float, mode: AlphaMode
) -> None:
    pbr = {**VTK["pbrMetallicRoughness"], **texture, "baseColorFactor": [1, 0.5, 0, alpha]}
    material, _ = read_material({"pbrMetallicRoughness": pbr}, with_texture(generator=generator))
    assert (material.base_color_texture is not None) == bool(texture)
    assert material.vtk_export
    assert material.double_sided
    assert material.alpha_mode is mode
    assert (material.metallic, material.roughness) == (0.0, 1.0)


@pytest.mark.parametrize(
    "change",
    [
        {"name": "x"},
        {"doubleSided": False},
        {"alphaMode": "OPAQUE"},
        {"emissiveFactor": [0, 0, 0]},
        {"pbrMetallicRoughness": {"baseColorFactor": [1, 0.5, 0, 0.5], "metallicFactor": 0}},
        {"pbrMetallicRoughness": {**VTK["pbrMetallicRoughness"], "roughnessFactor": 0.5}},
        {"pbrMetallicRoughness": {"metallicFactor": 0, "roughnessFactor": 1}},
    ],
)
def test_materials_of_other_shape_are_not_vtk_exports(change: dict[str, Any]) -> None:
    material, _ = read_material({**VTK, **change}, Builder("Drake glTF merger"))
    assert not material.vtk_export
    assert not material.double_sided
    assert material.alpha_mode is AlphaMode.OPAQUE


@pytest.mark.parametrize("attribute", ["NORMAL", "COLOR_0"])
def test_primitives_with_normals_or_colors_are_not_vtk_exports(attribute: str) -> None:
    b = Builder("Drake glTF merger")
    b.add("materials", VTK)
    theirs: dict[str, Any] = {"material": 0, "TEXCOORD_0": np.zeros((3, 2))}
    b.draw(np.eye(3), **theirs, **{attribute: np.ones((3, 3))}).draw(np.eye(3), **theirs)
    assert [part.material.vtk_export for _, part in parts(b.read())] == [False, True]


def test_other_generators_write_no_vtk_materials() -> None:
    assert not read_material(VTK, Builder("Blender"))[0].vtk_export


@pytest.mark.parametrize("label", [0, 1, 255, 256, 4095, 32763, 32764, 0x123456])
def test_labels(label: int) -> None:
    color = [(label >> shift & 255) / 255 for shift in (0, 8, 16)]
    assert label_from_material(read_material({"pbrMetallicRoughness": {"baseColorFactor": [*color, 1]}})[0]) == label


@pytest.mark.parametrize(
    ("source", "extensions"),
    [
        (0, {"KHR_texture_basisu": {"source": 77}, "EXT_texture_webp": {"source": 78}}),
        (None, {"EXT_texture_webp": {"source": 0}}),
    ],
)
def test_texture_source_is_preferred_to_extensions(source: int | None, extensions: dict[str, Any]) -> None:
    """Drake's merge does not re-base the index in the extension. WebP is used where there is nothing else."""
    b = with_texture(source=source, extensions=extensions)
    b.json["extensionsUsed"] = b.json["extensionsRequired"] = [*extensions]
    material, scene = read_material({"emissiveTexture": {"index": 0}}, b)
    assert material.emissive_texture is not None
    assert scene.warnings == ()


def test_extensions_of_dielectrics() -> None:
    b = with_texture()
    material, scene = read_material(
        {
            "emissiveFactor": [1, 0.5, 0],
            "extensions": {
                "KHR_materials_emissive_strength": {"emissiveStrength": 5},
                "KHR_materials_ior": {"ior": 1.33},
                "KHR_materials_specular": {
                    "specularFactor": 0.5,
                    "specularTexture": {"index": 0},
                    "specularColorFactor": [2, 1, 0],
                    "specularColorTexture": {"index": 0},
                },
            },
        },
        b,
    )
    assert (material.emissive, material.emissive_strength) == ((1.0, 0.5, 0.0), 5.0)
    assert (material.ior, material.specular, material.specular_color) == (1.33, 0.5, (2.0, 1.0, 0.0))
    assert material.specular_texture is not None
    assert material.specular_color_texture is not None
    assert scene.warnings == ()
    assert read_material({"extensions": {"KHR_materials_ior": {"ior": 0}}})[0].ior == 0.0
    material, scene = read_material({"extensions": {"KHR_materials_ior": {"ior": "high"}}, "doubleSided": True})
    assert (material.ior, material.double_sided) == (1.5, True)
    assert scene.warnings[0].startswith("materials[0].extensions.KHR_materials_ior.ior: expected a finite number")


def test_specular_glossiness_becomes_a_dielectric_of_the_same_reflectance() -> None:
    glossy = {"diffuseFactor": [0.5, 0.25, 0, 0.5], "specularFactor": [0.04, 0.08, 1], "glossinessFactor": 0.75}
    material, scene = read_material({"extensions": {"KHR_materials_pbrSpecularGlossiness": glossy}})
    assert (material.base_color, material.metallic, material.roughness) == ((0.5, 0.25, 0.0, 0.5), 0.0, 0.25)
    assert material.specular_color == pytest.approx((1, 2, 25))
    assert scene.warnings == ()


@pytest.mark.parametrize(
    ("name", "extension"),
    [
        ("pbrSpecularGlossiness", {"diffuseFactor": [0.5, 0.25, 0, 0.5], "glossinessFactor": 0.75}),
        ("transmission", {"transmissionFactor": 1}),
    ],
)
def test_extensions_change_neither_the_label_nor_the_material_of_other_readers(name: str, extension: Any) -> None:
    pbr = {"baseColorFactor": [7 / 255, 1 / 255, 1, 1], "metallicFactor": 0, "roughnessFactor": 0.5}
    extended = {"pbrMetallicRoughness": pbr, "extensions": {f"KHR_materials_{name}": extension}}
    material, _ = read_material(extended)
    assert label_from_material(material) == 7 + 256 + (255 << 16)
    assert material.fallback == read_material({"pbrMetallicRoughness": pbr})[0]


def test_transmission_is_blended_by_the_light_that_passes() -> None:
    def read(factor: float, color: list[float], metallic: float = 0.0, **properties: Any) -> Material:
        pbr = {"baseColorFactor": color, "metallicFactor": metallic}
        extension = {"KHR_materials_transmission": {"transmissionFactor": factor}}
        material, scene = read_material({"pbrMetallicRoughness": pbr, "extensions": extension, **properties})
        assert scene.warnings == ()
        return material

    clear = read(1.0, [1, 1, 1, 1])
    assert clear.alpha_mode is AlphaMode.BLEND
    assert clear.base_color[3] == pytest.approx(0.08)
    assert read(0.95, [0.8, 0.9, 0.7, 1]).base_color[3] < DOT_ALPHA, "stereo cameras see what is behind"
    assert read(1.0, [0.02, 0.01, 0.02, 1]).base_color[3] > 0.97, "dark glass"
    assert read(1.0, [1, 1, 1, 0.5], alphaMode="BLEND").base_color[3] == pytest.approx(0.04)
    assert read(1.0, [1, 1, 1, 0.5]).base_color[3] == pytest.approx(0.08), "alpha of an opaque material"
    for opaque in (read(0.0, [1, 1, 1, 1]), read(1.0, [1, 1, 1, 1], metallic=1.0)):
        assert (opaque.alpha_mode, opaque.base_color[3], opaque.fallback) == (AlphaMode.OPAQUE, 1.0, None)
    assert read(1.0, [1, 1, 1, 0.4], alphaMode="MASK").alpha_mode is AlphaMode.MASK


def test_transmission_by_texture_is_not_drawn() -> None:
    extension = {"transmissionFactor": 1, "transmissionTexture": {"index": 0}}
    glass = {"pbrMetallicRoughness": {"metallicFactor": 0}, "extensions": {"KHR_materials_transmission": extension}}
    material, scene = read_material(glass, with_texture())
    assert material.alpha_mode is AlphaMode.OPAQUE
    assert scene.warnings == (
        "materials[0].transmissionTexture is not read; the material is drawn without transmission",
    )


def test_image_names_are_those_of_each_document() -> None:
    cache = GltfCache()
    found = []
    info = {"index": 0, "extensions": {"KHR_texture_transform": {"offset": [0.5, 0]}}}
    for place, name in enumerate(("first", "second")):
        b = with_texture(*[png((1, 2, 3))] * place, png())
        b.json["images"][place]["name"] = name
        b.json["textures"][0]["source"] = place
        b.draw(material=b.add("materials", {"emissiveTexture": info}))
        found.append(parts(b.read(cache=cache))[0][1].material.emissive_texture)
    one, two = found
    assert one.image is two.image
    assert (one.name, two.name) == ("images[0] (first)", "images[1] (second)")


def test_limits_do_not_depend_on_earlier_documents() -> None:
    """A cached image counts as much as a new one."""
    data = png()
    b = with_texture(data, data)
    b.json["images"] = [{"bufferView": b.view(data)}] * 2
    material = {"normalTexture": {"index": 0}, "emissiveTexture": {"index": 1}}
    b.node(mesh=b.triangle(material=b.add("materials", material)))
    enough = next(n for n in itertools.count(1) if _fits(b, n))
    cache = GltfCache()
    b.read(limits=GltfLimits(max_buffer_bytes=enough), cache=cache)
    for _ in range(3):
        with pytest.raises(GltfError, match="max_buffer_bytes"):
            b.read(limits=GltfLimits(max_buffer_bytes=enough - 1), cache=cache)


def _fits(b: Builder, max_buffer_bytes: int) -> bool:
    try:
        b.read(limits=GltfLimits(max_buffer_bytes=max_buffer_bytes))
    except GltfError:
        return False
    return True


def test_equal_images_of_buffer_views_and_uris_are_one_object() -> None:
    data = png()
    b = with_texture(data, data)
    view = b.view(b"1234567" + data + b"8", byteOffset=7)
    b.json["bufferViews"][view]["byteLength"] = len(data)
    b.json["images"][0] = {"bufferView": view, "mimeType": "image/jpeg"}
    material, _ = read_material({"emissiveTexture": {"index": 0}, "normalTexture": {"index": 1}}, b)
    assert material.emissive_texture.image is material.normal_texture.image


def test_pixels_are_limited_by_the_headers() -> None:
    b = with_texture(*(png((i, i, i), (10, 10)) for i in range(3)))
    material = {"normalTexture": {"index": 0}, "occlusionTexture": {"index": 1}, "emissiveTexture": {"index": 2}}
    b.node(mesh=b.triangle(material=b.add("materials", material)))
    b.read(limits=GltfLimits(max_image_pixels=100, max_total_image_pixels=300))
    with pytest.raises(GltfError, match=r"images\[0\]: 100 .*max_image_pixels = 99"):
        b.read(limits=GltfLimits(max_image_pixels=99))
    with pytest.raises(GltfError, match=r"images\[2\]: .* max_total_image_pixels = 299"):
        b.read(limits=GltfLimits(max_total_image_pixels=299))


@pytest.mark.parametrize(
    ("transform", "uv", "expected"),
    [
        ({"offset": [0.5, 0.25]}, (0, 0), (0.5, 0.25)),
        ({"scale": [2, 3]}, (0.5, 0.5), (1, 1.5)),
        ({"rotation": math.pi / 2}, (1, 0), (0, -1)),  # counter-clockwise where v points down
        ({"rotation": math.pi / 2, "scale": [2, 3], "offset": [1, 1]}, (0, 1), (4, 1)),  # scaled first
        ({}, (0.3, 0.7), (0.3, 0.7)),
    ],
)
def test_texture_transform(transform: dict[str, Any], uv: tuple[float, float], expected: tuple[float, float]) -> None:
    info = {"index": 0, "texCoord": 0, "extensions": {"KHR_texture_transform": {**transform, "texCoord": 1}}}
    material, _ = read_material({"emissiveTexture": info}, with_texture())
    assert material.emissive_texture.uv_set == 1
    a, b, c, d, e, f = material.emissive_texture.uv_transform
    u, v = uv
    np.testing.assert_allclose((a * u + b * v + c, d * u + e * v + f), expected, atol=1e-12)


@pytest.mark.parametrize(
    ("info", "samplers", "values", "warning"),
    [
        ({}, [{"wrapS": 1}], {}, "samplers[0].wrapS: 1 is not a wrap mode, REPEAT is used"),
        ({}, [], {}, "textures[0].sampler: 0 is out of range (0 samplers); the default sampler is used"),
        ({"texCoord": 5}, [{}], {}, "materials[0].emissiveTexture: TEXCOORD_5 is not read, TEXCOORD_0 is used"),
        (
            {"extensions": {"KHR_texture_transform": 2}},
            [{}],
            {},
            "materials[0].emissiveTexture.extensions.KHR_texture_transform: expected an object, got 2; it is ignored",
        ),
        (
            {},
            [{}],
            {"alphaMode": "GLASS"},
            "materials[0].alphaMode: 'GLASS' is not OPAQUE, MASK or BLEND; OPAQUE is used",
        ),
    ],
)
def test_invalid_values_are_repaired_with_a_warning(
    info: dict[str, Any], samplers: list[Any], values: dict[str, Any], warning: str
) -> None:
    b = with_texture(sampler=0)
    b.json["samplers"] = samplers
    material, scene = read_material({"emissiveTexture": {"index": 0, **info}, "doubleSided": True, **values}, b)
    assert material.emissive_texture.uv_set == 0
    assert material.emissive_texture.sampler == Sampler()
    assert (material.alpha_mode, material.double_sided) == (AlphaMode.OPAQUE, True)
    assert scene.warnings == (warning,)


@pytest.mark.parametrize(
    ("info", "texture", "message"),
    [
        ({"index": 3}, {}, "materials[0].normalTexture.index: 3 is out of range (1 textures)"),
        ({}, {}, "materials[0].normalTexture.index: missing"),
        (
            {"index": 0},
            {"source": None, "extensions": {"EXT_texture_webp": {"source": "x"}}},
            'textures[0].extensions.EXT_texture_webp.source: expected an integer, got "x"',
        ),
    ],
)
def test_a_texture_that_cannot_be_read_is_left_out(info: Any, texture: dict[str, Any], message: str) -> None:
    material, scene = read_material({"normalTexture": info, "alphaMode": "MASK"}, with_texture(**texture))
    assert (material.normal_texture, material.alpha_mode) == (None, AlphaMode.MASK)
    (warning,) = scene.warnings
    assert message in warning
    assert warning.endswith("; the texture is left out")


KTX2 = {"uri": data_uri(b"\xabKTX 20\xbb\r\n\x1a\n" + bytes(99)), "name": "bottle"}


@pytest.mark.parametrize(
    ("texture", "image", "message"),
    [
        ({"source": 4}, {}, "textures[0].source: 4 is out of range (1 images)"),
        ({}, {"uri": None}, "images[0]: there is neither a uri nor a bufferView"),
        ({}, {"bufferView": 4}, "images[0].bufferView: 4 is out of range (3 bufferViews)"),
        ({}, {"uri": "data:image/png;base64"}, "images[0].uri: not a valid data URI: there is no comma"),
        ({}, {"uri": "data:image/png;base64,!!!"}, "images[0].uri: not a valid data URI"),
        ({}, KTX2, "images[0] (bottle): KTX2 images are not supported, only PNG, JPEG and WebP"),
        (
            {"source": None, "extensions": {"KHR_texture_basisu": {"source": 0}}},
            {},
            "textures[0]: no source (KHR_texture_basisu), so there is no texture",
        ),
    ],
)
def test_textures_that_cannot_be_read_are_left_out(
    texture: dict[str, Any], image: dict[str, Any], message: str
) -> None:
    b = with_texture(**texture)
    b.json["images"][0].update(image)
    material, scene = read_material({"normalTexture": {"index": 0}}, b)
    assert material.normal_texture is None
    (warning,) = scene.warnings
    assert warning.startswith(message)
    assert warning.endswith(("; textures[0] is left out", "so there is no texture"))


def test_extensions_that_are_not_required_are_ignored() -> None:
    b = Builder()
    b.json["extensionsUsed"] = ["KHR_lights_punctual", "KHR_materials_unlit", None, "ACME_x", "KHR_materials_sheen"]
    b.json["extensionsRequired"] = ["KHR_lights_punctual", "KHR_mesh_quantization", None]
    b.json["materials"] = [{"extensions": {"KHR_materials_sheen": {}}}]
    first, second = b.read().warnings
    assert (first, second.split()[1]) == ("extensionsUsed: ACME_x ignored", "KHR_materials_sheen")
    assert warnings_and_notes((first, second)) == ((first,), (second,))


def test_extensions_that_change_no_image_give_no_warning() -> None:
    """Every tile of Cesium has metadata, every scene of Godot its mark; ``--strict`` reads them, too."""
    b = Builder()
    b.triangle()
    names = ["EXT_mesh_features", "EXT_structural_metadata", "GODOT_single_root", "KHR_xmp_json_ld", "OMI_physics_body"]
    names += ["FB_ngon_encoding", "KHR_materials_volume"]  # of Assimp; no material has the second one
    b.json["extensionsUsed"] = b.json["extensionsRequired"] = names
    assert b.read().warnings == ()


def test_required_extensions_are_ignored() -> None:
    """As VTK, three.js and trimesh do."""
    b = Builder()
    b.json["extensionsRequired"] = ["KHR_materials_x", "ACME_x", "KHR_texture_basisu", "EXT_meshopt_compression"]
    b.json["materials"] = [None, {}, {"extensions": {"KHR_materials_x": {}}}]
    assert b.read().warnings == ("extensionsUsed: ACME_x, KHR_materials_x ignored",)


@pytest.mark.parametrize(
    ("color", "label"),
    [
        ((-1, 0, 0), 0),
        ((0, -0.2, 0), 0),
        ((0, 0, -1e13), 0),
        ((2, 0, 0), 0xFF),
        ((0, 1.5, 0), 0xFF00),
        ((0, 0, 1e13), 0xFF0000),
        ((1.4 / 255, 1.6 / 255, 0), 0x0201),
    ],
)
def test_labels_of_colors_out_of_range_are_clamped_and_others_rounded(
    color: tuple[float, float, float], label: int
) -> None:
    assert label_from_material(Material(base_color=(*color, 1.0))) == label


def test_variants_choose_other_materials() -> None:
    b = Builder()
    red, green, blue = (
        b.add("materials", {"pbrMetallicRoughness": {"baseColorFactor": [*color, 1]}})
        for color in ((1, 0, 0), (0, 1, 0), (0, 0, 1))
    )
    b.json["extensions"] = {"KHR_materials_variants": {"variants": [{"name": "meadow"}, {"name": "sea"}]}}
    mappings = [{"material": green, "variants": [0]}, {"material": blue, "variants": [1]}]
    b.node(mesh=b.triangle(material=red, extensions={"KHR_materials_variants": {"mappings": mappings}}))
    b.node(mesh=b.triangle(material=red))
    for variant, color in ((None, (1, 0, 0)), ("meadow", (0, 1, 0)), ("sea", (0, 0, 1)), ("desert", (1, 0, 0))):
        scene = b.read(variant=variant)
        first, second = (part.material for _, part in parts(scene))
        assert list(first.base_color[:3]) == list(color)
        assert list(second.base_color[:3]) == [1, 0, 0]
        expected = "the file has no material variant 'desert' (it has 'meadow', 'sea'), the default materials are drawn"
        assert scene.warnings == ((expected,) if variant == "desert" else ())
