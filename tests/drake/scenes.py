"""Scenes whose colour images depend on what RenderEngineVtk does with textures, alpha and materials.

Imported by an interpreter that has pydrake.
"""

import json
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np
from pydrake.geometry import Box, Cylinder, Mesh, Sphere
from pydrake.math import RigidTransform, RollPitchYaw, RotationMatrix

from tests.drake.assets import Gltf, checkers, embedded, gradient, png, quad, sphere, with_alpha, write_obj

SMALL: Final = (160, 120)
"""Width and height of most images in pixels."""
FRONT: Final = ([0.0, -1.0, 0.0], [0.0, 0.0, 0.0])
"""Eye and target of a camera that looks along +Y, in metres."""
ABOVE_LEFT: Final = ([-0.6, -0.8, 0.5], [0.0, 0.0, 0.0])

LINEAR, NEAREST = 9729, 9728
NEAREST_MIPMAP_NEAREST, LINEAR_MIPMAP_NEAREST, NEAREST_MIPMAP_LINEAR, LINEAR_MIPMAP_LINEAR = range(9984, 9988)
REPEAT, CLAMP, MIRROR = 10497, 33071, 33648


@dataclass(frozen=True)
class Body:
    """A geometry with Drake's "phong" properties."""

    shape: Any
    position: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """In metres, in the world frame."""
    roll_pitch_yaw: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """Radians."""
    diffuse: tuple[float, float, float, float] | None = None
    diffuse_map: Path | None = None
    label: int | None = None
    """By default its number in the scene, from 1."""

    @property
    def pose(self) -> RigidTransform:
        return RigidTransform(RollPitchYaw(*self.roll_pitch_yaw), self.position)


def looking_at(eye: Sequence[float], target: Sequence[float]) -> RigidTransform:
    """Return the pose of a camera that looks at a point, upright."""
    forward = np.subtract(target, eye) / np.linalg.norm(np.subtract(target, eye))
    right = np.cross(forward, [0, 0, 1.0])
    right /= np.linalg.norm(right)
    return RigidTransform(RotationMatrix(np.column_stack([right, np.cross(forward, right), forward])), np.array(eye))


@dataclass(frozen=True)
class Scene:
    bodies: list[Body]
    camera: tuple[list[float], list[float]] = FRONT
    """Eye and target in metres."""
    size: tuple[int, int] = SMALL
    far: float = 10.0
    """The far clipping plane in metres."""

    @property
    def camera_pose(self) -> RigidTransform:
        return looking_at(*self.camera)


SCENES: Final[dict[str, Callable[[Path], Scene]]] = {}
"""Functions that write a scene's files into a folder and return the scene, by name."""


def scene(name: str) -> Callable[[Callable[[Path], Scene]], Callable[[Path], Scene]]:
    def add(make: Callable[[Path], Scene]) -> Callable[[Path], Scene]:
        assert name not in SCENES
        SCENES[name] = make
        return make

    return add


def write(folder: Path, pixels: np.ndarray, name: str = "texture") -> Path:
    path = folder / f"{name}.png"
    path.write_bytes(png(pixels))
    return path


def gltf(folder: Path, document: Gltf, name: str = "mesh") -> Mesh:
    return Mesh(str(document.write(folder / f"{name}.gltf")), 1.0)


RED, GREEN, BLUE = (0.9, 0.1, 0.1), (0.1, 0.9, 0.1), (0.1, 0.1, 0.9)
BEHIND: Final = Body(Box(1.0, 0.02, 0.3), (0, 0.6, 0), diffuse=(0.9, 0.3, 0.1, 1.0))
WIDE_BEHIND: Final = Body(Box(0.8, 0.02, 0.5), (0, 0.5, 0), diffuse=(0.9, 0.3, 0.1, 1.0))


def before_box(folder: Path, document: Gltf) -> Scene:
    return Scene([BEHIND, Body(gltf(folder, document))])


def single_ball(folder: Path, document: Gltf, material: int, *behind: Body, size: tuple[int, int] = SMALL) -> Scene:
    document.node(document.mesh(*sphere(), material))
    return Scene([*behind, Body(gltf(folder, document))], size=size)


