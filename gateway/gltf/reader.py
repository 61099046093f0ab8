"""Entry point of the reader: ``read_gltf`` turns the bytes of a glTF document into a scene, in four steps.

1. Split the file and parse its JSON: ``container``, ``parser`` (``schema`` declares the properties).
2. Order the nodes of the scene and compute their matrices: ``nodes``.
3. Read the meshes in use: ``buffers``, ``accessors``, ``meshes``; their ``materials`` and ``textures``.
4. Place cameras and lights at their nodes: ``cameras``, ``lights``.

A document that differs from an earlier one only in its nodes needs no step 3 (``document_cache``).
"""

from __future__ import annotations

from typing import Final

from gateway.gltf.accessors import Accessors
from gateway.gltf.buffers import Buffers, Resolver
from gateway.gltf.cameras import read_cameras
from gateway.gltf.container import Container, open_container
from gateway.gltf.document_cache import DocumentContent, HashedDocument
from gateway.gltf.errors import GltfError, checked_item
from gateway.gltf.extensions import check_extensions
from gateway.gltf.gltf_cache import GltfCache
from gateway.gltf.lights import place_lights, read_lights
from gateway.gltf.limits import GltfLimits
from gateway.gltf.materials import Materials
from gateway.gltf.meshes import Meshes
from gateway.gltf.nodes import NodeParts, SceneNodes, read_nodes
from gateway.gltf.parser import parse_document
from gateway.gltf.scene import GltfScene
from gateway.gltf.schema import DRAKE_MERGER, Document
from gateway.gltf.textures import Textures
from gateway.scene.geometry import Part, Surface
from renderers.stop import check_stop

_DEFAULT_LIMITS: Final = GltfLimits()
_MAX_WARNINGS: Final = 100
"""Maximum number of warnings in a result: a document with one fault often has it in every mesh."""


def read_gltf(
    data: bytes | bytearray | memoryview | HashedDocument,
    *,
    resolve: Resolver | None = None,
    limits: GltfLimits | None = None,
    cache: GltfCache | None = None,
    textures: bool = True,
) -> GltfScene:
    """Read a ``.gltf`` or ``.glb`` file.

    Args:
        data: The file. The result does not refer to these bytes.
        resolve: Returns the bytes of relative URIs; None: only data URIs are allowed.
        limits: None: ``GltfLimits()``.
        cache: Cache shared with other documents; None: equal meshes and images are shared within this document only.
        textures: False to leave textures out, for renderings that need none.

    Raises:
        GltfError: The document cannot be read. The message names the property, its value and the reason.
        Exception: The error with which the current ``renderers.stop.StopFlag`` was set. Nothing partial is cached.
    """
    limits = limits or _DEFAULT_LIMITS
    hashed: HashedDocument | None = None  # None: the document cache is not used
    if isinstance(data, HashedDocument):
        hashed, data = data, data.data
    elif cache is not None and resolve is None:
        hashed = HashedDocument(bytes(data))
    if cache is None:
        cache = GltfCache(limits.max_buffer_bytes + limits.max_mesh_bytes, 0)
    if hashed is not None and (cached := cache.documents.find(hashed, limits, textures)) is not None:
        content, nodes_and_scenes = cached
        nodes = read_nodes(nodes_and_scenes, limits)
        if list(nodes.first_node_by_mesh()) == list(content.parts):
            return _combine(content, nodes, limits)
    check_stop()
    container = open_container(data)
    document = parse_document(container.json, limits)
    check_stop()
    nodes = read_nodes(document, limits)
    content = _read_content(document, container, nodes, cache, limits, resolve, textures=textures)
    check_stop()
    scene = _combine(content, nodes, limits)
    if hashed is not None and len(content.warnings) <= _MAX_WARNINGS:
        cache.documents.add(hashed, container, limits, textures, content)
    return scene


