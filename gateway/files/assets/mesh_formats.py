"""Parses mesh files: glTF here, other formats in a limited child process (``gateway.files.parsers``)."""

import contextlib
from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from typing import Final

import msgspec
import numpy as np
from numpy.typing import NDArray

from gateway.files.gltf import GltfLimits, Up, read_gltf
from gateway.files.parsers.mesh_data import MeshData, MeshOptions
from gateway.files.parsers.mesh_data import Shape as ParsedShape
from gateway.runtime.workers.limited_process import ProcessFailed, ProcessLimits, call_limited
from gateway.scene.tree.geometry import Part, PointCloud, Shape, Surface
from gateway.scene.tree.materials import POINT_SIZE, TEXTURE_FIELDS
from gateway.scene.tree.nodes import Node
from gateway.scene.tree.transforms import IDENTITY, Y_UP_TO_Z_UP, Matrix, translation
from renderers.color import linear_colors_from_srgb, linear_from_srgb
from renderers.drawlist import AlphaMode, Image, ImageError, Material, Mesh, Texture
from renderers.images import image_from_bytes, image_header
from renderers.stop import check_stop

_GLTF_FORMATS: Final = frozenset({"gltf", "glb"})
FORMATS: Final = _GLTF_FORMATS | {"obj", "stl", "ply", "dae", "vtk"}
"""File name extensions that can be read."""
MESH_LIMITS: Final = GltfLimits(max_vertices=10_000_000, max_elements=10_000_000)
"""Default limits of the content of a mesh file. They hold for all formats."""

ReadReferencedFile = Callable[[str], bytes]
"""Function that returns the bytes of a file that a mesh file refers to; raises OSError or ValueError."""


