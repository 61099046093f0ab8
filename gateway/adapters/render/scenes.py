"""Reads posted scenes as draw lists, with caches: scenes with the same bytes are read once.

In the requests of a moving robot only the poses differ. Everything else is one shared ``SceneTopology`` object, so that
the renderer, which caches by the identity of the instance set, does not build its tables again.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final, TypeAlias

import numpy as np
from numpy.typing import NDArray

from gateway.adapters.render.config import RenderConfig
from gateway.adapters.render.labels import labels_by_root
from gateway.files.gltf import (
    DEFAULT_MATERIAL,
    DRAKE_MERGER,
    DocumentContent,
    GltfCache,
    GltfScene,
    HashedDocument,
    PlacedCamera,
    label_from_material,
    read_gltf,
)
from gateway.scene.draw.flatten import DRAWABLE, images_of
from gateway.scene.tree.geometry import Surface
from renderers.cache import SHARED, Cache, CacheBudget
from renderers.drawlist import LABEL_NONE, DrawList, Image, InstanceSet, Material, PosedInstances
from renderers.stop import check_stop

_MAX_TOPOLOGIES: Final = 16
"""Maximum number of cached topologies; a few clients need one each for colour, depth and label images."""
_INSTANCE_BYTES: Final = 1024
"""Approximate size of an instance in bytes, including its rows in the renderer's tables."""

_LATER_DEFAULT: Final = replace(DEFAULT_MATERIAL, fallback=Material(lambert=True, double_sided=True))
"""``DEFAULT_MATERIAL`` of all glTF files in a document from Drake's merger but the first. RenderEngineVtk turns on
physically based shading of all materials when it reads the first file, and then leaves it to the materials."""

TopologyKey: TypeAlias = tuple[DocumentContent, tuple[int | None, ...], tuple[int, ...], bytes]
"""Content (by identity); mesh and parent of each node; one bit per node, set if its matrix is drawable."""


@dataclass(frozen=True, slots=True, eq=False)
class SceneTopology:
    """The part of a posted scene that does not change with its poses."""

    instances: InstanceSet
    nodes: NDArray[np.intp]
    """(number of instances,): position of each instance's node in ``SceneNodes``."""
    images: tuple[Image, ...]

    @property
    def nbytes(self) -> int:
        """Approximate size in bytes, without meshes and images."""
        return _INSTANCE_BYTES * len(self.nodes)


@dataclass(frozen=True, slots=True, eq=False)
class PreparedScene:
    """A posted scene ready for rendering. Shared by all requests with the same scene."""

    camera: PlacedCamera | None
    """``GltfScene.camera``."""
    has_geometry: bool
    """True if the scene has primitives, even if all of them are too far away to be drawn."""
    generator: str
    """``asset.generator``."""
    element_count: int
    """Number of triangles, lines and points of all instances."""
    warnings: tuple[str, ...]
    """Sentences about properties that the reader ignored or repaired."""
    unlabelled_count: int
    """Number of instances without a label: Drake's client sends labels in materials, and they have none."""
    draw_list: DrawList
    nbytes: int
    """Approximate size in bytes."""


class SceneStore:
    """Reads posted scenes and keeps the latest ones. Thread-safe.

    There are three caches. ``scenes`` has the digest of the whole document as key: it serves static scenes, and depth
    images of a scene after its colour image: a quarter less time to read, draw and encode (geometric mean of Drake's
    recorded scenes). ``geometry`` compares parts of documents: it serves moving robots, whose meshes stay the same.
    ``topologies`` keeps what such robots' draw lists have in common.
    """

    def __init__(self, config: RenderConfig, caches: CacheBudget = SHARED) -> None:
        self._limits = config.gltf
        self.scenes: Final[Cache[str, PreparedScene]] = Cache("scenes", config.scene_cache_count, budget=caches)
        self.geometry: Final = GltfCache(caches)
        self._topologies: Cache[TopologyKey, SceneTopology] = Cache("topologies", _MAX_TOPOLOGIES, budget=caches)

    def look_up(self, data: bytes | bytearray) -> HashedDocument:
        """Return a posted document with what is known of it. ``data`` must not change."""
        return self.geometry.look_up(data, self._limits)

    def get(self, document: HashedDocument, *, decode_images: bool = False) -> PreparedScene:
        """Return the scene of a document.

        Args:
            decode_images: True: read it anew, without textures whose images cannot be decoded.

        Raises:
            GltfError: The document cannot be read. It is not cached.
        """
        if decode_images:
            gltf = read_gltf(document.data, limits=self._limits, decode_images=True, posted=True)
        else:
            cached = self.scenes.get(document.digest)
            if cached is not None:
                return cached
            gltf = read_gltf(document, limits=self._limits, cache=self.geometry, posted=True)
        draw_list = draw_list_of(gltf, self._topologies)
        assert isinstance(draw_list.instances, PosedInstances)
        scene = PreparedScene(
            camera=gltf.camera,
            has_geometry=gltf.instance_count > 0,
            generator=gltf.content.generator,
            element_count=gltf.element_count,
            warnings=gltf.warnings,
            unlabelled_count=draw_list.instances.set.labels.count(LABEL_NONE),
            draw_list=draw_list,
            nbytes=len(document.data) + gltf.content.mesh_bytes,
        )
        self.scenes.put(document.digest, scene, scene.nbytes)
        return scene


