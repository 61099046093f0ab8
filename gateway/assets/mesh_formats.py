"""Parses mesh files: OBJ, STL, PLY and COLLADA with trimesh, glTF with ``gateway.gltf``, VTK with ``vtk_format``."""

from __future__ import annotations

import io
import re
from collections.abc import Callable
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from gateway.assets.vtk_format import VtkError, parse_vtk
from gateway.gltf import GltfLimits, read_gltf
from gateway.scene.broken_textures import without_broken_textures
from gateway.scene.geometry import Part, PointCloud, Shape, Surface
from gateway.scene.materials import POINT_SIZE
from gateway.scene.transforms import IDENTITY, Y_UP_TO_Z_UP, Matrix, scaling
from gateway.scene.tree import Node
from renderers.color import linear_colors_from_srgb, linear_from_srgb
from renderers.drawlist import AlphaMode, Image, Material, Mesh, Texture
from renderers.images import image_from_bytes

_GLTF_FORMATS: Final = frozenset({"gltf", "glb"})
FORMATS: Final = _GLTF_FORMATS | {"obj", "stl", "ply", "dae", "vtk"}
"""File name extensions that can be read."""
MESH_LIMITS: Final = GltfLimits(max_vertices=10_000_000, max_elements=10_000_000)
"""Default limits of the content of a mesh file. They hold for all formats."""

Resolve = Callable[[str], bytes]
"""Function that returns the bytes of a file that a mesh file refers to; raises OSError or ValueError."""


class MeshFormatError(ValueError):
    """A file that cannot be parsed. The message does not name the file."""


class EmptyMeshError(MeshFormatError):
    """A file without triangles and points."""


def parse_mesh(
    data: bytes, extension: str, resolve: Resolve, limits: GltfLimits, *, collada_up_axis: bool = True
) -> tuple[Part, ...]:
    """Return the parts of a mesh file, in metres and Z up.

    glTF is Y-up by its specification, except for files that Drake wrote. COLLADA files state their unit and their up
    axis. Files of the other formats state neither; they are taken as metres and Z up. A file without materials is
    white (``PLAIN_MATERIAL``), so that callers can apply a colour. Textures that cannot be decoded are left out.

    Args:
        data: The file.
        extension: One of ``FORMATS``.
        resolve: Returns the files of materials and textures; those for which it raises an error are left out.
        limits: Limits of glTF. Those on vertices, elements, instances and pixels hold for all formats.
        collada_up_axis: False: COLLADA files are taken as Z up whatever they state, as robot software does.

    Raises:
        MeshFormatError: The data does not have that format, has no geometry, or is beyond a limit.
        GltfError: The glTF document cannot be read.
    """
    if extension in _GLTF_FORMATS:
        return without_broken_textures(_parts_of_gltf(data, resolve, limits), limits.max_total_image_pixels)
    if extension == "vtk":
        return _parts_of_vtk(data, limits)
    X_part_file = _collada_axes(data, collada_up_axis) if extension == "dae" else IDENTITY
    parts = _parts_of_scene(_trimesh_scene(data, extension, resolve), X_part_file, limits)
    if not parts:
        raise EmptyMeshError("the file holds no triangles or points")
    return without_broken_textures(tuple(parts), limits.max_total_image_pixels)


def _parts_of_gltf(data: bytes, resolve: Resolve, limits: GltfLimits) -> tuple[Part, ...]:
    scene = read_gltf(data, resolve=resolve, limits=limits)
    parts: list[Part] = []
    stack: list[tuple[Node, Matrix]] = [(scene.root, IDENTITY if scene.from_drake else Y_UP_TO_Z_UP)]
    while stack:
        node, parent = stack.pop()
        X = parent @ node.matrix
        parts.extend(Part(part.shape, part.material, X @ part.X_node_part) for part in node.parts or ())
        stack.extend((child, X) for child in reversed(node.children.values()))
    return tuple(parts)


