"""Entry point of the reader: ``read_gltf`` turns the bytes of a glTF document into a scene, in four steps.

1. Split the file and parse its JSON: ``container``, ``parser`` (``schema`` declares the properties).
2. Order the nodes of the scene and compute their matrices: ``nodes``.
3. Read the meshes in use (``PartReader``): ``buffers`` (``meshopt``), ``accessors``, ``meshes`` (``draco``,
   ``mesh_nodes``, ``deformation``); their ``material_reader`` and ``textures``.
4. Find cameras and lights of nodes: ``gltf_scene``, ``lights``.

A document that differs from an earlier one only in its nodes needs no step 3 (``document_cache``).
"""

from collections.abc import Mapping
from typing import Final, TypeAlias

from gateway.files.gltf.accessors import Accessors
from gateway.files.gltf.animations import AnimationTime, pose_nodes
from gateway.files.gltf.buffers import Buffers, Resolver
from gateway.files.gltf.container import open_container
from gateway.files.gltf.deformation import REST, MeshPose
from gateway.files.gltf.document_cache import DocumentContent, GltfCache, HashedDocument, parse_nodes
from gateway.files.gltf.draco import DracoMeshes
from gateway.files.gltf.gltf_errors import GltfError, GltfLimitError, GltfLimits, as_warning, checked_item
from gateway.files.gltf.gltf_scene import GltfScene, mesh_names, read_cameras
from gateway.files.gltf.lights import node_lights, read_lights
from gateway.files.gltf.material_reader import Materials, missing_coordinates, multiplied, resembles_drake
from gateway.files.gltf.mesh_nodes import expand_mesh_nodes
from gateway.files.gltf.meshes import Meshes
from gateway.files.gltf.nodes import INSTANCING, NodeParts, SceneNodes, read_nodes
from gateway.files.gltf.parser import check_extensions, check_version, parse_document
from gateway.files.gltf.schema import DRAKE_MERGER, VTK_EXPORTER, Document, GltfMesh, GltfPrimitive
from gateway.files.gltf.textures import Textures
from gateway.scene.tree.geometry import Part, Surface
from renderers.cache import CacheBudget
from renderers.drawlist import Material
from scenegate.warning_text import joined_warnings

_DEFAULT_LIMITS: Final = GltfLimits()
_MAX_LISTED_WARNINGS: Final = 100
"""Maximum number of warnings in a result; the others are counted. One flaw is often in every mesh of a document."""


