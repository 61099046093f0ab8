"""Reads mesh files: OBJ with trimesh, COLLADA with pycollada, STL, PLY and VTK with our own parsers."""

from __future__ import annotations

import contextlib
import io
import math
import re
from typing import Any, Final

import msgspec
import numpy as np
import trimesh
from numpy.typing import NDArray
from trimesh.visual.material import SimpleMaterial

from gateway.files.parsers.collada import read_collada
from gateway.files.parsers.mesh_data import MeshData, MeshFaultError, MeshOptions, Shape, checked_triangles, shape_of
from gateway.files.parsers.obj import (
    with_absolute_faces,
    with_convex_faces,
    with_one_group,
    with_plain_blanks,
    with_unit_colors,
    without_broken_faces,
)
from gateway.files.parsers.ply import read_ply, srgb_bytes
from gateway.files.parsers.stl import read_stl
from gateway.files.parsers.texture_files import ReadFile, TextureFiles
from gateway.files.parsers.vtk import read_vtk

_IDENTITY: Final = np.eye(4).tobytes()
_USED_MATERIAL: Final = re.compile(rb"^[ \t]*usemtl[ \t]([^\r\n]*)", re.MULTILINE)
_DEFINED_MATERIAL: Final = re.compile(rb"^[ \t]*newmtl[ \t]([^\r\n]*)", re.MULTILINE)
_LIBRARIES: Final = re.compile(rb"^[ \t]*mtllib[ \t]+([^\r\n]*)", re.MULTILINE)
_BETWEEN_LIBRARIES: Final = re.compile(r"(?<=\.mtl)\s+", re.IGNORECASE)
"""Blanks between the names of MTL files in a statement; a name may have blanks, too."""
_COMMENT: Final = re.compile(rb"^([ \t]*(?:[Kk][adse]|newmtl|d|Tr)[ \t][^#\r\n]*[ \t])#[^\r\n]*", re.MULTILINE)
_GRAY: Final = re.compile(rb"^([ \t]*[Kk][adse])[ \t]+([-+.\deE]+)[ \t]*$", re.MULTILINE)
_TEXTURE_OPTION: Final = re.compile(r"-[a-zA-Z]+(?:\s+(?:on|off|[rgbmlz]|[-+.\deE]+))+\s+")
"""Option before a texture's name in an MTL file, such as ``-clamp on`` and ``-s 1 1 1``."""
_WITHOUT_EFFECT: Final = frozenset({"-blendu", "-blendv", "-bm", "-boost", "-texres"})
"""Options of filters, and of other textures than colours."""
_MAX_NAMED: Final = 5
"""Maximum number of names in a warning."""


def read_mesh(read_file: ReadFile, data: bytes, extension: str, options: dict[str, Any]) -> MeshData | str:
    """Return the content of an obj, stl, ply, dae or vtk file by ``MeshOptions``, or why it cannot be used."""
    try:
        result = _read(read_file, data, extension, msgspec.convert(options, MeshOptions))
    except MemoryError:
        raise
    except MeshFaultError as error:
        return str(error)
    except Exception as error:  # noqa: BLE001 - third-party code on damaged data
        # Only errors that the parsers raise on purpose have texts for users.
        reason = " ".join(str(error).split())[:200] if isinstance(error, ValueError) else ""
        return f"it cannot be read as {extension.upper()}: {reason or 'it is damaged'}"
    if not result.instances:
        return "; ".join(("the file holds no triangles or points", *result.warnings))
    _make_visible(result)
    return result


def _make_visible(content: MeshData) -> None:
    """Make all shapes opaque if each has an opacity of 0: exporters write that for opaque meshes."""
    colors = [shape.color for shape in content.shapes]
    if all(color is not None and color[3] <= 0.0 for color in colors):
        for shape in content.shapes:
            if shape.color is not None:
                shape.color = (*shape.color[:3], 1.0)
        content.warnings.append("all its materials have an opacity of 0; it is drawn opaque")