def _parts_of_vtk(data: bytes, limits: GltfLimits) -> tuple[Part, ...]:
    from gateway.scene.crease_normals import with_creases  # here, because it loads kernels

    try:
        positions, triangles = parse_vtk(data, limits.max_vertices, limits.max_elements)
    except VtkError as error:
        raise MeshFormatError(str(error)) from None
    finite = np.asarray(np.isfinite(positions).all(axis=1))
    triangles = triangles[finite[triangles].all(axis=1)]
    positions[~finite] = 0.0
    if not len(triangles):
        raise MeshFormatError("the file holds no triangles")
    return (Part(Surface(with_creases(positions, np.ascontiguousarray(triangles))), PLAIN_MATERIAL),)


def _trimesh_scene(data: bytes, extension: str, resolve: Resolve) -> Any:
    """Return a ``trimesh.Scene``; raise ``MeshFormatError`` if trimesh cannot read the file."""
    import trimesh  # here, because it takes 0.3 s, and many gateways never open a mesh file

    class Resolver(trimesh.resolvers.Resolver):
        """Lets trimesh read files only by ``resolve``."""

        def __init__(self) -> None:
            """Replaces the base class's, which takes a folder."""

        def get(self, name: str) -> bytes:
            return resolve(str(name))

        def write(self, name: str, data: object) -> None:
            raise PermissionError(name)

        def keys(self) -> list[str]:
            return []

        def namespaced(self, namespace: str) -> Resolver:
            return self

    try:
        return trimesh.load_scene(
            io.BytesIO(data), file_type=extension, resolver=Resolver(), process=False, allow_remote=False
        )
    except Exception as error:
        reason = " ".join(str(error).split())[:200]
        raise MeshFormatError(f"it cannot be read as {extension.upper()}: {reason or type(error).__name__}") from error


def _collada_axes(data: bytes, use_up_axis: bool) -> Matrix:
    """Return the transform from a COLLADA document's unit and, if used, up axis (1.4, 5-19) to metres and Z up."""
    if b"<!DOCTYPE" in data or b"<!ENTITY" in data or data[:2] in (b"\xff\xfe", b"\xfe\xff"):
        raise MeshFormatError("COLLADA documents with a DOCTYPE, or not in UTF-8, are refused")
    header = data[: 1 << 16].decode("utf-8", "replace")
    unit = re.search(r"<unit\b[^>]*\bmeter\s*=\s*[\"']([^\"']+)[\"']", header)
    up_axis = re.search(r"<up_axis>\s*([XYZ])_UP\s*</up_axis>", header)
    try:
        metres_per_unit = float(unit[1]) if unit else 1.0
    except ValueError:
        metres_per_unit = 1.0
    if not 1e-9 < metres_per_unit < 1e9:
        raise MeshFormatError(f"its unit of {metres_per_unit:g} m is out of range")
    if not use_up_axis:
        return scaling(metres_per_unit, metres_per_unit, metres_per_unit)
    rotation = {"Z": IDENTITY, "Y": Y_UP_TO_Z_UP, "X": _X_UP_TO_Z_UP}[up_axis[1] if up_axis else "Y"]
    return rotation @ scaling(metres_per_unit, metres_per_unit, metres_per_unit)


_X_UP_TO_Z_UP: Final[Matrix] = np.array(
    ((0.0, -1.0, 0.0, 0.0), (0.0, 0.0, -1.0, 0.0), (1.0, 0.0, 0.0, 0.0), (0.0, 0.0, 0.0, 1.0))
)
"""Rotation from COLLADA's X_UP axes to Z up: up +X to +Z, right -Y to +X, towards the viewer +Z to -Y."""


