"""Draw lists, the input of renderers: immutable meshes, images, materials, instances of them, and lights.

Threads may share all values. ``Mesh`` and ``Image`` are compared by identity. Scene readers use one object for equal
content, so that a renderer prepares it once, and drops what it prepared together with the object.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from enum import Enum, IntEnum
from typing import Final, overload

import numpy as np
from numpy.typing import NDArray

LABEL_NONE: Final = 0xFFFFFF
"""Label of the background and of instances without a label: white in a label image."""


class Topology(IntEnum):
    """Kind of a mesh's primitives; the value is the number of vertices of one."""

    POINTS = 1
    LINES = 2
    TRIANGLES = 3


@dataclass(frozen=True, slots=True, eq=False, weakref_slot=True)
class Mesh:
    """Vertices and primitives (triangles, lines or points), in the mesh's own frame."""

    positions: NDArray[np.float32]
    """(N, 3) float32, metres, C-contiguous."""
    elements: NDArray[np.uint32]
    """(M, 1 | 2 | 3) uint32 vertex indices, C-contiguous, below N. Front faces are counter-clockwise."""
    normals: NDArray[np.float32] | None = None
    """(N, 3) float32, unit length; None: unlit (lines, points) or flat (triangles)."""
    uv0: NDArray[np.float32] | None = None
    """(N, 2) float32 texture coordinates; (0, 0) is the image's top-left corner, as in glTF."""
    uv1: NDArray[np.float32] | None = None
    """(N, 2) float32, the second set of texture coordinates."""
    colors: NDArray[np.float32] | None = None
    """(N, 4) float32 linear RGBA; multiplies the material's base colour."""
    tangents: NDArray[np.float32] | None = None
    """(N, 4) float32, xyz unit length, w = handedness of the bitangent (glTF TANGENT)."""

    @property
    def topology(self) -> Topology:
        """Kind of the primitives."""
        return Topology(self.elements.shape[1])

    @property
    def nbytes(self) -> int:
        """Bytes held by the arrays."""
        optional = (self.normals, self.uv0, self.uv1, self.colors, self.tangents)
        return self.positions.nbytes + self.elements.nbytes + sum(a.nbytes for a in optional if a is not None)


def used_vertices(elements: NDArray[np.uint32], count: int) -> tuple[NDArray[np.intp], NDArray[np.uint32]]:
    """Return the vertices that primitives use, (U,) in ascending order, and the primitives with indices into those.

    Args:
        elements: (M, 1 | 2 | 3), every value < ``count``, the number of vertices.
    """
    if 8 * elements.size < count:
        unique, compact = np.unique(elements, return_inverse=True)
        return unique.astype(np.intp), np.ascontiguousarray(compact.reshape(elements.shape), dtype=np.uint32)
    # Ten times as fast as sorting. That takes three seconds for 18 million indices, and cannot be stopped.
    is_used = np.zeros(count, np.bool_)
    is_used[elements] = True
    used = np.flatnonzero(is_used)
    new_index = np.empty(count, np.uint32)
    new_index[used] = np.arange(len(used), dtype=np.uint32)
    return used, new_index[elements]


@dataclass(frozen=True, slots=True, eq=False, weakref_slot=True)
class Image:
    """An encoded image of textures, decoded when a renderer needs its pixels.

    Documents that contain the same bytes share one object. Its name in each document is ``Texture.name``.
    """

    key: bytes
    """Checksum of the content, for messages. Images are compared by identity."""
    decode: Callable[[], NDArray[np.uint8]]
    """Function that returns (H, W, 3 | 4) uint8, RGB or RGBA with straight alpha, top row first. It raises an
    ``ImageError`` without the image's name. Any thread may call it, also more than once."""
    sixteen_bits: bool = False
    """True if the encoded image has 16 bits per channel, which VTK takes for linear values."""


class ImageError(ValueError):
    """An image cannot be decoded. The message says why and, if a texture uses the image, its name."""


@contextmanager
def name_image_errors(name: str) -> Iterator[None]:
    """Prefix the messages of ``ImageError`` that the ``with`` block raises with the image's name."""
    try:
        yield
    except ImageError as error:
        raise ImageError(f"{name or 'image'}: {error}") from error


class Wrap(Enum):
    """Meaning of texture coordinates outside [0, 1] (glTF sampler.wrapS/wrapT)."""

    REPEAT = 10497
    CLAMP_TO_EDGE = 33071
    MIRRORED_REPEAT = 33648