def _read(read_file: ReadFile, data: bytes, extension: str, options: MeshOptions) -> MeshData:
    if extension == "dae":
        return read_collada(data, read_file, options)
    content = MeshData()
    textures = TextureFiles(read_file, content)
    if extension == "obj":
        _read_obj(read_file, data, textures, options, content)
        return content
    if extension == "ply":
        shape = read_ply(data, textures, options, content)
    elif extension == "stl":
        positions, colors = read_stl(data, options.max_elements, content.warnings)
        triangles = np.arange(len(positions)).reshape(-1, 3)
        shape = shape_of(positions, triangles, content.warnings, colors=colors)
    else:
        positions, vtk_triangles, colors = read_vtk(data, options.max_vertices, options.max_elements, content.warnings)
        shape = shape_of(positions, vtk_triangles, content.warnings, colors=colors)
    if shape is not None:
        content.shapes, content.instances = [shape], [(0, _IDENTITY)]
    return content


def _read_obj(
    read_file: ReadFile, data: bytes, textures: TextureFiles, options: MeshOptions, content: MeshData
) -> None:
    """Add the content of an OBJ file: one instance of each shape, as the format has no others."""
    original = data = with_plain_blanks(data)
    if options.submesh:
        data = with_one_group(data, options.submesh)
    libraries = [line.decode("utf-8", "replace").strip().strip('"') for line in _LIBRARIES.findall(data)]
    data = with_unit_colors(with_absolute_faces(data))
    resolver = _Resolver(read_file, textures, libraries)

    def load(data: bytes) -> Any:
        file = io.BytesIO(with_convex_faces(data))
        return trimesh.load_scene(file, file_type="obj", resolver=resolver, process=False, allow_remote=False)

    try:
        scene = load(data)
    except (ValueError, IndexError):
        scene = load(without_broken_faces(data, original, content.warnings))
    if resolver.materials:
        content.warnings += _undefined_materials(data, resolver.materials)
    if len(scene.geometry) > options.max_instances:
        raise MeshFaultError(f"it has {len(scene.geometry)} parts, the limit is {options.max_instances}")
    vertices = sum(len(getattr(geometry, "vertices", ())) for geometry in scene.geometry.values())
    triangles = sum(len(getattr(geometry, "faces", ())) for geometry in scene.geometry.values())
    if vertices > options.max_vertices or triangles > options.max_elements:
        raise MeshFaultError(f"it has more than {options.max_vertices} vertices or {options.max_elements} triangles")
    for geometry in scene.geometry.values():
        shape = _shape(geometry, textures, content.warnings)
        if shape is not None:
            content.instances.append((len(content.shapes), _IDENTITY))
            content.shapes.append(shape)


def _undefined_materials(data: bytes, materials: set[bytes]) -> list[str]:
    """Return a warning if an OBJ file uses materials that none of its MTL files defines."""
    undefined = {name.strip() for name in _USED_MATERIAL.findall(data)} - materials
    if not undefined:
        return []
    names = ", ".join(sorted(repr(name[:60].decode("utf-8", "replace")) for name in undefined)[:_MAX_NAMED])
    return [f"materials of usemtl that no MTL file defines ({len(undefined)}): {names}; they are white"]


