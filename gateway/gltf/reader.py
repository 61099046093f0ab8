"""Bytes of a glTF document to a scene."""

from __future__ import annotations

from dataclasses import replace
from typing import Final

from gateway.gltf.accessors import Accessors
from gateway.gltf.buffers import Buffers, Resolver
from gateway.gltf.container import open_container
from gateway.gltf.content_cache import MeshCache
from gateway.gltf.document import Document, Primitive, parse
from gateway.gltf.document_cache import HashedDocument, KnownDocument, Warned
from gateway.gltf.errors import GltfError, element
from gateway.gltf.lights import lights_of
from gateway.gltf.limits import GltfLimits
from gateway.gltf.materials import Materials
from gateway.gltf.meshes import Meshes
from gateway.gltf.nodes import NodeTree, build_tree
from gateway.gltf.scene import GltfCounts, GltfScene
from gateway.scene.geometry import Part, Surface
from renderers.stop import check_stop

READ: Final = frozenset(
    {
        "KHR_lights_punctual",
        "KHR_materials_emissive_strength",
        "KHR_materials_ior",
        "KHR_materials_pbrSpecularGlossiness",
        "KHR_materials_specular",
        "KHR_materials_unlit",
        "KHR_mesh_quantization",
        "KHR_texture_transform",
    }
)
"""Extensions that are honoured."""
FALLBACK: Final = frozenset({"KHR_texture_basisu", "EXT_texture_webp", "EXT_texture_avif", "MSFT_texture_dds"})
"""Extensions that offer other images: the PNG or JPEG beside them is used, or the WebP where there is none."""
HARMLESS: Final = frozenset(
    {
        "KHR_materials_clearcoat",
        "KHR_materials_sheen",
        "KHR_materials_transmission",
        "KHR_materials_volume",
        "KHR_materials_iridescence",
        "KHR_materials_anisotropy",
        "KHR_materials_variants",
        "KHR_xmp_json_ld",
        "KHR_accessor_float64",
    }
)
"""Extensions that change the look only, or nothing: also when required, the scene is drawn without them."""
_LIMITS: Final = GltfLimits()
_MAX_WARNINGS: Final = 100
"""A document with one fault has it in every mesh."""