# -- textures of Drake's primitives ------------------------------------------------------------------------------------

WHITE = np.full((1, 1, 3), 255, np.uint8)
BOARD = checkers(64, 8, (40, 60, 160), (230, 200, 40))

PRIMITIVE_TEXTURES: Final[dict[str, np.ndarray]] = {
    "rgb": BOARD,
    "grey": BOARD[..., :1],
    "grey_alpha": np.concatenate([BOARD[..., :1], BOARD[..., 2:]], -1),
    "transparent": with_alpha(WHITE, np.zeros((1, 1))),
    "opaque_alpha": with_alpha(BOARD, np.full((64, 64), 255)),
    "half_alpha": with_alpha(BOARD, np.full((64, 64), 128)),
    "cut_out": with_alpha(BOARD, checkers(64, 16, (0,), (255,))[..., 0]),
    "alpha_gradient": with_alpha(BOARD, np.linspace(0, 255, 64)[None, :]),
}
for _name, _pixels in PRIMITIVE_TEXTURES.items():
    for _diffuse in (None, (1.0, 0.6, 0.6, 1.0), (0.6, 1.0, 0.6, 0.4)):
        _suffix = {None: "", 1.0: "_tinted", 0.4: "_see_through"}[_diffuse and _diffuse[3]]

        @scene(f"primitives_{_name}{_suffix}")
        def _primitives(
            folder: Path, pixels: np.ndarray = _pixels, diffuse: tuple[float, float, float, float] | None = _diffuse
        ) -> Scene:
            texture = write(folder, pixels)
            return Scene(
                [
                    WIDE_BEHIND,
                    Body(Sphere(0.15), (-0.2, 0, 0.1), diffuse=diffuse, diffuse_map=texture),
                    Body(Box(0.2, 0.2, 0.2), (0.2, 0, 0.1), (0.3, 0.2, 0.5), diffuse, texture),
                    Body(Cylinder(0.08, 0.3), (0.0, -0.1, -0.15), (0.2, 1.5, 0), diffuse, texture),
                ]
            )


@scene("primitives_minified")
def primitives_minified(folder: Path) -> Scene:
    texture = write(folder, checkers(512, 8, (20, 20, 20), (240, 240, 240)))
    return Scene([Body(Box(3.0, 8.0, 0.1), (0, 3.0, -0.3), diffuse_map=texture)])


@scene("primitives_minified_beside_gltf")
def primitives_minified_beside_gltf(folder: Path) -> Scene:
    floor = primitives_minified(folder).bodies
    document = Gltf()
    document.node(document.mesh(*quad(0.2, 0.2), document.material(doubleSided=True)))
    return Scene([*floor, Body(gltf(folder, document), (0, 0, 0.15))])


# -- OBJ meshes --------------------------------------------------------------------------------------------------------

OBJ_MATERIALS: Final = {
    "rgba_map": "Kd 1 1 1\nmap_Kd texture.png",
    "tinted_map": "Kd 1 0.5 0.5\nmap_Kd texture.png",
    "dissolved": "Kd 0.2 0.8 0.4\nd 0.4",
    "opaque": "Kd 0.2 0.8 0.4",
}
for _name, _material in OBJ_MATERIALS.items():

    @scene(f"obj_{_name}")
    def _obj(folder: Path, material: str = _material) -> Scene:
        write(folder, PRIMITIVE_TEXTURES["alpha_gradient"])
        path = write_obj(folder / "ball.obj", *sphere(), material)
        return Scene([WIDE_BEHIND, Body(Mesh(str(path), 1.0))])


@scene("obj_mirrored")
def obj_mirrored(folder: Path) -> Scene:
    write(folder, BOARD)
    path = write_obj(folder / "ball.obj", *sphere(), "Kd 1 1 1\nmap_Kd texture.png")
    return Scene([Body(Mesh(str(path), np.array([-1.0, 1.0, 0.6])))])


# -- glTF: samplers ----------------------------------------------------------------------------------------------------