class _Resolver(trimesh.resolvers.Resolver):
    """Resolver that lets trimesh read files only through ``read_file``."""

    def __init__(self, read_file: ReadFile, textures: TextureFiles, libraries: list[str]) -> None:
        """``libraries``: names of MTL files, as an OBJ file's statements ``mtllib`` have them."""
        self._read_file = read_file
        self._libraries = libraries
        self._textures = textures
        self._folders: list[str] = []
        """Folders of the MTL files that were read: textures are relative to the OBJ or to the MTL file."""
        self.materials: set[bytes] = set()
        """Names of all materials in the MTL files that were read."""

    def get(self, name: str) -> bytes:
        if name.strip('" ') == next(iter(self._libraries), None):  # trimesh reads the first statement only, as one name
            names = (name for line in self._libraries for name in _BETWEEN_LIBRARIES.split(line))
            return b"\n".join(map(self._read_library, dict.fromkeys(names)))
        name = _texture_name(str(name))
        data = self._read_file("\n".join(dict.fromkeys((name, *(folder + name for folder in self._folders)))))
        return self._textures.encoded(name, data)

    def _read_library(self, name: str) -> bytes:
        """Return an MTL file with three numbers for gray and no comments behind colours; empty if it is missing."""
        try:
            data = self._read_file(name)
        except OSError:
            return b""
        data = with_plain_blanks(data.replace(b"\r\n", b"\n"))
        data = _GRAY.sub(rb"\1 \2 \2 \2", _COMMENT.sub(rb"\1", data))
        self.materials |= {material.strip() for material in _DEFINED_MATERIAL.findall(data)}
        self._folders.append(name[: max(name.rfind("/"), name.rfind("\\")) + 1])
        return data

    def write(self, name: str, data: object) -> None:
        raise PermissionError(name)

    def keys(self) -> list[str]:
        return []

    def namespaced(self, namespace: str) -> _Resolver:
        return self


def _shape(geometry: Any, textures: TextureFiles, warnings: list[str]) -> Shape | None:
    """Convert a trimesh geometry; None for one that draws nothing."""
    positions = np.asarray(getattr(geometry, "vertices", np.zeros((0, 3))))
    if positions.ndim != 2 or positions.shape[1] != 3 or not len(positions):
        return None
    colors = _vertex_colors(geometry)
    if colors is not None and len(colors) != len(positions):
        colors = None
    if not hasattr(geometry, "faces"):
        return shape_of(positions, None, warnings, colors=colors)
    uv, color, image = _material(geometry, textures, warnings)
    # trimesh's property computes missing normals. Its cache has only the normals of the file.
    normals = geometry._cache.cache.get("vertex_normals")
    if normals is not None and len(normals) != len(positions):
        normals = None
    if image is not None:
        colors = None
    triangles = checked_triangles(np.asarray(geometry.faces, np.int64).reshape(-1, 3), len(positions), warnings)
    shape = shape_of(positions, triangles, warnings, normals=normals, uv=uv, colors=colors, color=color, image=image)
    if shape is not None and color is not None:
        shape.emission = _mtl_emission(geometry.visual.material)
    return shape


def _vertex_colors(geometry: Any) -> NDArray[np.uint8] | None:
    """Return the sRGB colours of the vertices or points of an OBJ file, (N, 4); None if there are none."""
    visual = getattr(geometry, "visual", None)
    if visual is None:
        colors = getattr(geometry, "colors", None)
    elif getattr(visual, "kind", None) == "vertex":
        colors = visual.vertex_colors
    else:  # beside a material or texture coordinates
        colors = geometry.vertex_attributes.get("color")
    if colors is None or np.ndim(colors) != 2:
        return None
    return np.column_stack((srgb_bytes(np.asarray(colors)[:, :3]), np.full(len(colors), 255, np.uint8)))


def _texture_name(statement: str) -> str:
    """Return the file name in a statement of an MTL file, without the options before it."""
    name = _TEXTURE_OPTION.sub("", statement) if statement.startswith("-") else statement
    return name[1:-1] if name[:1] == name[-1:] == '"' else name


def _placed(uv: Any, statement: str, warnings: list[str]) -> NDArray[np.float64]:
    """Return texture coordinates scaled by ``-s`` and moved by ``-o``; others that matter are a warning."""
    scale, offset = np.ones(2), np.zeros(2)
    ignored: list[str] = []
    for option in _TEXTURE_OPTION.findall(statement) if statement.startswith("-") else ():
        name, *values = option.split()
        if name in ("-s", "-o"):
            with contextlib.suppress(ValueError):
                numbers = np.array(values[:2], np.float64)
                (scale if name == "-s" else offset)[: len(numbers)] = numbers
        elif name not in _WITHOUT_EFFECT and values != ["off"]:
            ignored.append(option.strip())
    placed: NDArray[np.float64] = np.asarray(uv, np.float64) * scale + offset
    if ignored == ["-clamp on"] and placed.min() >= 0.0 and placed.max() <= 1.0:
        return placed
    warnings += [f"the option {option!r} of map_Kd is ignored" for option in ignored]
    return placed