@dataclass(frozen=True, slots=True)
class Sampler:
    """Filters and wrap modes of a texture (glTF sampler)."""

    wrap_s: Wrap = Wrap.REPEAT
    wrap_t: Wrap = Wrap.REPEAT
    mag_linear: bool = True
    """False: nearest texel when magnified."""
    min_linear: bool = True
    """False: nearest texel when minified."""
    mipmaps: bool = True
    """True if the minification filter uses mip levels."""
    mip_linear: bool = True
    """False: nearest mip level."""

    @property
    def depends_on_scale(self) -> bool:
        """True if minified textures are sampled differently from magnified ones."""
        return self.mipmaps or self.min_linear != self.mag_linear


@dataclass(frozen=True, slots=True)
class Texture:
    """An image with its sampler and texture coordinates."""

    image: Image
    sampler: Sampler = Sampler()
    uv_set: int = 0
    """Set of texture coordinates: 0 (``Mesh.uv0``) or 1 (``Mesh.uv1``)."""
    uv_transform: tuple[float, float, float, float, float, float] | None = None
    """(a, b, c, d, e, f): u' = a u + b v + c, v' = d u + e v + f; None is the identity."""
    name: str = ""
    """Name of the image in its document, for messages."""


class AlphaMode(Enum):
    """Use of a material's alpha (glTF material.alphaMode)."""

    OPAQUE = "OPAQUE"
    MASK = "MASK"
    BLEND = "BLEND"


@dataclass(frozen=True, slots=True)
class Material:
    """Metallic-roughness material as in glTF 2.0 (section 3.9). Factors are linear."""

    base_color: tuple[float, float, float, float] = (1.0, 1.0, 1.0, 1.0)
    base_color_texture: Texture | None = None
    """sRGB colour and straight alpha; multiplies ``base_color``."""
    metallic: float = 1.0
    roughness: float = 1.0
    metallic_roughness_texture: Texture | None = None
    """G = roughness, B = metallic, linear."""
    normal_texture: Texture | None = None
    normal_scale: float = 1.0
    occlusion_texture: Texture | None = None
    """R = occlusion, linear."""
    occlusion_strength: float = 1.0
    emissive: tuple[float, float, float] = (0.0, 0.0, 0.0)
    emissive_texture: Texture | None = None
    """sRGB; multiplies ``emissive``."""
    emissive_strength: float = 1.0
    """Multiplies ``emissive`` (KHR_materials_emissive_strength) in looks with tone mapping."""
    alpha_mode: AlphaMode = AlphaMode.OPAQUE
    alpha_cutoff: float = 0.5
    """Alpha below which a surface of the mode MASK is cut out."""
    double_sided: bool = False
    """False: back faces are culled in colour. Depth, label, instance and normal outputs never cull."""
    unlit: bool = False
    """The colour is the base colour, without lighting."""
    lambert: bool = False
    """The look ``pbr`` shades it as ``phong`` does: RenderEngineVtk does not convert every material."""
    ior: float = 1.5
    """Index of refraction of a dielectric (KHR_materials_ior); 0: it reflects all light at every angle."""
    specular: float = 1.0
    """Strength of a dielectric's reflection (KHR_materials_specular)."""
    specular_texture: Texture | None = None
    """A = strength, linear; multiplies ``specular``."""
    specular_color: tuple[float, float, float] = (1.0, 1.0, 1.0)
    """Colour of a dielectric's reflection at normal incidence, linear; may exceed 1."""
    specular_color_texture: Texture | None = None
    """sRGB; multiplies ``specular_color``."""
    decodes_vertex_colors: bool = True
    """True: the look ``pbr`` raises vertex colours to the power of 2.2. False: as in versions of Drake whose VTK does
    not."""
    point_size: float = 1.0
    """Width and height of a point, pixels."""
    line_width: float = 1.0
    """Width of a line, pixels."""
    casts_shadow: bool = True
    fallback: Material | None = None
    """Material in the looks of RenderEngineVtk, if VTK reads another one: it ignores KHR_materials_transmission and
    KHR_materials_pbrSpecularGlossiness, and has its own defaults for primitives without a material."""
    vtk_export: bool = False
    """True: written by VTK's exporter, which omits VTK's shading, double-sidedness and blending. Looks restore them
    (``renderers.shading.materials.look_material``)."""


@dataclass(frozen=True, slots=True, eq=False)
class Instance:
    """A mesh with a material and a pose."""

    mesh: Mesh
    material: Material
    X_world_mesh: NDArray[np.float64]
    """(4, 4) float64; any affine transform, mirrored and non-uniform scales included."""
    label: int = LABEL_NONE
    """0 .. 0xFFFFFF; the low byte is red in a label image, the next green, the high one blue."""
    instance_id: int = -1
    """Value in the instance output, where -1 is the background."""