def textured_quad(folder: Path, sampler: dict[str, int] | None, repeat: float, size: float = 0.9) -> Mesh:
    document = Gltf()
    texture = document.texture(checkers(256, 8, (30, 30, 120), (250, 240, 200)), sampler)
    document.node(document.mesh(*quad(size, size, repeat), document.matte(texture=texture)))
    return gltf(folder, document)


SAMPLERS: Final[dict[str, dict[str, int] | None]] = {
    "none": None,
    "empty": {},
    "nearest": {"minFilter": NEAREST, "magFilter": NEAREST},
    "linear": {"minFilter": LINEAR, "magFilter": LINEAR},
    "nearest_mipmap_nearest": {"minFilter": NEAREST_MIPMAP_NEAREST, "magFilter": NEAREST},
    "linear_mipmap_nearest": {"minFilter": LINEAR_MIPMAP_NEAREST, "magFilter": LINEAR},
    "nearest_mipmap_linear": {"minFilter": NEAREST_MIPMAP_LINEAR, "magFilter": LINEAR},
    "linear_mipmap_linear": {"minFilter": LINEAR_MIPMAP_LINEAR, "magFilter": LINEAR},
    "only_magnification_nearest": {"magFilter": NEAREST},
    "only_magnification_linear": {"magFilter": LINEAR},
    "only_minification_nearest": {"minFilter": NEAREST},
    "only_minification_linear": {"minFilter": LINEAR},
    "linear_magnification_nearest": {"minFilter": LINEAR, "magFilter": NEAREST},
    "mipmap_magnification_nearest": {"minFilter": LINEAR_MIPMAP_LINEAR, "magFilter": NEAREST},
    "nearest_magnification_linear": {"minFilter": NEAREST, "magFilter": LINEAR},
    "nearest_mipmap_nearest_magnification_linear": {"minFilter": NEAREST_MIPMAP_NEAREST, "magFilter": LINEAR},
}
for _name, _sampler in SAMPLERS.items():

    @scene(f"minified_{_name}")
    def _minified(folder: Path, sampler: dict[str, int] | None = _sampler) -> Scene:
        mesh = textured_quad(folder, sampler, 2.0, 3.0)
        return Scene([Body(mesh, (0, 2.0, 0), (-1.2, 0.1, 0))])

    @scene(f"magnified_{_name}")
    def _magnified(folder: Path, sampler: dict[str, int] | None = _sampler) -> Scene:
        return Scene([Body(textured_quad(folder, sampler, 0.25), (0, 0.2, 0), (-0.2, 0.1, 0.3))])


WRAPS: Final = {"repeat": REPEAT, "clamp": CLAMP, "mirror": MIRROR}
for _s, _wrap_s in WRAPS.items():
    for _t, _wrap_t in WRAPS.items():

        @scene(f"wrap_{_s}_{_t}")
        def _wrap(folder: Path, wrap_s: int = _wrap_s, wrap_t: int = _wrap_t) -> Scene:
            document = Gltf()
            sampler = {"wrapS": wrap_s, "wrapT": wrap_t, "minFilter": LINEAR, "magFilter": LINEAR}
            texture = document.texture(gradient(32), sampler)
            attributes, indices = quad(0.9, 0.7)
            attributes["TEXCOORD_0"] = attributes["TEXCOORD_0"] * 3.0 - 1.0
            document.node(document.mesh(attributes, indices, document.matte(texture=texture)))
            return Scene([Body(gltf(folder, document))])


# -- glTF: alpha -------------------------------------------------------------------------------------------------------

for _mode in ("OPAQUE", "MASK", "BLEND"):
    for _kind in ("factor", "texture", "both"):
        for _sided in (False, True):

            @scene(f"alpha_{_mode.lower()}_{_kind}{'_double' if _sided else ''}")
            def _alpha(folder: Path, mode: str = _mode, kind: str = _kind, double_sided: bool = _sided) -> Scene:
                document = Gltf()
                color = [0.3, 0.9, 0.4, 0.6] if kind != "texture" else None
                texture = document.texture(PRIMITIVE_TEXTURES["alpha_gradient"]) if kind != "factor" else None
                material = document.matte(color, texture, alphaMode=mode, doubleSided=double_sided)
                return single_ball(folder, document, material, BEHIND)