@dataclass(frozen=True, slots=True)
class ParserLimits:
    """Limits of the child process that parses a mesh file, other than glTF; ``for_size`` computes them."""

    min_parser_bytes: int = 256 << 20
    """Memory for a small file, beyond that of the interpreter and its libraries."""
    parser_bytes_per_byte: int = 40
    """Further memory for each byte of the file: OBJ needs 20, the other formats less."""
    max_parser_bytes: int = 4 << 30
    """Memory for the largest files."""
    min_parser_seconds: int = 15
    """CPU time for a small file. Elapsed time may be four times as long."""
    parser_bytes_per_second: int = 4 << 20
    """Bytes of the file for each further second. On a quiet core OBJ is read at 22 MB/s, the other formats faster."""

    def for_size(self, file_bytes: int) -> ProcessLimits:
        """Return the limits for a file of this size."""
        memory_bytes = min(self.min_parser_bytes + self.parser_bytes_per_byte * file_bytes, self.max_parser_bytes)
        return ProcessLimits(memory_bytes, self.min_parser_seconds + file_bytes // self.parser_bytes_per_second)


PARSER_LIMITS: Final = ParserLimits()
PLAIN_MATERIAL: Final = Material(metallic=0.0, roughness=1.0, double_sided=True, point_size=POINT_SIZE)
"""White, diffuse and double-sided, as Director draws meshes and points without a material."""
_result_decoder: Final = msgspec.msgpack.Decoder(MeshData | str)
_texture_decoder: Final = msgspec.msgpack.Decoder(bytes)


class MeshFormatError(ValueError):
    """A file that cannot be parsed. The message does not name the file."""


def parse_mesh(
    data: bytes,
    extension: str,
    resolve: ReadReferencedFile,
    limits: GltfLimits,
    warnings: list[str],
    *,
    collada_up_axis: bool = True,
    gltf_up: Up = "auto",
    submesh: str = "",
) -> tuple[Part, ...]:
    """Return the parts of a mesh file, in metres and Z up.

    glTF is Y-up by its specification, except for files that Drake merged. COLLADA files state their unit and their up
    axis. Files of the other formats state neither; they are taken as metres and Z up. A file without materials is
    white (``PLAIN_MATERIAL``), so that callers can apply a colour. Textures that cannot be decoded are left out.

    Args:
        extension: One of ``FORMATS``.
        resolve: Returns the files of materials and textures. Those for which it raises OSError or ValueError are left
            out, with a warning.
        limits: Limits of glTF. Those on vertices, elements, instances and pixels hold for all formats.
        warnings: Sentences about content that is left out or repaired are appended to this list.
        collada_up_axis: False: COLLADA files are taken as Z up whatever they state, as robot software does.
        gltf_up: Up axis of glTF files; ``auto``: Y, but Z for files that Drake merged.
        submesh: Node of a COLLADA file or group of an OBJ file, by name, whose parts are returned; empty: all.

    Raises:
        MeshFormatError: The data does not have that format, has no geometry, or is beyond a limit.
        GltfError: The glTF document cannot be read.
        Exception: The current ``StopFlag`` was set, with its error.
    """
    if extension in _GLTF_FORMATS:
        parts = _parts_of_gltf(data, resolve, limits, warnings, gltf_up)
    else:
        options = MeshOptions(
            max_vertices=limits.max_vertices,
            max_elements=limits.max_elements,
            max_instances=limits.max_instances,
            max_drawn_elements=limits.max_drawn_elements,
            max_node_depth=limits.max_node_depth,
            use_up_axis=collada_up_axis,
            submesh=submesh,
        )
        mesh_data = _parse_in_child(data, extension, _with_warnings(resolve, warnings), options)
        warnings += mesh_data.warnings
        parts = _parts_of_mesh_data(mesh_data, limits)
    return without_broken_textures(parts, limits.max_total_image_pixels, warnings)


def with_default_materials(parts: Iterable[Part], plain: Material, textured: Material) -> tuple[Part, ...]:
    """Return parts with materials, for meshes without and with texture coordinates, in place of ``PLAIN_MATERIAL``.

    The file's own materials are kept, as in RViz.
    """

    def material_of(part: Part) -> Material:
        mesh = part.shape.mesh if isinstance(part.shape, Surface) else None
        has_own = part.material != PLAIN_MATERIAL or (mesh is not None and mesh.colors is not None)
        if has_own:
            return part.material
        return textured if mesh is not None and mesh.uv0 is not None else plain

    return tuple(msgspec.structs.replace(part, material=material_of(part)) for part in parts)


def _parts_of_gltf(
    data: bytes, resolve: ReadReferencedFile, limits: GltfLimits, warnings: list[str], up: Up
) -> tuple[Part, ...]:
    scene = read_gltf(data, resolve=resolve, limits=limits, decode_images=True, posted=up == "z")
    warnings += scene.warnings
    is_z_up = scene.is_z_up(up, warnings)
    parts: list[Part] = []
    stack: list[tuple[Node, Matrix]] = [(scene.root, IDENTITY if is_z_up else Y_UP_TO_Z_UP)]
    while stack:
        node, X_root_parent = stack.pop()
        X_root_node = X_root_parent @ node.matrix
        parts.extend(Part(part.shape, part.material, X_root_node @ part.X_node_part) for part in node.parts or ())
        stack.extend((child, X_root_node) for child in reversed(node.children.values()))
    return tuple(parts)


def decodable_texture(data: bytes) -> bytes:
    """Return the PNG file of an image in a format that mesh files may use, such as TGA; other data as they are.

    Raises the error of the current ``StopFlag`` when it is set.
    """
    try:
        image_header(data)
        return data
    except ImageError:
        pass
    limits = PARSER_LIMITS.for_size(len(data))
    try:
        return _texture_decoder.decode(
            call_limited("gateway.files.parsers.texture_files:read_texture", (data,), limits)
        )
    except ProcessFailed:
        return data


def _with_warnings(resolve: ReadReferencedFile, warnings: list[str]) -> ReadReferencedFile:
    """Return ``resolve`` with a warning about each file for which it raises an error.

    It takes several names of a file, separated by line ends. A file that is named by its path on another machine is
    looked for beside the mesh file.
    """

    def warn(text: str) -> None:
        if text not in warnings:
            warnings.append(text)

    def resolve_or_warn(names: str) -> bytes:
        name, *others = names.split("\n")
        try:
            return resolve(name)
        except (OSError, ValueError) as error:
            for other in others:
                with contextlib.suppress(OSError, ValueError):
                    return resolve(other)
            beside = name.replace("\\", "/").rpartition("/")[2]
            if beside != name:
                with contextlib.suppress(OSError, ValueError):
                    data = resolve(beside)
                    warn(f"{name[:120]!r} is missing, {beside[:120]!r} beside the file is used")
                    return data
            reason = error.strerror if isinstance(error, OSError) and error.strerror else str(error)
            warn(f"{name[:120]!r} is left out: {reason}")
            raise

    return resolve_or_warn


def _parse_in_child(data: bytes, extension: str, resolve: ReadReferencedFile, options: MeshOptions) -> MeshData:
    arguments, process_limits = (data, extension, options), PARSER_LIMITS.for_size(len(data))
    try:
        output = call_limited("gateway.files.parsers.mesh:read_mesh", arguments, process_limits, resolve)
        result: MeshData | str = _result_decoder.decode(output)
    except ProcessFailed as error:
        raise MeshFormatError(f"it cannot be read as {extension.upper()}: {error}") from None
    if isinstance(result, str):
        raise MeshFormatError(result)
    return result


def _parts_of_mesh_data(mesh_data: MeshData, limits: GltfLimits) -> tuple[Part, ...]:
    """Return a part for each instance. Its texture is not decoded yet, and perhaps damaged."""
    textures = [
        Texture(image_from_bytes(data, max_pixels=limits.max_image_pixels), name=name)
        for name, data in mesh_data.images
    ]
    shapes: list[Shape] = []
    materials: list[Material] = []
    for parsed in mesh_data.shapes:
        check_stop()
        shapes.append(_shape_of(parsed))
        material = PLAIN_MATERIAL if parsed.color is None else diffuse_material(np.array(parsed.color), None)
        if any(parsed.emission):
            r, g, b = np.clip(np.nan_to_num(parsed.emission), 0.0, 1.0).tolist()
            material = replace(material, emissive=(linear_from_srgb(r), linear_from_srgb(g), linear_from_srgb(b)))
        if parsed.image is not None:
            material = replace(material, base_color_texture=textures[parsed.image])
        materials.append(material)
    return tuple(
        Part(
            shapes[index],
            materials[index],
            np.frombuffer(X_node_shape, np.float64).reshape(4, 4) @ translation(*mesh_data.shapes[index].origin),
        )
        for index, X_node_shape in mesh_data.instances
    )


def _shape_of(parsed: ParsedShape) -> Shape:
    positions = np.frombuffer(parsed.positions, np.float32).reshape(-1, 3)
    colors: NDArray[np.float32] | None = None
    if parsed.colors is not None:
        colors = np.frombuffer(parsed.colors, np.uint8).reshape(-1, 4).astype(np.float32) / np.float32(255.0)
    if parsed.triangles is None:
        return PointCloud(positions, {} if colors is None else {"rgb": colors})
    triangles = np.frombuffer(parsed.triangles, np.uint32).reshape(-1, 3)
    uv = None if parsed.uv is None else np.frombuffer(parsed.uv, np.float32).reshape(-1, 2)
    if colors is not None:
        colors = linear_colors_from_srgb(colors)  # the files have sRGB colours, a Mesh has linear ones
    if parsed.normals is None:
        from gateway.scene.draw.crease_normals import with_creases  # here, because it loads kernels

        return Surface(with_creases(positions, triangles, uv=uv, colors=colors))
    normals = np.frombuffer(parsed.normals, np.float32).reshape(-1, 3)
    return Surface(Mesh(positions, triangles, normals=normals, uv0=uv, colors=colors))


def diffuse_material(color: NDArray[np.float64], texture: Texture | None) -> Material:
    """Return a diffuse material of an sRGB colour with opacity, (4,), of which a texture leaves the opacity only."""
    r, g, b, alpha = np.clip(np.nan_to_num(color), 0.0, 1.0).tolist()
    base = (1.0, 1.0, 1.0) if texture is not None else (linear_from_srgb(r), linear_from_srgb(g), linear_from_srgb(b))
    return Material(
        base_color=(*base, alpha),
        base_color_texture=texture,
        metallic=0.0,
        roughness=1.0,
        alpha_mode=AlphaMode.BLEND if alpha < 1.0 else AlphaMode.OPAQUE,
        double_sided=True,
    )


def without_broken_textures(parts: tuple[Part, ...], max_pixels: int, warnings: list[str]) -> tuple[Part, ...]:
    """Return the parts without textures that cannot be decoded, or are above ``max_pixels``; append warnings.

    A broken texture from one client must not break images for the other clients. Each texture is decoded once as a
    test; its pixels are not kept. Equal images count once.
    """
    is_usable: dict[Image, bool] = {}
    pixels_left = max_pixels
    materials: dict[Material, Material] = {}
    for material in dict.fromkeys(part.material for part in parts):
        fields: dict[str, Texture | None] = {field: getattr(material, field) for field in TEXTURE_FIELDS}
        textures = {field: texture for field, texture in fields.items() if texture is not None}
        for texture in textures.values():
            if texture.image in is_usable:
                continue
            try:
                height, width = texture.image.decode().shape[:2]
                problem = f"it has {height * width} pixels, and {pixels_left} are left to all textures"
                is_usable[texture.image] = height * width <= pixels_left
            except ImageError as error:
                problem, is_usable[texture.image] = str(error), False
            if is_usable[texture.image]:
                pixels_left -= height * width
            else:
                warnings.append(f"{texture.name[:120]!r} is left out: {problem}")
        broken = {field: None for field, texture in textures.items() if not is_usable[texture.image]}
        # mypy does not know that only textures, which may be None, are named.
        materials[material] = replace(material, **broken) if broken else material  # type: ignore[arg-type]
    if all(old is new for old, new in materials.items()):
        return parts
    return tuple(msgspec.structs.replace(part, material=materials[part.material]) for part in parts)
