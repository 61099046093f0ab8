"""The properties of a glTF document that the reader uses, as msgspec structs named as in the specification.

Every property may be absent or null: Drake's client writes ``"nodes": null`` for empty arrays. ``parser`` ignores a
property whose value has another type than declared here. In a list of objects, it replaces an invalid object by a
``GltfError``.
"""

from typing import ClassVar, Final, TypeAlias

import msgspec

Extensions: TypeAlias = dict[str, msgspec.Raw] | None
"""Extensions by name, each as JSON text that is not parsed yet."""


DRAKE_MERGER: Final = "Drake glTF merger"
"""``asset.generator`` of those documents from Drake's render client that have glTF meshes."""
VTK_EXPORTER: Final = "VTK"
"""``asset.generator`` of all files of VTK's exporter: the other documents from Drake's render client, but also the
Y-up files of PyVista, ParaView and others."""


class Object(msgspec.Struct, rename="camel", gc=False):
    """Base of all objects. Fields are sorted by name, as Drake's client and most exporters write them: msgspec is
    fastest if the text has the order of the fields."""

    essential: ClassVar[tuple[str, ...] | None] = ()
    """Properties that make the whole object invalid if their type is wrong. None: all properties do."""


class StrictObject(Object):
    """Base of objects that are invalid if any property has a wrong type."""

    essential = None


class Asset(Object):
    generator: str | None = None
    min_version: str | None = None
    version: str | None = None


class Scene(StrictObject):
    nodes: list[int | None] | None = None


class GltfNode(Object):
    camera: int | None = None
    children: list[int | None] | None = None
    extensions: Extensions = None
    matrix: list[float] | None = None
    mesh: int | None = None
    name: str | None = None
    rotation: list[float] | None = None
    scale: list[float] | None = None
    skin: int | None = None
    translation: list[float] | None = None
    weights: list[float] | None = None


class GltfPrimitive(Object):
    essential = ("indices",)

    attributes: dict[str, int | None] | None = None
    extensions: Extensions = None
    indices: int | None = None
    material: int | None = None
    mode: int | None = None
    targets: list[dict[str, int | None] | None] | None = None


class GltfMesh(Object):
    name: str | None = None
    primitives: list[GltfPrimitive | None] | None = None
    weights: list[float] | None = None


class SparseArray(StrictObject):
    """``sparse.indices``, or ``sparse.values``, which have no component type of their own."""

    buffer_view: int | None = None
    byte_offset: int | None = None
    component_type: int | None = None


class Sparse(StrictObject):
    count: int | None = None
    indices: SparseArray | None = None
    values: SparseArray | None = None


class GltfAccessor(StrictObject):
    buffer_view: int | None = None
    byte_offset: int | None = None
    component_type: int | None = None
    count: int | None = None
    normalized: bool | None = None
    sparse: Sparse | None = None
    type: str | None = None


class GltfBufferView(StrictObject):
    buffer: int | None = None
    byte_length: int | None = None
    byte_offset: int | None = None
    byte_stride: int | None = None
    extensions: Extensions = None


class GltfBuffer(Object):
    byte_length: int | None = None
    uri: str | None = None


class GltfImage(Object):
    essential = ("buffer_view", "uri")

    buffer_view: int | None = None
    name: str | None = None
    uri: str | None = None


class GltfSampler(Object):
    mag_filter: int | None = None
    min_filter: int | None = None
    wrap_s: int | None = None
    wrap_t: int | None = None


class Skin(StrictObject):
    inverse_bind_matrices: int | None = None
    joints: list[int] | None = None


class GltfTexture(Object):
    essential = ("source",)

    extensions: Extensions = None
    sampler: int | None = None
    source: int | None = None


class TextureInfo(Object):
    essential = ("index",)

    extensions: Extensions = None
    index: int | None = None
    scale: float | None = None
    """Normal textures only."""
    strength: float | None = None
    """Occlusion textures only."""
    tex_coord: int | None = None


class MetallicRoughness(Object):
    base_color_factor: list[float] | None = None
    base_color_texture: TextureInfo | None = None
    metallic_factor: float | None = None
    metallic_roughness_texture: TextureInfo | None = None
    roughness_factor: float | None = None


class GltfMaterial(Object):
    alpha_cutoff: float | None = None
    alpha_mode: str | None = None
    double_sided: bool | None = None
    emissive_factor: list[float] | None = None
    emissive_texture: TextureInfo | None = None
    extensions: Extensions = None
    name: str | None = None
    normal_texture: TextureInfo | None = None
    occlusion_texture: TextureInfo | None = None
    pbr_metallic_roughness: MetallicRoughness | None = None


class Projection(Object):
    """``perspective`` or ``orthographic`` of a camera."""

    xmag: float | None = None
    yfov: float | None = None
    zfar: float | None = None
    znear: float | None = None


class GltfCamera(Object):
    name: str | None = None
    orthographic: Projection | None = None
    perspective: Projection | None = None


class ChannelTarget(StrictObject):
    node: int | None = None
    path: str | None = None