def _material(
    geometry: Any, textures: TextureFiles, warnings: list[str]
) -> tuple[NDArray[np.float64] | None, tuple[float, float, float, float] | None, int | None]:
    """Return texture coordinates, diffuse colour and texture; None for those that are missing or unused.

    Coordinates are kept without a texture: the material of a robot file may have one for them.
    """
    visual = geometry.visual
    material, uv = getattr(visual, "material", None), getattr(visual, "uv", None)
    if material is None:
        return None, None, None
    if _is_default(material):
        return uv, None, None
    image_file = getattr(material, "baseColorTexture", None) or getattr(material, "image", None)
    texture, info = getattr(image_file, "fp", None), getattr(image_file, "info", {})
    has_uv = uv is not None and np.shape(uv) == (len(geometry.vertices), 2)
    path = str(info.get("file_path", "texture"))
    image = (
        textures.add(_texture_name(path), texture.getvalue()) if has_uv and isinstance(texture, io.BytesIO) else None
    )
    statements = getattr(material, "kwargs", None) or {}
    if image is None and isinstance(material, SimpleMaterial) and not statements:
        return None, None, None  # an image without usable coordinates: the colour is trimesh's grey default
    diffuse = getattr(material, "baseColorFactor", None)
    diffuse = getattr(material, "diffuse", None) if diffuse is None else diffuse
    color = np.ones(4) if diffuse is None else np.append(np.asarray(diffuse, np.float64)[:4] / 255.0, 1.0)[:4]
    if isinstance(material, SimpleMaterial) and "kd" not in statements:  # trimesh's grey
        color[:3] = 1.0
    if image is not None:
        uv = _placed(uv, path, warnings)
        if not color[:3].any():  # a black one would hide the texture
            color[:3] = 1.0
    opacity_map = _texture_name(" ".join(map(str, statements.get("map_d", ()))))
    if opacity_map and (image is None or opacity_map != _texture_name(path)):  # the alpha of map_Kd is drawn
        warnings.append(f"map_d {opacity_map[:60]!r} is ignored, as only the alpha of map_Kd is read")
    color[3] *= _mtl_opacity(statements)
    return uv, _rgba(color), image


def _rgba(color: NDArray[np.float64]) -> tuple[float, float, float, float]:
    r, g, b, a = color.tolist()
    return r, g, b, a


def _is_default(material: Any) -> bool:
    """Return True for the grey material that trimesh gives OBJ files with texture coordinates but without an MTL file.

    A material of an MTL file has its statements in ``kwargs``; the image of the grey material has no file.
    """
    if not isinstance(material, SimpleMaterial) or material.kwargs:
        return False
    return not isinstance(getattr(material.image, "fp", None), io.BytesIO)


def _mtl_emission(material: Any) -> tuple[float, float, float]:
    """Return the emitted colour of a material in an MTL file, its ``Ke``, sRGB; black without."""
    try:
        r, g, b = map(float, (getattr(material, "kwargs", None) or {})["ke"])
    except (KeyError, TypeError, ValueError):
        return 0.0, 0.0, 0.0
    return r, g, b


def _mtl_opacity(statements: dict[str, Any]) -> float:
    """Return the opacity of a material in an MTL file: its ``d``, or 1 - ``Tr``. The default is 1."""
    for key in ("d", "tr"):
        try:
            value = float(statements[key][-1])
        except (KeyError, IndexError, TypeError, ValueError):
            continue
        if math.isfinite(value):
            return value if key == "d" else 1.0 - value
    return 1.0