def _parts_of_scene(scene: Any, X_part_file: Matrix, limits: GltfLimits) -> list[Part]:
    """Return a part for each instance of a geometry in a trimesh scene.

    Args:
        X_part_file: Transform from the file's axes and unit to the part's frame.
    """
    parts: list[Part] = []
    shapes: dict[str, tuple[Shape, Material] | None] = {}
    """Shapes by the name of their geometry; None for those that draw nothing."""
    vertex_count = element_count = 0
    for frame in scene.graph.nodes_geometry:
        X, name = scene.graph[frame]
        if name not in shapes:
            geometry = scene.geometry[name]
            vertex_count += len(getattr(geometry, "vertices", ()))
            element_count += len(getattr(geometry, "faces", ()))
            if vertex_count > limits.max_vertices or element_count > limits.max_elements:
                raise MeshFormatError(
                    f"it has more than {limits.max_vertices} vertices or {limits.max_elements} triangles"
                )
            shapes[name] = _shape_of(geometry, limits)
        shape_and_material = shapes[name]
        if shape_and_material is None:
            continue
        if len(parts) >= limits.max_instances:
            raise MeshFormatError(f"it has more than {limits.max_instances} parts")
        parts.append(Part(*shape_and_material, X_part_file @ np.asarray(X, dtype=np.float64)))
    return parts


def _shape_of(geometry: Any, limits: GltfLimits) -> tuple[Shape, Material] | None:
    """Convert a trimesh geometry; None for one that draws nothing."""
    positions = np.ascontiguousarray(getattr(geometry, "vertices", np.zeros((0, 3))), dtype=np.float32)
    if positions.ndim != 2 or positions.shape[1] != 3 or not len(positions):
        return None
    colors = _vertex_colors(geometry, len(positions))
    faces = np.asarray(getattr(geometry, "faces", np.zeros((0, 3))))
    if not len(faces):
        if hasattr(geometry, "faces"):
            return None
        return PointCloud(positions, {} if colors is None else {"rgb": colors}), PLAIN_MATERIAL
    if colors is not None:
        colors = linear_colors_from_srgb(colors)  # the files have sRGB colours, a Mesh has linear ones
    if faces.min() < 0 or faces.max() >= len(positions):
        raise MeshFormatError(f"a face refers to vertex {int(faces.max())} of {len(positions)}")
    triangles = np.ascontiguousarray(faces, dtype=np.uint32)
    finite = np.asarray(np.isfinite(positions).all(axis=1))
    if not finite.all():
        triangles = np.ascontiguousarray(triangles[finite[triangles].all(axis=1)])
        positions[~finite] = 0.0
    uv, material = _material_of(geometry, len(positions), limits)
    # trimesh's property computes missing normals. Its cache has only the normals of the file.
    file_normals = geometry._cache.cache.get("vertex_normals")
    if file_normals is None or len(file_normals) != len(positions):
        from gateway.scene.crease_normals import with_creases  # here, because it loads kernels

        return Surface(with_creases(positions, triangles, uv=uv, colors=colors)), material
    with np.errstate(all="ignore"):
        normals = file_normals / np.linalg.norm(file_normals, axis=1, keepdims=True)
    normals = np.ascontiguousarray(np.nan_to_num(normals, posinf=0.0, neginf=0.0), dtype=np.float32)
    return Surface(Mesh(positions, triangles, normals=normals, uv0=uv, colors=colors)), material


PLAIN_MATERIAL: Final = Material(metallic=0.0, roughness=1.0, double_sided=True, point_size=POINT_SIZE)
"""White, diffuse and double-sided, as Director draws meshes and points without a material."""


def _vertex_colors(geometry: Any, vertex_count: int) -> NDArray[np.float32] | None:
    """Return the sRGB colours of vertices or points, (vertex_count, 4) float32 in 0 .. 1; None if there are none."""
    visual = getattr(geometry, "visual", None)
    if visual is None or getattr(visual, "kind", None) != "vertex":
        colors = getattr(geometry, "colors", None)
    else:
        colors = visual.vertex_colors
    if colors is None or np.shape(colors) != (vertex_count, 4):
        return None
    return np.ascontiguousarray(np.asarray(colors, dtype=np.float32) / 255.0)