def read_gltf(
    data: bytes | memoryview | HashedDocument,
    *,
    resolve: Resolver | None = None,
    limits: GltfLimits | None = None,
    cache: MeshCache | None = None,
    textures: bool = True,
) -> GltfScene:
    """Reads a ``.gltf`` or ``.glb``, told apart by the bytes.

    Args:
        data: the file. Only a ``bytes`` object may be kept (never a memoryview, which may be reused).
        resolve: gives the bytes of relative URIs; None: only data URIs are allowed.
        limits: None: ``GltfLimits()``.
        cache: gives equal buffers and meshes across documents the same objects; None: within this one only.
        textures: False leaves textures out, for pictures that need none.

    Raises:
        GltfError: with a sentence that names the element, its value and the reason.
        Exception: the current ``renderers.stop.StopFlag`` was set; nothing half read is kept.
    """
    limits = _LIMITS if limits is None else limits
    shared = cache is not None
    cache = MeshCache(limits.max_buffer_bytes + limits.max_mesh_bytes, 0) if cache is None else cache
    hashed: HashedDocument | None = None
    if isinstance(data, HashedDocument):
        hashed, data = data, memoryview(data.data)
    elif shared and resolve is None:
        hashed = HashedDocument.of(bytes(data))
    if hashed is not None and (found := cache.documents.find(hashed, limits, textures)) is not None:
        known, rest = found
        try:
            parts, warned = _Parts(limits, dict(known.parts), None, known.elements), known.warned
            of_nodes: list[str] = []
            nodes = build_tree(rest, parts, limits, known.lights, of_nodes)
            if not warned.meshes or parts.order == warned.order:
                deformed = _deformations(rest, warned.morphed)
                of_all = (*warned.extensions, *deformed, *warned.lights, *warned.meshes, *of_nodes)
                count, counts = len(known.cameras), known.counts
                return _scene(rest, parts, known.generator, count, counts, nodes, _shortened(of_all))
        except _UnknownMeshError:
            pass  # a mesh that no node used before
    check_stop()
    container = open_container(data)
    document = parse(container.json, limits)
    check_stop()
    of_extensions = _check_extensions(document)
    morphed = sum([1 for mesh in document.meshes or () if mesh is not None and mesh.weights and any(mesh.weights)])
    warnings: list[str] = []
    generator = (document.asset.generator if document.asset is not None else None) or ""
    buffers = Buffers(document, container, cache, limits, resolve)
    accessors = Accessors(document, buffers, limits, warnings, merged=generator == "Drake glTF merger")
    meshes = Meshes(accessors, cache, limits, warnings)
    materials = Materials(document, buffers, limits, warnings, textures=textures)
    elements: dict[int, int] = {}
    parts = _Parts(limits, {}, _Maker(document, meshes, materials, limits), elements)
    of_lights: list[str] = []
    of_nodes = []
    lights = lights_of(document, of_lights)
    nodes = build_tree(document, parts, limits, lights, of_nodes)
    if meshes.without_positions and not meshes.with_positions:
        raise GltfError(f"{meshes.without_positions}: no POSITION, and no other primitive has one")
    counts, cameras = _counts(document), document.cameras or []
    check_stop()
    if hashed is not None and len(warnings) + len(of_lights) <= _MAX_WARNINGS:
        warned = Warned(of_extensions, (*of_lights,), (*warnings,), parts.order, morphed)
        known = KnownDocument(parts.known, generator, cameras, warned, counts, lights, elements)
        cache.documents.add(hashed, container, limits, textures, known)
    of_all = (*of_extensions, *_deformations(document, morphed), *of_lights, *warnings, *of_nodes)
    return _scene(document, parts, generator, len(cameras), counts, nodes, _shortened(of_all))


def _shortened(warnings: tuple[str, ...]) -> tuple[str, ...]:
    rest = len(warnings) - _MAX_WARNINGS
    return warnings if rest <= 0 else (*warnings[:_MAX_WARNINGS], f"{rest} more")


def _scene(
    document: Document,
    parts: _Parts,
    generator: str,
    cameras: int,
    counts: GltfCounts,
    nodes: NodeTree,
    warnings: tuple[str, ...],
) -> GltfScene:
    """``cameras``: of the document."""
    node_count = len(document.nodes or ())
    return GltfScene(
        nodes,
        generator,
        nodes.cameras,
        cameras,
        parts.instances,
        parts.drawn,
        warnings,
        counts if counts.nodes == node_count else replace(counts, nodes=node_count),
        nodes.lights,
    )


class _UnknownMeshError(Exception):
    """A known text, but one of its meshes was not in use before."""


class _Parts:
    """The parts of each mesh, shared by all nodes that use it; counts what is drawn."""

    def __init__(
        self,
        limits: GltfLimits,
        known: dict[int, tuple[Part, ...]],
        make: _Maker | None,
        elements: dict[int, int],
    ) -> None:
        """``elements``: of each known mesh; the others are added."""
        self.known = known
        self._limits = limits
        self._make = make
        self._elements = elements
        self.instances = self.drawn = 0
        self.order: tuple[int, ...] = ()
        """The meshes in the order of their first use."""

    def __call__(self, nodes: list[int], meshes: list[int | None]) -> list[tuple[Part, ...] | None]:
        known, elements, limits = self.known, self._elements, self._limits
        self.order = (*[index for index in dict.fromkeys(meshes) if index is not None],)
        new = [index for index in self.order if index not in known]
        if new:
            if self._make is None:
                raise _UnknownMeshError
            self._make(new, nodes, meshes, known, elements)
        result: list[tuple[Part, ...] | None] = []
        instances = drawn = 0
        for node, index in zip(nodes, meshes, strict=True):
            if index is None:
                result.append(None)
                continue
            parts = known[index]
            result.append(parts)
            instances += len(parts)
            drawn += elements[index]
            if instances > limits.max_instances:
                what, limit = "has more instances than max_instances", limits.max_instances
                raise GltfError(f"nodes[{node}].mesh: the scene {what} = {limit}")
            if drawn > limits.max_drawn_elements:
                what, limit = "draws more elements than max_drawn_elements", limits.max_drawn_elements
                raise GltfError(f"nodes[{node}].mesh: the scene {what} = {limit}")
        self.instances, self.drawn = instances, drawn
        return result