def read_gltf(
    data: bytes | bytearray | memoryview | HashedDocument,
    *,
    resolve: Resolver | None = None,
    limits: GltfLimits | None = None,
    cache: GltfCache | None = None,
    variant: str | None = None,
    decode_images: bool = False,
    animation: AnimationTime | None = None,
    posted: bool = False,
) -> GltfScene:
    """Read a ``.gltf`` or ``.glb`` file.

    Args:
        data: The file. The result does not refer to these bytes.
        resolve: Returns the bytes of relative URIs; None: only data URIs are allowed.
        limits: None: ``GltfLimits()``.
        cache: Cache shared with other documents; None: equal meshes and images are shared within this document only.
        variant: Name of a variant of KHR_materials_variants; None: the default materials. Not with ``cache``.
        decode_images: True: leave out textures whose images cannot be decoded. False: rendering a colour image raises
            an ``ImageError``. Not with ``cache``.
        animation: Animation whose pose the nodes have; None: the pose in which they are stored. Not with ``cache``.
        posted: True: a posted scene, so that VTK's exporter wrote it for Drake's client if it wrote it. It leaves out
            normals, double-sidedness and blending, which are restored.

    Raises:
        GltfError: The document cannot be read. The message names the property, its value and the reason.
        Exception: The error with which the current ``renderers.stop.StopFlag`` was set. Nothing partial is cached.
    """
    limits = limits or _DEFAULT_LIMITS
    if not isinstance(data, HashedDocument) and cache is not None and resolve is None:
        data = cache.look_up(bytes(data), limits)
    hashed = data if isinstance(data, HashedDocument) else None
    if cache is None:
        cache = GltfCache(CacheBudget(limits.max_buffer_bytes + limits.max_mesh_bytes))
    if hashed is not None and (scene := _known_scene(hashed, limits)) is not None:
        return scene
    container = open_container(data.data if isinstance(data, HashedDocument) else data)
    warnings: list[str] = []
    document = parse_document(container.json, limits, warnings)
    has_wrong_types = bool(warnings)
    buffers = Buffers(document, container, limits, resolve, warnings)
    if resolve is None:
        buffers.check_posted()
    accessors = Accessors(document, buffers, limits, warnings)
    if animation is not None:
        pose_nodes(document, accessors, animation, warnings)
    nodes = read_nodes(document, limits)
    names = mesh_names(nodes, document.meshes)
    has_posed_nodes = bool(nodes.posed) and document.generator != DRAKE_MERGER  # which breaks skins and weights
    poses: Mapping[int, MeshPose] = {}
    check_version(document, warnings)
    check_extensions(document, warnings)
    if has_posed_nodes:
        nodes, poses = expand_mesh_nodes(document, nodes, accessors, limits, warnings)
    meshes = Meshes(accessors, DracoMeshes(document, buffers, limits), cache.content, limits, warnings)
    images = Textures(document, buffers, cache.content, limits, warnings, decode_images)
    from_drake = document.merged_by_drake or (posted and document.generator == VTK_EXPORTER)
    materials = Materials(document, images, warnings, variant, from_drake=from_drake)
    lights = read_lights(document, warnings)
    parts, posed_parts = PartReader(document, meshes, materials, limits, warnings).read(nodes, poses)
    content = DocumentContent(
        generator=document.generator,
        from_drake=from_drake,
        resembles_drake=document.generator == VTK_EXPORTER and _resembles_drake(document),
        cameras=document.cameras or [],
        lights=lights,
        parts=parts,
        posed_parts=posed_parts,
        mesh_names=names,
        element_counts={mesh: count_elements(mesh_parts) for mesh, mesh_parts in parts.items()},
        morphed_mesh_count=sum(
            isinstance(mesh, GltfMesh) and any(mesh.weights or ()) for mesh in document.meshes or ()
        ),
        warnings=tuple(warnings),
        mesh_bytes=meshes.nbytes,
    )
    scene = _combine(content, nodes, limits)
    # Poses of nodes, and warnings that may be about nodes, do not hold for a document with other nodes.
    depends_on_nodes = has_posed_nodes or has_wrong_types or nodes.warnings
    if hashed is not None and not depends_on_nodes and len(content.warnings) <= _MAX_LISTED_WARNINGS:
        cache.add(hashed, container, content)
    return scene


def _resembles_drake(document: Document) -> bool:
    """Return True if VTK's exporter could have written each primitive of a document for Drake's client."""
    meshes = [mesh for mesh in document.meshes or () if isinstance(mesh, GltfMesh)]
    primitives = [each for mesh in meshes for each in mesh.primitives or () if isinstance(each, GltfPrimitive)]
    return bool(primitives) and all(resembles_drake(each, document.materials or ()) for each in primitives)


def read_mesh_names(data: bytes) -> frozenset[str]:
    """Return the names of the meshes in use, as in ``GltfScene.models``, without reading them. Raises GltfError."""
    document = parse_document(open_container(data).json, _DEFAULT_LIMITS, [])
    return frozenset(mesh_names(read_nodes(document, _DEFAULT_LIMITS), document.meshes).values())