class Channel(StrictObject):
    sampler: int | None = None
    target: ChannelTarget | None = None


class AnimationSampler(StrictObject):
    input: int | None = None
    interpolation: str | None = None
    output: int | None = None


class Animation(Object):
    essential = ("channels", "samplers")

    channels: list[Channel | None] | None = None
    name: str | None = None
    samplers: list[AnimationSampler | None] | None = None


class Document(Object):
    accessors: list[GltfAccessor | None] | None = None
    animations: list[Animation | None] | None = None
    asset: Asset | None = None
    buffer_views: list[GltfBufferView | None] | None = None
    buffers: list[GltfBuffer | None] | None = None
    cameras: list[GltfCamera | None] | None = None
    extensions: Extensions = None
    extensions_required: list[str | None] | None = None
    extensions_used: list[str | None] | None = None
    images: list[GltfImage | None] | None = None
    materials: list[GltfMaterial | None] | None = None
    meshes: list[GltfMesh | None] | None = None
    nodes: list[GltfNode | None] | None = None
    samplers: list[GltfSampler | None] | None = None
    scene: int | None = None
    scenes: list[Scene | None] | None = None
    skins: list[Skin | None] | None = None
    textures: list[GltfTexture | None] | None = None

    @property
    def generator(self) -> str:
        """``asset.generator``; empty where it is absent."""
        return (self.asset.generator if self.asset is not None else None) or ""

    @property
    def merged_by_drake(self) -> bool:
        """True for documents that Drake's client merged from several files.

        It drops skins and does not adapt the indices in extensions, sparse accessors and morph targets.
        """
        return self.generator == DRAKE_MERGER

    @property
    def from_old_drake(self) -> bool:
        """True for documents that an old Drake (1.51.1; not 1.58.0) merged: it names meshes ``mesh0`` and so on."""
        first_mesh = self.meshes[0] if self.meshes else None
        return self.merged_by_drake and isinstance(first_mesh, GltfMesh) and first_mesh.name == "mesh0"


class Variant(Object):
    name: str | None = None


class Variants(Object):
    """KHR_materials_variants in the document's extensions."""

    variants: list[Variant | None] | None = None


class VariantMapping(Object):
    material: int | None = None
    variants: list[int] | None = None


class VariantMappings(Object):
    """KHR_materials_variants in a primitive's extensions."""

    mappings: list[VariantMapping | None] | None = None


class NodeVisibility(Object):
    """KHR_node_visibility in a node's extensions."""

    visible: bool | None = None


class TextureTransform(Object):
    """KHR_texture_transform."""

    offset: list[float] | None = None
    rotation: float | None = None
    scale: list[float] | None = None
    tex_coord: int | None = None


class ImageSource(StrictObject):
    """EXT_texture_webp: another image for a texture."""

    source: int | None = None


class EmissiveStrength(Object):
    """KHR_materials_emissive_strength."""

    emissive_strength: float | None = None


class Ior(Object):
    """KHR_materials_ior."""

    ior: float | None = None


class Specular(Object):
    """KHR_materials_specular."""

    specular_color_factor: list[float] | None = None
    specular_color_texture: TextureInfo | None = None
    specular_factor: float | None = None
    specular_texture: TextureInfo | None = None


class Transmission(Object):
    """KHR_materials_transmission."""

    transmission_factor: float | None = None
    transmission_texture: TextureInfo | None = None


class SpecularGlossiness(Object):
    """KHR_materials_pbrSpecularGlossiness (archived)."""

    diffuse_factor: list[float] | None = None
    diffuse_texture: TextureInfo | None = None
    glossiness_factor: float | None = None
    specular_factor: list[float] | None = None
    specular_glossiness_texture: TextureInfo | None = None


class Spot(Object):
    inner_cone_angle: float | None = None
    outer_cone_angle: float | None = None


class GltfLight(Object):
    """A light of KHR_lights_punctual."""

    essential = ("type",)

    color: list[float] | None = None
    intensity: float | None = None
    name: str | None = None
    range: float | None = None
    spot: Spot | None = None
    type: str | None = None


class GltfLights(Object):
    """KHR_lights_punctual in the document's extensions."""

    lights: list[GltfLight | None] | None = None


class LightReference(StrictObject):
    """KHR_lights_punctual in a node's extensions."""

    light: int | None = None


class DracoCompression(StrictObject):
    """KHR_draco_mesh_compression in a primitive's extensions."""

    attributes: dict[str, int | None] | None = None
    """Ids of the attributes in the compressed mesh."""
    buffer_view: int | None = None


class MeshoptCompression(StrictObject):
    """KHR_meshopt_compression or EXT_meshopt_compression in a buffer view's extensions."""

    buffer: int | None = None
    byte_length: int | None = None
    byte_offset: int | None = None
    byte_stride: int | None = None
    count: int | None = None
    filter: str | None = None
    mode: str | None = None


class Instancing(StrictObject):
    """EXT_mesh_gpu_instancing in a node's extensions."""

    attributes: dict[str, int | None] | None = None