CUT_OUTS: Final[dict[str, tuple[str, dict[str, Any]]]] = {
    "mask_cutoff": ("alpha_gradient", {"alphaMode": "MASK", "alphaCutoff": 0.8}),
    **{f"cut_out_{mode.lower()}": ("cut_out", {"alphaMode": mode}) for mode in ("OPAQUE", "MASK", "BLEND")},
}
for _name, (_texture, _fields) in CUT_OUTS.items():

    @scene(f"alpha_{_name}")
    def _cut_out(folder: Path, texture: str = _texture, fields: dict[str, Any] = _fields) -> Scene:
        document = Gltf()
        pixels = document.texture(PRIMITIVE_TEXTURES[texture])
        return single_ball(folder, document, document.matte(None, pixels, doubleSided=True, **fields), BEHIND)


@scene("several_nodes_with_alpha")
def several_nodes_with_alpha(folder: Path) -> Scene:
    """The order in which VTK draws the nodes of one file."""
    document = Gltf()
    for i, color in enumerate((RED, GREEN, BLUE)):
        mesh = document.mesh(*quad(0.4, 0.4), document.matte((*color, 0.5)))
        document.node(mesh, translation=[0.1 * i - 0.1, 0.05 * i, -0.2 * i])
    return before_box(folder, document)


@scene("several_primitives_with_alpha")
def several_primitives_with_alpha(folder: Path) -> Scene:
    """The order in which VTK draws the primitives of one mesh."""
    document = Gltf()
    primitives = []
    for i, color in enumerate((RED, GREEN, BLUE)):
        attributes, indices = quad(0.4, 0.4)
        attributes["POSITION"] = attributes["POSITION"] + [0.1 * i - 0.1, 0.05 * i, -0.2 * i]
        mesh = document.mesh(attributes, indices, document.matte((*color, 0.5)))
        primitives += document.document["meshes"][mesh]["primitives"]
    document.document["meshes"] = [{"primitives": primitives}]
    document.node(0)
    return before_box(folder, document)


LAYERS: Final = tuple((*color, 0.5) for color in (RED, GREEN, BLUE))


def stacked_gltf(folder: Path, order: tuple[int, ...]) -> list[Body]:
    bodies = []
    for i in order:
        document = Gltf()
        document.node(document.mesh(*quad(0.4, 0.4), document.matte(LAYERS[i], alphaMode="BLEND")))
        bodies.append(Body(gltf(folder, document, f"layer{i}"), (0.1 * i - 0.1, 0.2 * i, 0.05 * i)))
    return bodies


def stacked_boxes(order: tuple[int, ...]) -> list[Body]:
    return [Body(Box(0.4, 0.1, 0.4), (0.1 * i - 0.1, 0.2 * i, 0.05 * i), diffuse=LAYERS[i]) for i in order]


for _order in ((0, 1, 2), (2, 1, 0), (1, 2, 0)):
    _suffix = "".join(map(str, _order))

    @scene(f"stacked_gltf_{_suffix}")
    def _stacked_gltf(folder: Path, order: tuple[int, ...] = _order) -> Scene:
        return Scene([BEHIND, *stacked_gltf(folder, order)])

    @scene(f"stacked_boxes_{_suffix}")
    def _stacked_boxes(folder: Path, order: tuple[int, ...] = _order) -> Scene:
        return Scene([BEHIND, *stacked_boxes(order)])


@scene("stacked_boxes_beside_gltf")
def stacked_boxes_beside_gltf(folder: Path) -> Scene:
    return Scene([BEHIND, *stacked_boxes((1, 2, 0)), *stacked_gltf(folder, (2, 0))], ABOVE_LEFT)


# -- glTF: other materials ---------------------------------------------------------------------------------------------


def mirrored_and_plain(folder: Path, document: Gltf, material: int, scale: list[float]) -> Scene:
    mesh = document.mesh(*sphere(0.2), material)
    document.node(mesh, scale=scale, translation=[-0.22, 0.0, 0.0])
    document.node(mesh, translation=[0.22, 0.0, 0.0])
    return Scene([Body(gltf(folder, document))])