def _read_content(
    document: Document,
    container: Container,
    nodes: SceneNodes,
    cache: GltfCache,
    limits: GltfLimits,
    resolve: Resolver | None,
    *,
    textures: bool,
) -> DocumentContent:
    """Read everything but the nodes: the meshes in use with their materials, the cameras and the lights."""
    warnings: list[str] = []
    check_extensions(document, warnings)
    lights = read_lights(document, warnings)
    buffers = Buffers(document, container, limits, resolve)
    merged = document.generator == DRAKE_MERGER
    meshes = Meshes(Accessors(document, buffers, limits, warnings, merged=merged), cache.content, limits, warnings)
    materials = Materials(document, Textures(document, buffers, cache.content, limits, warnings, enabled=textures))
    parts: dict[int, tuple[Part, ...]] = {}
    element_counts: dict[int, int] = {}
    primitive_count = 0
    for index, node in nodes.first_node_by_mesh().items():
        primitives = checked_item(document.meshes, index, "meshes", f"nodes[{node}].mesh").primitives or []
        primitive_count += len(primitives)
        if primitive_count > limits.max_primitives:
            raise GltfError(f"meshes[{index}]: more primitives than max_primitives = {limits.max_primitives}")
        mesh_parts: list[Part] = []
        element_counts[index] = 0
        for number, primitive in enumerate(primitives):
            name = f"meshes[{index}].primitives[{number}]"
            if primitive is not None and (mesh := meshes.read(primitive, name)) is not None:
                mesh_parts.append(Part(Surface(mesh), materials.get(primitive, name)))
                element_counts[index] += len(mesh.elements)
        parts[index] = tuple(mesh_parts)
    if meshes.first_without_positions and not meshes.any_positions:
        raise GltfError(f"{meshes.first_without_positions}: no POSITION, and no other primitive has one")
    return DocumentContent(
        generator=document.generator,
        cameras=document.cameras or [],
        lights=lights,
        parts=parts,
        element_counts=element_counts,
        morphed_mesh_count=sum(1 for mesh in document.meshes or () if mesh is not None and any(mesh.weights or ())),
        warnings=tuple(warnings),
        mesh_bytes=meshes.nbytes,
    )


def _combine(content: DocumentContent, nodes: SceneNodes, limits: GltfLimits) -> GltfScene:
    """Return the scene of a document, given its content and its nodes."""
    warnings = [*content.warnings, *_deformation_warnings(content, nodes)]
    cameras = read_cameras(content.cameras, nodes)
    lights = place_lights(content.lights, nodes, limits.max_lights, warnings)
    parts, instance_count, element_count = _node_parts(content, nodes, limits)
    if len(warnings) > _MAX_WARNINGS:
        warnings[_MAX_WARNINGS:] = [f"{len(warnings) - _MAX_WARNINGS} more"]
    return GltfScene(content, nodes, parts, cameras, lights, instance_count, element_count, tuple(warnings))


def _node_parts(content: DocumentContent, nodes: SceneNodes, limits: GltfLimits) -> tuple[NodeParts, int, int]:
    """Return the parts of each node, and two totals: the number of parts, and of their triangles, lines and points.

    Raises:
        GltfError: ``max_instances`` or ``max_drawn_elements`` is exceeded.
    """
    node_parts: NodeParts = []
    instance_count = element_count = 0
    for node, mesh in zip(nodes.indices, nodes.meshes, strict=True):
        if mesh is None:
            node_parts.append(None)
            continue
        node_parts.append(content.parts[mesh])
        instance_count += len(content.parts[mesh])
        element_count += content.element_counts[mesh]
        if instance_count > limits.max_instances:
            limit = limits.max_instances
            raise GltfError(f"nodes[{node}].mesh: the scene has more instances than max_instances = {limit}")
        if element_count > limits.max_drawn_elements:
            limit = limits.max_drawn_elements
            raise GltfError(f"nodes[{node}].mesh: the scene draws more elements than max_drawn_elements = {limit}")
    return node_parts, instance_count, element_count


def _deformation_warnings(content: DocumentContent, nodes: SceneNodes) -> list[str]:
    """Return warnings about skins and morph targets, which are not read: meshes are drawn as they are stored."""
    warnings: list[str] = []
    mesh_nodes = [node for node in nodes.sources if node.mesh is not None]
    if skin_count := sum(1 for node in mesh_nodes if node.skin is not None):
        warnings.append(f"nodes: skins are ignored, {skin_count} meshes are drawn as they are stored")
    if morph_count := content.morphed_mesh_count + sum(1 for node in mesh_nodes if node.weights and any(node.weights)):
        warnings.append(f"weights: morph targets are ignored, {morph_count} meshes are drawn as they are stored")
    return warnings