def _known_scene(document: HashedDocument, limits: GltfLimits) -> GltfScene | None:
    """Return the scene of a document that differs from one in the cache only in its nodes; None if there is none."""
    known = parse_nodes(document, limits)
    if known is None:
        return None
    content, node_document = known
    nodes = read_nodes(node_document, limits)
    meshes = dict.fromkeys(nodes.meshes)
    meshes.pop(None, None)
    if (nodes.posed and content.generator != DRAKE_MERGER) or list(meshes) != list(content.parts):
        return None
    return _combine(content, nodes, limits)


def _combine(content: DocumentContent, nodes: SceneNodes, limits: GltfLimits) -> GltfScene:
    """Return the scene of a document, given its content and its nodes."""
    warnings = [*content.warnings, *nodes.warnings]
    if content.generator == DRAKE_MERGER:
        warnings += _deformation_warnings(content, nodes)
    cameras = read_cameras(content.cameras, nodes, warnings)
    lights = node_lights(content.lights, nodes, limits.max_lights, warnings) if content.lights else {}
    parts, instance_count, element_count = _node_parts(content, nodes, limits)
    warnings = list(dict.fromkeys(warnings))  # an object may be used several times
    if len(warnings) > _MAX_LISTED_WARNINGS:
        warnings[_MAX_LISTED_WARNINGS:] = [f"{len(warnings) - _MAX_LISTED_WARNINGS} more"]
    return GltfScene(content, nodes, parts, cameras, lights, instance_count, element_count, tuple(warnings))


def _node_parts(content: DocumentContent, nodes: SceneNodes, limits: GltfLimits) -> tuple[NodeParts, int, int]:
    """Return the parts of each node, and the total numbers of parts and of their elements. Raises GltfLimitError."""
    node_parts: NodeParts = []
    instance_count = element_count = 0
    for scene_index, (node, mesh) in enumerate(zip(nodes.indices, nodes.meshes, strict=True)):
        if mesh is None:
            node_parts.append(None)
            continue
        posed_parts = content.posed_parts.get(scene_index)
        parts = content.parts[mesh] if posed_parts is None else posed_parts
        node_parts.append(parts)
        instance_count += len(parts)
        element_count += content.element_counts[mesh] if posed_parts is None else count_elements(posed_parts)
        if instance_count > limits.max_instances:
            limit = limits.max_instances
            raise GltfLimitError(f"nodes[{node}].mesh: the scene has more instances than max_instances = {limit}")
        if element_count > limits.max_drawn_elements:
            limit = limits.max_drawn_elements
            raise GltfLimitError(f"nodes[{node}].mesh: the scene draws more elements than max_drawn_elements = {limit}")
    return node_parts, instance_count, element_count


def _deformation_warnings(content: DocumentContent, nodes: SceneNodes) -> list[str]:
    """Return warnings about skins, morph targets and instances in documents that Drake merged: all are ignored."""
    warnings: list[str] = []
    mesh_nodes = [node for node in nodes.sources if node.mesh is not None]
    if skin_count := sum(1 for node in mesh_nodes if node.skin is not None):
        warnings.append(f"nodes: skins are ignored, {skin_count} meshes are drawn as they are stored")
    if morph_count := content.morphed_mesh_count + sum(1 for node in mesh_nodes if node.weights and any(node.weights)):
        warnings.append(f"weights: morph targets are ignored, {morph_count} meshes are drawn as they are stored")
    if instanced_count := sum(1 for node in mesh_nodes if INSTANCING in (node.extensions or {})):
        warnings.append(f"nodes: {INSTANCING} is ignored, {instanced_count} meshes are drawn once")
    return warnings


Parts: TypeAlias = tuple[Part, ...]