@scene("mirrored_node")
def mirrored_node(folder: Path) -> Scene:
    document = Gltf()
    material = document.matte(texture=document.texture(BOARD))
    return mirrored_and_plain(folder, document, material, [-1.0, 1.0, 1.0])


@scene("mirrored_node_double_sided")
def mirrored_node_double_sided(folder: Path) -> Scene:
    document = Gltf()
    material = document.matte([0.3, 0.8, 0.9, 1.0], doubleSided=True)
    return mirrored_and_plain(folder, document, material, [1.0, -1.0, 1.0])


def normal_map() -> np.ndarray:
    x = np.linspace(0, 8 * np.pi, 128)
    slope = 0.5 * np.cos(x)
    normal = np.stack([np.broadcast_to(slope, (128, 128)), np.broadcast_to(slope[:, None], (128, 128))], -1)
    z = np.sqrt(1 - (normal**2).sum(-1, keepdims=True) * 0.5)
    normal = np.concatenate([normal * np.sqrt(0.5), z], -1)
    return np.round(127.5 * (normal + 1)).astype(np.uint8)


GREY, MIXED = [0.2, 0.2, 0.2, 1.0], gradient(64)[..., [2, 0, 1]]
BALLS: Final[dict[str, Callable[[Gltf], int]]] = {
    "emissive_factor": lambda d: d.matte(GREY, emissiveFactor=[0.5, 0.3, 0.0]),
    "emissive_texture": lambda d: d.matte(GREY, emissiveFactor=[0.5, 1.0, 0.3], emissiveTexture=d.texture(BOARD)),
    "emissive_strength": lambda d: d.matte(
        GREY,
        emissiveFactor=[0.2, 0.2, 0.2],
        emissiveTexture=d.texture(BOARD),
        extensions={"KHR_materials_emissive_strength": {"emissiveStrength": 3.0}},
    ),
    "maps_normal": lambda d: d.material(normalTexture=d.texture(normal_map(), scale=0.8)),
    "maps_metallic_roughness": lambda d: d.material(
        pbrMetallicRoughness={"baseColorFactor": [0.8, 0.6, 0.3, 1.0], "metallicRoughnessTexture": d.texture(MIXED)}
    ),
    "maps_occlusion": lambda d: d.matte(occlusionTexture=d.texture(BOARD, strength=0.7)),
    "maps_all": lambda d: d.material(
        pbrMetallicRoughness={"baseColorTexture": d.texture(BOARD), "metallicRoughnessTexture": d.texture(MIXED)},
        normalTexture=d.texture(normal_map()),
        occlusionTexture=d.texture(gradient(64), strength=0.7),
        emissiveTexture=d.texture(checkers(64, 32, (0, 0, 0), (0, 60, 120))),
        emissiveFactor=[1.0, 1.0, 1.0],
    ),
    "unlit": lambda d: d.material(
        pbrMetallicRoughness={"baseColorFactor": [0.7, 0.3, 0.2, 1.0]}, extensions={"KHR_materials_unlit": {}}
    ),
    "texture_transform": lambda d: d.matte(
        texture=d.texture(
            gradient(64),
            extensions={"KHR_texture_transform": {"scale": [2.0, 3.0], "offset": [0.2, 0.1], "rotation": 0.4}},
        )
    ),
    # An extension that VTK ignores, and whose colour is no label.
    "specular_glossiness": lambda d: d.matte(
        [0.9, 0.4, 0.1, 1.0],
        extensions={
            "KHR_materials_pbrSpecularGlossiness": {
                "diffuseFactor": [0.2, 0.4, 0.9, 1.0],
                "specularFactor": [0.5, 0.5, 0.5],
                "glossinessFactor": 0.9,
            }
        },
    ),
}
for _name, _make in BALLS.items():

    @scene(_name)
    def _ball(folder: Path, name: str = _name, make: Callable[[Gltf], int] = _make) -> Scene:
        document = Gltf()
        size = (320, 240) if name.startswith("maps_") else SMALL
        return single_ball(folder, document, make(document), size=size)