class _Maker:
    """Makes the parts of meshes."""

    def __init__(self, document: Document, meshes: Meshes, materials: Materials, limits: GltfLimits) -> None:
        self._sources = document.meshes or []
        self._meshes = meshes
        self._materials = materials
        self._limits = limits

    def __call__(
        self,
        indices: list[int],
        nodes: list[int],
        meshes_of_nodes: list[int | None],
        to_parts: dict[int, tuple[Part, ...]],
        to_elements: dict[int, int],
    ) -> None:
        """Adds the parts of these meshes, and their triangles, lines and points.

        Args:
            nodes: their indices in the document; for messages, as are their meshes.
        """
        sources, most = self._sources, self._limits.max_primitives
        count = len(sources)
        wanted: list[list[Primitive | None]] = []
        total = 0
        for index in indices:
            source = sources[index] if 0 <= index < count else None
            if source is None:
                node = nodes[meshes_of_nodes.index(index)]
                source = element(sources, index, "meshes", f"nodes[{node}].mesh")
            primitives = source.primitives or []
            wanted.append(primitives)
            total += len(primitives)
            if total > most:
                raise GltfError(f"meshes[{index}]: more primitives than max_primitives = {most}")
        self._meshes.prepare([primitive for primitives in wanted for primitive in primitives])
        prepared, mesh_of, material_of = self._meshes.prepared, self._meshes.mesh, self._materials.of
        for index, primitives in zip(indices, wanted, strict=True):
            parts: list[Part] = []
            elements = 0
            check_stop()
            for number, primitive in enumerate(primitives):
                if primitive is None:
                    continue
                mesh = prepared.get(id(primitive)) or mesh_of(primitive, index, number)
                if mesh is not None:
                    elements += len(mesh.elements)
                    parts.append(Part(Surface(mesh), material_of(primitive, index, number)))
            to_parts[index], to_elements[index] = tuple(parts), elements


def _check_extensions(document: Document) -> tuple[str, ...]:
    """What is said about those that are not read."""
    if not document.extensions_required and not document.extensions_used:
        return ()
    required = {name for name in document.extensions_required or () if name}
    unknown = sorted(required - READ - FALLBACK - HARMLESS)
    if unknown:
        raise GltfError(f"extensionsRequired: {', '.join(unknown)[:500]} cannot be read")
    used = {name for name in document.extensions_used or () if name}
    ignored = sorted(used - READ - FALLBACK)
    return (f"extensionsUsed: {', '.join(ignored)[:500]} ignored",) if ignored else ()


def _deformations(document: Document, morphed: int) -> list[str]:
    """Skins and morph targets are not read: a mesh is drawn as it is stored, and whoever looks at it is told.

    Args:
        morphed: meshes with weights of their own.
    """
    nodes = [
        node
        for node in document.nodes or ()
        if node is not None and (node.skin is not None or node.weights) and node.mesh is not None
    ]
    said: list[str] = []
    if not nodes and not morphed:
        return said
    if skinned := sum([node.skin is not None for node in nodes]):
        said.append(f"nodes: skins are ignored, {skinned} meshes are drawn as they are stored")
    if morphed := morphed + sum([any(node.weights) for node in nodes if node.weights]):
        said.append(f"weights: morph targets are ignored, {morphed} meshes are drawn as they are stored")
    return said


def _counts(document: Document) -> GltfCounts:
    return GltfCounts(
        nodes=len(document.nodes or ()),
        meshes=len(document.meshes or ()),
        materials=len(document.materials or ()),
        textures=len(document.textures or ()),
        images=len(document.images or ()),
        cameras=len(document.cameras or ()),
    )