class PartReader:
    """Reads the primitives of the meshes in use as parts. What is invalid is left out with a warning."""

    def __init__(
        self, document: Document, meshes: Meshes, materials: Materials, limits: GltfLimits, warnings: list[str]
    ) -> None:
        self._document = document
        self._meshes = meshes
        self._materials = materials
        self._limits = limits
        self._warnings = warnings
        self._primitive_count = 0
        self._any_valid = False
        """True once a primitive has been read, even if it has nothing to draw."""
        self._colored: dict[tuple[int, tuple[float, ...]], Material] = {}
        """Materials of instances, by that of the mesh and the instance's colour."""
        self._left_out: list[str] = []
        """Sentences about primitives that are left out."""

    def read(self, nodes: SceneNodes, poses: Mapping[int, MeshPose]) -> tuple[dict[int, Parts], dict[int, Parts]]:
        """Return the parts of each mesh in use, by mesh index, and those of nodes with a pose of their own, by
        position.

        Sentences about nodes whose mesh is missing are appended to ``nodes.warnings``: they do not hold for a document
        with other nodes. Raises GltfError if a limit is exceeded, or nothing can be drawn.
        """
        parts_of_mesh: dict[int, Parts] = {}
        posed_parts: dict[int, Parts] = {}
        read: dict[tuple[int, MeshPose | None], Parts] = {}  # the instances of a node share a pose
        missing: list[str] = []
        for position, (node_index, mesh_index) in enumerate(zip(nodes.indices, nodes.meshes, strict=True)):
            if mesh_index is None:
                continue
            pose = poses.get(position)
            if (mesh_index, pose) not in read:
                read[mesh_index, pose] = self._read_mesh(mesh_index, f"nodes[{node_index}].mesh", pose, missing)
            if pose is None:
                parts_of_mesh[mesh_index] = read[mesh_index, pose]
            else:
                posed_parts[position] = read[mesh_index, pose]
        if not self._any_valid and (missing or self._left_out):
            raise GltfError(f"nothing can be drawn: {joined_warnings(missing + self._left_out)}")
        self._warnings += self._left_out
        nodes.warnings.extend(missing)
        return parts_of_mesh, posed_parts

    def _read_mesh(self, index: int, path: str, pose: MeshPose | None, missing: list[str]) -> Parts:
        """Return the parts of ``meshes[index]`` in a pose; None: the stored one.

        A sentence is appended to ``missing`` if there is no such mesh, or nothing in it.
        """
        with as_warning(missing, "the node has no mesh"):
            mesh = checked_item(self._document.meshes, index, "meshes", path)
            if not mesh.primitives:
                raise GltfError(f"meshes[{index}].primitives: there are none")
            self._primitive_count += len(mesh.primitives)
            if self._primitive_count > self._limits.max_primitives:
                limit = self._limits.max_primitives
                raise GltfLimitError(f"meshes[{index}]: more primitives than max_primitives = {limit}")
            if pose is None:
                pose = REST if self._document.merged_by_drake else MeshPose(tuple(mesh.weights or ()))
            parts = [self._read_primitive(mesh, index, number, pose) for number in range(len(mesh.primitives))]
            return tuple([part for part in parts if part is not None])
        return ()

    def _read_primitive(self, mesh: GltfMesh, mesh_index: int, number: int, pose: MeshPose) -> Part | None:
        """Return the part of a primitive; None if it is left out or has nothing to draw."""
        path = f"meshes[{mesh_index}].primitives[{number}]"
        with as_warning(self._left_out, f"{path} is left out"):
            primitive = checked_item(mesh.primitives, number, "primitives", path)
            smooth = self._materials.is_from_vtk(primitive)
            surface = self._meshes.read(primitive, path, pose, smooth=smooth)
            self._any_valid = True
            if surface is None:
                return None
            material = self._materials.get(primitive, path)
            if missing := missing_coordinates(material, surface):
                self._warnings.append(f"{path}: textures have the colour of their corner, as it has no {missing[0]}")
            if pose.color is not None:
                material = self._colored.setdefault((id(material), pose.color), multiplied(material, pose.color))
            return Part(Surface(surface), material)
        return None


def count_elements(parts: Parts) -> int:
    """Return the number of elements (triangles, lines and points; a primitive of glTF is a mesh of them)."""
    return sum(len(part.shape.mesh.elements) for part in parts if isinstance(part.shape, Surface))