@scene("materials_metal_and_rough")
def materials_metal_and_rough(folder: Path) -> Scene:
    document = Gltf()
    for i, (metallic, roughness) in enumerate(((0.0, 0.1), (0.0, 1.0), (1.0, 0.2), (0.5, 0.5))):
        pbr = {"baseColorFactor": [0.9, 0.5, 0.2, 1.0], "metallicFactor": metallic, "roughnessFactor": roughness}
        mesh = document.mesh(*sphere(0.12), document.material(pbrMetallicRoughness=pbr))
        document.node(mesh, translation=[-0.42 + 0.28 * i, 0.0, 0.0])
    return Scene([Body(gltf(folder, document))])


CORNER_COLORS = np.array([[1, 0, 0, 1], [0, 1, 0, 0.7], [0, 0, 1, 0.4], [1, 1, 1, 0.1]])
QUADS: Final[dict[str, tuple[dict[str, np.ndarray], Callable[[Gltf], int], tuple[Body, ...]]]] = {
    "vertex_grey": ({"COLOR_0": np.full((4, 3), 0.5)}, lambda d: d.matte(), ()),
    "vertex_colors_alpha": ({"COLOR_0": CORNER_COLORS}, lambda d: d.matte(alphaMode="BLEND"), (BEHIND,)),
    "second_texcoord": (
        {"TEXCOORD_1": quad()[0]["TEXCOORD_0"] * 2.0},
        lambda d: d.matte(texture=d.texture(BOARD, texCoord=1)),
        (),
    ),
    "grey_alpha": ({}, lambda d: d.matte(texture=d.texture(PRIMITIVE_TEXTURES["grey_alpha"])), (BEHIND,)),
    "sixteen_bits": ({}, lambda d: d.matte(texture=d.texture(gradient(64).astype(np.uint16) * 257)), (BEHIND,)),
}
for _name, _quad in QUADS.items():

    @scene(_name)
    def _one_quad(
        folder: Path, given: tuple[dict[str, np.ndarray], Callable[[Gltf], int], tuple[Body, ...]] = _quad
    ) -> Scene:
        more, material, behind = given
        document = Gltf()
        attributes, indices = quad()
        document.node(document.mesh(attributes | more, indices, material(document)))
        return Scene([*behind, Body(gltf(folder, document))])


@scene("back_faces")
def back_faces(folder: Path) -> Scene:
    document = Gltf()
    for x, material in ((-0.2, document.matte()), (0.2, document.matte(doubleSided=True))):
        mesh = document.mesh(*quad(0.3, 0.3), material)
        document.node(mesh, translation=[x, 0.0, 0.0], rotation=[0.0, 1.0, 0.0, 0.0])
    return before_box(folder, document)


@scene("without_normals")
def without_normals(folder: Path) -> Scene:
    """A ball, the same mirrored, and a sheet of triangles with both windings."""
    document = Gltf()
    material = document.matte(doubleSided=True)
    attributes, indices = sphere(0.2, 8, 12)
    ball = document.mesh({"POSITION": attributes["POSITION"]}, indices, material)
    document.node(ball, translation=[-0.25, 0.0, 0.0])
    document.node(ball, translation=[0.25, 0.0, 0.0], scale=[-1.0, 1.0, 1.0])
    attributes, indices = quad(0.9, 0.3)
    triangles = np.array(indices).reshape(-1, 3)
    triangles[0] = triangles[0, ::-1]
    document.node(document.mesh({"POSITION": attributes["POSITION"]}, triangles.reshape(-1), material))
    return before_box(folder, document)


@scene("twins")
def twins(folder: Path) -> Scene:
    """Of two identical things, the one that is drawn last is seen, by its label as well."""
    red, green = (*RED, 1.0), (*GREEN, 1.0)
    boxes = [Body(Box(0.2, 0.2, 0.2), (0.25, 0, 0), (0.3, 0.2, 0.5), color) for color in (red, green)]
    return Scene([*boxes, *(Body(Sphere(0.15), (-0.25, 0, 0), diffuse=color) for color in (green, red))])