@dataclass(frozen=True, slots=True, eq=False, weakref_slot=True)
class InstanceSet:
    """Instances without poses. Draw lists that differ only in poses share a set, which is prepared once."""

    meshes: tuple[Mesh, ...]
    materials: tuple[Material, ...]
    labels: tuple[int, ...]
    """Labels as in ``Instance``. The ``instance_id`` is the index in the set."""


class PosedInstances(Sequence[Instance]):
    """An instance set with poses. ``Instance`` objects are created on access, since poses change every frame: creating
    hundreds of objects takes longer than drawing them."""

    __slots__ = ("X_world_mesh", "set")

    def __init__(self, instance_set: InstanceSet, X_world_mesh: NDArray[np.float64]) -> None:
        """
        Args:
            X_world_mesh: (I, 4, 4) float64, C-contiguous; must not change.

        Raises:
            ValueError: ``X_world_mesh`` has another shape.
        """
        if X_world_mesh.shape != (len(instance_set.meshes), 4, 4):
            raise ValueError(f"{len(instance_set.meshes)} instances cannot have poses of shape {X_world_mesh.shape}")
        self.set: Final = instance_set
        self.X_world_mesh: Final = X_world_mesh

    def __len__(self) -> int:
        return len(self.set.meshes)

    @overload
    def __getitem__(self, index: int) -> Instance: ...
    @overload
    def __getitem__(self, index: slice) -> tuple[Instance, ...]: ...
    def __getitem__(self, index: int | slice) -> Instance | tuple[Instance, ...]:
        selected = range(len(self))[index]
        return self._instance(selected) if isinstance(selected, int) else tuple([self._instance(k) for k in selected])

    def __iter__(self) -> Iterator[Instance]:
        return map(self._instance, range(len(self)))

    def _instance(self, index: int) -> Instance:
        meshes, materials, labels = self.set.meshes, self.set.materials, self.set.labels
        return Instance(meshes[index], materials[index], self.X_world_mesh[index], labels[index], index)


class LightKind(Enum):
    """Type of a punctual light (KHR_lights_punctual)."""

    DIRECTIONAL = "directional"
    POINT = "point"
    SPOT = "spot"


@dataclass(frozen=True, slots=True)
class Light:
    """A punctual light (KHR_lights_punctual) in the frame of its node or the world. The headlight looks ignore it."""

    kind: LightKind
    color: tuple[float, float, float] = (1.0, 1.0, 1.0)
    """Linear RGB."""
    intensity: float = 1.0
    """Lux for directional lights, candela for the others."""
    position: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """Metres; unused for a directional light."""
    direction: tuple[float, float, float] = (0.0, 0.0, -1.0)
    """Unit vector in which the light shines; unused for a point light."""
    range: float | None = None
    """Distance beyond which the light has no effect, metres; None: no such limit."""
    inner_cone: float = 0.0
    """Angle from the axis of a spot to the beginning of its falloff, radians."""
    outer_cone: float = math.pi / 4.0
    """Angle from the axis of a spot to the end of its falloff, radians."""
    casts_shadow: bool = True

    def placed(self, X_world_light: NDArray[np.float64]) -> Light | None:
        """Return the light in the world, given the affine (4, 4) pose of its frame; None if it has no direction there.

        Scale changes neither range nor intensity, as KHR_lights_punctual says.
        """
        with np.errstate(all="ignore"):
            position = X_world_light[:3, :3] @ self.position + X_world_light[:3, 3]
            direction = X_world_light[:3, :3] @ self.direction
            length = float(np.linalg.norm(direction))
        if not (0.0 < length < math.inf and np.isfinite(position).all()):
            return None
        return replace(self, position=tuple(position.tolist()), direction=tuple((direction / length).tolist()))


@dataclass(frozen=True, slots=True, eq=False, weakref_slot=True)
class DrawList:
    """Input of one call of a renderer: instances, the images of their textures, and lights."""

    instances: Sequence[Instance] = ()
    """``PosedInstances`` if only the poses differ from another draw list. Must not change."""
    images: tuple[Image, ...] = field(default=())
    """Images of the materials' textures, without duplicates, to decode them in parallel."""
    lights: tuple[Light, ...] = ()
    """Lights of the scene, in the world. The headlight looks ignore them."""

    @property
    def identity(self) -> DrawList | InstanceSet:
        """Key for tables that do not depend on poses. Draw lists that differ only in poses share it."""
        return self.instances.set if isinstance(self.instances, PosedInstances) else self
