"""Reads COLLADA files with the package pycollada. Nodes and geometry are counted before they are expanded."""

import io
import re
from collections.abc import Iterator
from typing import Any, Final

import collada
import numpy as np
from numpy.typing import NDArray

from gateway.files.parsers.collada_xml import (
    RINGS,
    checked_document,
    with_images_of_samplers,
    with_known_elements,
    without_lost_materials,
)
from gateway.files.parsers.mesh_data import MeshData, MeshFaultError, MeshOptions, Shape, shape_of
from gateway.files.parsers.polygons import triangles_of_polygons, triangles_of_rings
from gateway.files.parsers.texture_files import ReadFile, TextureFiles
from scenegate.transforms import origin_amid

MAX_ERRORS: Final = 20
"""Maximum number of errors that are listed."""
MAX_VISITED_NODES: Final = 1_000_000
"""Maximum number of nodes that hold geometry, after all ``<instance_node>`` are expanded."""
_NUMBERS: Final = re.compile(rb"""[>"'][-+\d.,eE\s]+[<"']""")
"""Text or attribute of numbers. Some have commas for decimal points, as 3ds Max writes in many languages."""
_X_UP: Final = ((0.0, -1.0, 0.0, 0.0), (0.0, 0.0, -1.0, 0.0), (1.0, 0.0, 0.0, 0.0), (0.0, 0.0, 0.0, 1.0))
_Y_UP: Final = ((1.0, 0.0, 0.0, 0.0), (0.0, 0.0, -1.0, 0.0), (0.0, 1.0, 0.0, 0.0), (0.0, 0.0, 0.0, 1.0))
_UP_AXES: Final = {"X_UP": np.array(_X_UP), "Y_UP": np.array(_Y_UP), "Z_UP": np.eye(4)}
"""Rotation to Z up. X_UP: up +X to +Z, right -Y to +X, towards the viewer +Z to -Y (COLLADA 1.4, 5-19)."""


@np.errstate(all="ignore")  # transforms that overflow give a warning of their own
def read_collada(data: bytes, read_file: ReadFile, options: MeshOptions) -> MeshData:
    """Return the content of a COLLADA file, in metres. Raises MeshFaultError if it is damaged, or beyond a limit."""
    data = data.lstrip()  # some files have a blank line before the XML declaration
    data = data.replace(b'="<', b'="&lt;')  # Assimp calls the root of STL files <STL_BINARY>
    data = checked_document(data)
    data = with_known_elements(data)
    document = collada.Collada(io.BytesIO(data), ignore=[collada.DaeError])
    if b"," in data and any(isinstance(error, collada.DaeMalformedError) for error in document.errors):
        data = _NUMBERS.sub(lambda numbers: numbers[0].replace(b",", b"."), data)
        document = collada.Collada(io.BytesIO(data), ignore=[collada.DaeError])
    if _has_lost_materials(document):
        data = with_images_of_samplers(data)
        document = collada.Collada(io.BytesIO(data), ignore=[collada.DaeError])
    errors = document.errors
    if _has_lost_materials(document):
        document = collada.Collada(io.BytesIO(without_lost_materials(document, data)), ignore=[collada.DaeError])
    scene = document.scene or (document.scenes[0] if len(document.scenes) == 1 else None)
    if scene is None:
        raise MeshFaultError("it has no <scene>")
    reader = _SceneReader(options, read_file, _axes(document, options.use_up_axis))
    reader.read(scene.nodes)
    if options.submesh and not reader.result.instances:
        raise MeshFaultError(f"it has no node {options.submesh[:60]!r} with geometry")
    sentences = dict.fromkeys(" ".join(str(error.msg).split())[:200] for error in errors)
    # Lights and cameras are not used anyway.
    lost = [text for text in sentences if not text.startswith(("Light ", "Camera "))]
    reader.result.warnings += [f"left out: {error}" for error in lost[:MAX_ERRORS]]
    return reader.result


def _has_lost_materials(document: Any) -> bool:
    """Return True if a material cannot be read: pycollada leaves out the meshes that have it."""
    return any(isinstance(each, collada.DaeBrokenRefError) and "Material" in str(each.msg) for each in document.errors)