@scene("twins_gltf")
def twins_gltf(folder: Path) -> Scene:
    document = Gltf()
    for color in (RED, GREEN, BLUE):
        document.node(document.mesh(*sphere(0.2), document.matte((*color, 1.0))))
    return before_box(folder, document)


@scene("without_material")
def without_material(folder: Path) -> Scene:
    """A ball, a tilted quad and one seen from behind, without a material, in the first glTF file and in later ones."""
    document = Gltf()
    tilted, turned = quad(0.2, 0.2), quad(0.2, 0.2)
    tilted[0]["POSITION"] = tilted[0]["POSITION"] @ np.array([[1, 0, 0], [0, 0.8, -0.6], [0, 0.6, 0.8]]) + [0, 0.27, 0]
    tilted[0]["NORMAL"] = tilted[0]["NORMAL"] @ np.array([[1, 0, 0], [0, 0.8, -0.6], [0, 0.6, 0.8]])
    turned[0]["POSITION"] = turned[0]["POSITION"] * [-1, 1, 1] - [0, 0.27, 0]
    meshes = [document.mesh(*shape, None) for shape in (sphere(0.12), tilted, turned)]
    primitives = [document.document["meshes"][mesh]["primitives"][0] for mesh in meshes]
    document.document["meshes"] = [{"primitives": primitives}]  # Drake 1.51 does not tell the roots of files apart
    document.node(0)
    mesh = gltf(folder, document)
    return Scene([BEHIND, *(Body(mesh, (x, 0, 0)) for x in (-0.35, 0.0, 0.35))])


@scene("blended_gltf_before_gltf_floor")
def blended_gltf_before_gltf_floor(folder: Path) -> Scene:
    """The blended mesh is drawn first, if opaque ones are not."""
    bodies = []
    for order, name in enumerate(("film", "floor")):
        document = Gltf()
        film = name == "film"
        material = document.matte(LAYERS[0], alphaMode="BLEND") if film else document.matte([0.2, 0.8, 0.3, 1.0])
        document.node(document.mesh(*quad(0.4, 0.4), material))
        bodies.append(Body(gltf(folder, document, name), (0.1 * order, 0.2 * order, 0.05 * order)))
    return Scene([BEHIND, *bodies, *reversed([Body(b.shape, (0.0, 0.1, -0.2)) for b in bodies])])


@scene("blended_texture_before_gltf_floor")
def blended_texture_before_gltf_floor(folder: Path) -> Scene:
    film, floor = Gltf(), Gltf()
    texture = film.texture(PRIMITIVE_TEXTURES["half_alpha"])
    film.node(film.mesh(*quad(0.4, 0.4), film.matte(texture=texture, alphaMode="BLEND")))
    floor.node(floor.mesh(*quad(0.6, 0.6), floor.matte()))
    bodies = [Body(gltf(folder, film, "film"), (0, 0, 0)), Body(gltf(folder, floor, "floor"), (0.1, 0.2, 0.1))]
    return Scene([BEHIND, *bodies])


@scene("skin_and_morph_target")
def skin_and_morph_target(folder: Path) -> Scene:
    path = folder / "mesh.gltf"
    path.write_text(json.dumps(embedded(Path(__file__).parents[1] / "files" / "gltf" / "files" / "posed.glb")))
    return Scene([Body(Mesh(str(path), 0.2), (0.0, 0.0, -0.2))])


# -- distances ---------------------------------------------------------------------------------------------------------


@scene("kilometres")
def kilometres(folder: Path) -> Scene:
    balls = [
        Body(Sphere(150.0), (400.0 * i - 600, 1500.0 + 300 * i, 40.0 * i), diffuse=(0.2, 0.3 * i, 0.8, 1))
        for i in range(4)
    ]
    ground = Body(Box(8000.0, 8000.0, 10.0), (0, 4000.0, -160), diffuse=(0.5, 0.5, 0.4, 1.0))
    return Scene([ground, *balls], far=10000.0, size=(320, 240))