def draw_list_of(scene: GltfScene, topologies: Cache[TopologyKey, SceneTopology]) -> DrawList:
    """Return the draw list of a posted scene, with labels from the colours of its materials.

    The result has the instances of ``flatten(scene.root, label_of=labels_of(scene.root))`` in the order of
    ``_drawing_order``, but takes a fraction of the time.
    """
    nodes = scene.nodes
    with np.errstate(all="ignore"):
        drawable = np.asarray((np.abs(nodes.X_world_node) < DRAWABLE).all(axis=(1, 2)))
    key = scene.content, tuple(nodes.meshes), tuple(nodes.parents), np.packbits(drawable).tobytes()
    topology = topologies.get(key)
    if topology is None:
        topology = _topology_of(scene, drawable)
        topologies.put(key, topology, topology.nbytes + scene.content.mesh_bytes)
    posed = PosedInstances(topology.instances, nodes.X_world_node[topology.nodes])
    return DrawList(posed, topology.images, scene.lights)


def _topology_of(scene: GltfScene, drawable: NDArray[np.bool_]) -> SceneTopology:
    meshes, materials, labels, nodes = [], [], [], []
    root_of_node: list[int] = []
    for node, parent in enumerate(scene.nodes.parents):
        root_of_node.append(node if parent < 0 else root_of_node[parent])
    label_of_root: dict[int, int] = {}
    if any(part.material is DEFAULT_MATERIAL for parts in scene.parts for part in parts or ()):
        pairs = zip(root_of_node, scene.parts, strict=True)
        label_of_root = labels_by_root((root, part) for root, parts in pairs for part in parts or ())
    later_files = frozenset(_file_roots(scene)[1:])
    for node in _drawing_order(scene):
        check_stop()
        if not drawable[node]:
            continue
        for part in scene.parts[node] or ():
            assert isinstance(part.shape, Surface)  # glTF has no other shapes
            material = part.material
            root = root_of_node[node]
            if material is not DEFAULT_MATERIAL:
                label = label_from_material(material)
            else:
                label = label_of_root.get(root, LABEL_NONE)
                material = _LATER_DEFAULT if root in later_files else DEFAULT_MATERIAL
            meshes.append(part.shape.mesh)
            materials.append(material)
            labels.append(label)
            nodes.append(node)
    instances = InstanceSet(tuple(meshes), tuple(materials), tuple(labels))
    return SceneTopology(instances, np.array(nodes, np.intp), images_of(materials))


def _file_roots(scene: GltfScene) -> list[int]:
    """Return the positions of the root nodes of the glTF files in a document from Drake's merger, in the order of their
    registration. The nodes below the first root come from VTK's exporter.

    The merger of recent versions of Drake (1.58) puts each file below one root. Files with several roots, which older
    ones (1.51) merge as they are, count as several.
    """
    if scene.generator != DRAKE_MERGER:
        return []
    return [node for node, parent in enumerate(scene.nodes.parents) if parent < 0][1:]


def _drawing_order(scene: GltfScene) -> Sequence[int]:
    """Return the positions of the nodes in an order in which RenderEngineVtk may draw them, which matters for blending.

    RenderEngineVtk draws geometries in the order of a hash table, which a copy of the context reverses: as a rule in
    the reverse order of their registration, and the nodes of a glTF file last child first. In a document from Drake's
    merger, the nodes of VTK's exporter are in the order of drawing, and the files in the order of registration. The
    document does not tell how both alternate, so this function puts the files first.
    """
    parents = scene.nodes.parents
    if scene.generator != DRAKE_MERGER:
        return range(len(parents))
    children: list[list[int]] = [[] for _ in parents]
    for node, parent in enumerate(parents):
        if parent >= 0:
            children[parent].append(node)
    file_nodes: list[int] = []
    stack = _file_roots(scene)
    while stack:
        node = stack.pop()
        file_nodes.append(node)
        stack += children[node]
    exported_nodes = set(range(len(parents))) - set(file_nodes)
    return [*file_nodes, *sorted(exported_nodes)]