def _material_of(geometry: Any, vertex_count: int, limits: GltfLimits) -> tuple[NDArray[np.float32] | None, Material]:
    """Return texture coordinates (vertex_count, 2) and the material.

    The texture coordinates start at the image's top left corner, as in glTF; those in the files at its bottom left.
    None if the file has none, or a material without a texture.
    """
    visual = geometry.visual
    if getattr(visual, "kind", None) == "face":
        return None, diffuse_material(np.asarray(visual.main_color, dtype=np.float64) / 255.0, None)
    file_material = getattr(visual, "material", None)
    if file_material is None:
        return None, PLAIN_MATERIAL
    coordinates = getattr(visual, "uv", None)
    uv = None
    if coordinates is not None and np.shape(coordinates) == (vertex_count, 2) and np.isfinite(coordinates).all():
        uv = np.array(coordinates, dtype=np.float32)
        uv[:, 1] = 1.0 - uv[:, 1]
    if _is_default(file_material):
        return uv, PLAIN_MATERIAL
    texture = getattr(file_material, "baseColorTexture", None) or getattr(file_material, "image", None)
    image = _image_of(texture, limits) if uv is not None and texture is not None else None
    if image is None and getattr(file_material, "kwargs", None) == {}:
        return None, PLAIN_MATERIAL  # an image without usable coordinates: the colour is trimesh's grey default
    diffuse = getattr(file_material, "baseColorFactor", None)
    diffuse = getattr(file_material, "diffuse", None) if diffuse is None else diffuse
    color = np.ones(4) if diffuse is None else np.asarray(diffuse, dtype=np.float64)[:4] / 255.0
    color = np.append(color, 1.0)[:4]
    color[3] *= _mtl_opacity(getattr(file_material, "kwargs", None) or {})
    return uv if image is not None else None, diffuse_material(color, image)


def _is_default(file_material: Any) -> bool:
    """Return True for the grey material that trimesh gives OBJ files with texture coordinates but without an MTL file.

    A material of an MTL file has its statements in ``kwargs``; the image of the grey material has no file.
    """
    from trimesh.visual.material import SimpleMaterial

    if not isinstance(file_material, SimpleMaterial) or file_material.kwargs:
        return False
    return not isinstance(getattr(file_material.image, "fp", None), io.BytesIO)


def _mtl_opacity(statements: dict[str, Any]) -> float:
    """Return the opacity of a material in an MTL file: its ``d``, or 1 - ``Tr``. The default is 1.

    A ``Tr`` of 1 is taken as opaque: exporters that wrote it meant the opposite, since invisible meshes make no sense.
    """
    for key in ("d", "tr"):
        try:
            value = float(statements[key][-1])
        except (KeyError, IndexError, TypeError, ValueError):
            continue
        return value if key == "d" else 1.0 - value or 1.0
    return 1.0


def diffuse_material(color: NDArray[np.float64], image: Image | None) -> Material:
    """Return a diffuse material.

    If there is an image, only the opacity of the colour is used, as in VTK and Drake: files with a texture often have a
    black diffuse colour (Kd).

    Args:
        color: (4,) float64, sRGB and opacity in 0 .. 1.
    """
    r, g, b, alpha = np.clip(np.nan_to_num(color), 0.0, 1.0).tolist()
    base = (1.0, 1.0, 1.0) if image is not None else (linear_from_srgb(r), linear_from_srgb(g), linear_from_srgb(b))
    return Material(
        base_color=(*base, alpha),
        base_color_texture=None if image is None else Texture(image, name="texture"),
        metallic=0.0,
        roughness=1.0,
        alpha_mode=AlphaMode.BLEND if alpha < 1.0 else AlphaMode.OPAQUE,
        double_sided=True,
    )


def _image_of(image: Any, limits: GltfLimits) -> Image | None:
    """Return the image file behind a Pillow image that trimesh opened, not decoded; None if there is no file."""
    stream = getattr(image, "fp", None)
    if not isinstance(stream, io.BytesIO):
        return None
    return image_from_bytes(stream.getvalue(), max_pixels=limits.max_image_pixels)