def _axes(document: Any, use_up_axis: bool) -> NDArray[np.float64]:
    """Return the (4, 4) transform to metres and, with ``use_up_axis``, to Z up (COLLADA 1.4, 5-19)."""
    unit = document.assetInfo.unitmeter
    metres = 1.0 if unit is None else float(unit)
    if not 1e-9 < metres < 1e9:
        raise MeshFaultError(f"its unit of {metres:g} m is out of range")
    up_axis = document.xmlnode.findtext(f"{document.tag('asset')}/{document.tag('up_axis')}", "Y_UP").strip()
    rotation = _UP_AXES.get(up_axis, _UP_AXES["Y_UP"]) if use_up_axis else np.eye(4)
    return rotation @ np.diag((metres, metres, metres, 1.0))


class _SceneReader:
    """Collects the instances of geometry in a scene. Instances with the same materials share their shapes."""

    def __init__(self, options: MeshOptions, read_file: ReadFile, axes: NDArray[np.float64]) -> None:
        """``axes``: (4, 4) transform of the scene to metres and its up axis."""
        self._options = options
        self._axes = axes
        self._sizes: dict[int, tuple[int, int, int]] = {}
        """Number of parts, nodes and levels in the subtree of each node, by the node's ``id``."""
        self._shapes: dict[tuple[int, tuple[tuple[str, int, str], ...]], list[tuple[int, int]]] = {}
        """Shape indices with their numbers of triangles, by geometry and materials."""
        self._positions: dict[int, NDArray[Any]] = {}
        """Positions of vertices by their source's ``id``. Meshes of several materials have one source."""
        self._triangles = self._drawn = 0
        self.result = MeshData()
        self._textures = TextureFiles(read_file, self.result)

    def read(self, nodes: list[Any]) -> None:
        sizes = [self._size(node, 1) for node in nodes]
        parts, visited = sum(size[0] for size in sizes), sum(size[1] for size in sizes)
        if parts > self._options.max_instances:
            raise MeshFaultError(f"it has {_about(parts)} parts, the limit is {self._options.max_instances}")
        if visited > MAX_VISITED_NODES:
            raise MeshFaultError(f"it has {_about(visited)} nodes, the limit is {MAX_VISITED_NODES}")
        for node in nodes:
            self._add(node, self._axes, "")

    def _size(self, node: Any, level: int) -> tuple[int, int, int]:
        """Return parts, nodes and levels of a subtree, once if shared. Raises MeshFaultError: too many levels."""
        geometry = _geometry_of(node)
        if geometry is not None:
            return max(1, len(geometry.primitives)), 1, 1
        if not isinstance(node, collada.scene.Node):  # a camera or light
            return 0, 0, 1
        target = node.node if isinstance(node, collada.scene.NodeNode) else node
        size = self._sizes.get(id(target))
        if size is None:
            if level > self._options.max_node_depth:
                raise MeshFaultError(f"it has more than {self._options.max_node_depth} levels of nodes")
            below = [self._size(child, level + 1) for child in target.children or ()]
            parts = sum(child[0] for child in below)
            size = (
                parts,
                1 + sum(child[1] for child in below) if parts else 0,
                1 + max((c[2] for c in below), default=0),
            )
            self._sizes[id(target)] = size
        if level + size[2] > self._options.max_node_depth + 1:
            raise MeshFaultError(f"it has more than {self._options.max_node_depth} levels of nodes")
        return size

    def _add(self, node: Any, X: NDArray[np.float64], name: str) -> None:
        """Add the instances of a node and those below it, called after the nearest node above that has a name.

        Recursion is limited by ``max_node_depth``.
        """
        geometry = _geometry_of(node)
        if geometry is not None:
            if self._options.submesh not in ("", name):
                return
            if isinstance(node, collada.scene.ControllerNode):
                X = self._X_bind(node.controller, X)
            if not np.isfinite(X).all():
                self._warn_once("geometry of nodes with transforms that are not finite is left out")
                return
            for shape, triangles in self._shapes_of(geometry, node.materials):
                self._drawn += triangles
                if self._drawn > self._options.max_drawn_elements:
                    raise MeshFaultError(f"its parts draw more than {self._options.max_drawn_elements} triangles")
                self.result.instances.append((shape, X.tobytes()))
        elif self._size(node, 0)[0]:
            X_child = X @ np.asarray(node.matrix, np.float64)
            name = node.xmlnode.get("name") or name
            for child in node.children or ():
                self._add(child, X_child, name)

    def _X_bind(self, controller: Any, X_node: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the (4, 4) pose of a skinned or morphed geometry without its animation.

        Skinned vertices are in the coordinates of the skeleton, not of the node (COLLADA 1.4, 4-20).
        """
        self._warn_once("skinned and morphed meshes are shown in their bind pose")
        if not isinstance(controller, collada.controller.Skin):
            return X_node
        return self._axes @ np.asarray(controller.bind_shape_matrix, np.float64).reshape(4, 4)

    def _warn_once(self, warning: str) -> None:
        if warning not in self.result.warnings:
            self.result.warnings.append(warning)

    def _shapes_of(self, geometry: Any, material_nodes: list[Any]) -> list[tuple[int, int]]:
        materials = {each.symbol: each for each in material_nodes}
        key = (
            id(geometry),
            tuple(sorted((str(each.symbol), id(each.target.effect), str(each.inputs)) for each in material_nodes)),
        )
        shapes = self._shapes.get(key)
        if shapes is None:
            shapes = self._shapes[key] = list(self._read_geometry(geometry, materials))
        return shapes

    def _read_geometry(self, geometry: Any, materials: dict[str, Any]) -> Iterator[tuple[int, int]]:
        first_material = next(iter(materials.values()), None)  # Aspose.3D binds it to another symbol
        for primitive in geometry.primitives:
            if isinstance(primitive, collada.polylist.Polylist):
                primitive = _triangle_set(primitive)
            if not isinstance(primitive, collada.triangleset.TriangleSet) or primitive.vertex is None:
                continue
            count = len(primitive.vertex_index)
            self._triangles += count
            if self._triangles > self._options.max_elements:
                raise MeshFaultError(f"it has more than {self._options.max_elements} triangles")
            shape = self._read_primitive(primitive, materials.get(primitive.material, first_material))
            if shape is not None:
                self.result.shapes.append(shape)
                yield len(self.result.shapes) - 1, count

    def _read_primitive(self, primitive: Any, material: Any) -> Shape | None:
        """Convert triangles to ones that share no vertices. ``material`` is the node that binds one, or None."""
        effect = None if material is None else material.target.effect
        source = primitive.sources["VERTEX"][0][4]
        if id(source) not in self._positions:
            self._positions[id(source)] = _precise_positions(source)
        positions = _corners(self._positions[id(source)], primitive.vertex_index, "vertices")
        normals = uv = colors = None
        if primitive.normal is not None:
            normals = _corners(primitive.normal, primitive.normal_index, "normals")
        color, image = (None, None) if effect is None else self._material(effect)
        if primitive.texcoordset:  # kept without an image, too: the material of a robot file may have one
            number = 0 if material is None else _texture_coordinates(primitive, effect, material.inputs)
            uv = _corners(primitive.texcoordset[number], primitive.texcoord_indexset[number], "texture coordinates")
            uv = uv[:, :2]
        color_inputs = primitive.sources.get("COLOR")
        if color_inputs and image is None and (color is None or color[:3] == (1.0, 1.0, 1.0)):  # a white effect
            offset, source = color_inputs[0][0], color_inputs[0][4]
            values = np.clip(np.nan_to_num(_corners(source.data, primitive.index[:, :, offset], "colours")), 0.0, 1.0)
            if values.shape[1] in (3, 4):
                colors = np.full((len(values), 4), 255, np.uint8)
                colors[:, : values.shape[1]] = np.round(values * 255.0)
        triangles, warnings = np.arange(len(positions), dtype=np.int64).reshape(-1, 3), self.result.warnings
        shape = shape_of(
            positions, triangles, warnings, normals=normals, uv=uv, colors=colors, color=color, image=image
        )
        if shape is not None and effect is not None and isinstance(effect.emission, tuple):
            r, g, b = map(float, effect.emission[:3])
            shape.emission = r, g, b
        return shape

    def _material(self, effect: Any) -> tuple[tuple[float, float, float, float], int | None]:
        """Return the diffuse colour and the texture of an effect."""
        rgba, image = (1.0, 1.0, 1.0, 1.0), None
        if isinstance(effect.diffuse, collada.material.Map):
            url = (effect.diffuse.sampler.surface.image.path or "").strip()
            path = url.removeprefix("file://").removeprefix("file:")
            image = self._textures.index(path) if path else None
        elif effect.shadingtype == "constant" and isinstance(effect.emission, tuple):
            rgba = (0.0, 0.0, 0.0, 1.0)  # emission is all that it has
        elif effect.diffuse is not None:
            r, g, b, a = (*map(float, effect.diffuse), 1.0)[:4]
            rgba = (r, g, b, a)
        return (*rgba[:3], _opacity(effect, rgba[3])), image


def _texture_coordinates(primitive: Any, effect: Any, inputs: list[tuple[str, str, str | None]]) -> int:
    """Return the place of the diffuse texture's coordinates, whose set ``<bind_vertex_input>`` names."""
    name = getattr(effect.diffuse, "texcoord", None)
    bound = {number for semantic, kind, number in inputs if semantic == name and kind == "TEXCOORD"}
    return next((place for place, each in enumerate(primitive.sources["TEXCOORD"]) if each[3] in bound), 0)


def _triangle_set(polygons: Any) -> Any:
    """Return the triangles of a ``Polylist``, whose own method takes each polygon for convex."""
    if polygons.vertex is None or not len(polygons.index):
        return polygons.triangleset()
    sizes, corners = polygons.vcounts.astype(np.int64), np.arange(len(polygons.index))
    starts, positions = np.cumsum(sizes) - sizes, _corners(polygons.vertex, polygons.vertex_index, "vertices")
    with_holes = []
    for number, polygon in enumerate(polygons.xmlnode.findall("./{*}p")):
        if rings := polygon.get(RINGS):
            place, lengths = starts[number], np.array(rings.split(), np.int64)
            own = positions[place : place + sizes[number]]
            with_holes.append(place + triangles_of_rings(own, lengths * sizes[number] // max(1, lengths.sum())))
            sizes[number] = 0
    triangles = np.concatenate((triangles_of_polygons(corners, starts, sizes, positions), *with_holes))
    return collada.triangleset.TriangleSet(
        polygons.sources, polygons.material, polygons.index[triangles], polygons.xmlnode
    )


def _geometry_of(node: Any) -> Any:
    """Return the geometry that a node instantiates, directly or through a skin or morph; None if there is none."""
    if isinstance(node, collada.scene.ControllerNode):
        skinned = isinstance(node.controller, collada.controller.Skin)
        return node.controller.geometry if skinned else node.controller.source_geometry
    return node.geometry if isinstance(node, collada.scene.GeometryNode) else None


def _opacity(effect: Any, diffuse_alpha: float) -> float:
    """Return the opacity of an effect (COLLADA 1.4, 7-5).

    A ``<transparency>`` of 0 or 1 is ignored: exporters write either for what is opaque.
    """
    transparency = effect.transparency if isinstance(effect.transparency, float | int) else 1.0
    factor = float(transparency) if 0.0 < transparency < 1.0 else 1.0
    if effect.transparent is None or isinstance(effect.transparent, collada.material.Map):
        return diffuse_alpha * factor
    r, g, b, a = (*effect.transparent, 1.0)[:4]
    if effect.opaque_mode == collada.material.OPAQUE_MODE.RGB_ZERO:
        return float(1.0 - factor * (0.212671 * r + 0.715160 * g + 0.072169 * b))
    return float(a * factor)


def _precise_positions(source: Any) -> NDArray[Any]:
    """Return the positions of a source, (N, 3), those of a survey as float64: pycollada has float32 only."""
    values: NDArray[Any] = source.data
    if not any(origin_amid(values.astype(np.float64))):
        return values
    text = source.xmlnode.findtext("./{*}float_array") or ""
    precise = np.fromstring(text, np.float64, sep=" ")  # as pycollada does
    return np.nan_to_num(precise.reshape(values.shape)) if precise.size == values.size else values


def _corners(values: NDArray[Any], indices: NDArray[np.int32], what: str) -> NDArray[Any]:
    """Return the value of each corner, (number of corners, components)."""
    if indices.size and not (int(indices.min()) >= 0 and int(indices.max()) < len(values)):
        raise MeshFaultError(f"an index of its {what} is not one of 0 to {len(values) - 1}")
    corners: NDArray[Any] = values[indices.reshape(-1)]
    return corners


def _about(number: int) -> str:
    """Return a number as text; from ten digits on, as ``more than 10^9``."""
    text = str(number)
    return text if len(text) < 10 else f"more than 10^{len(text) - 1}"
