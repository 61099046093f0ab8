"""Read the geometry type ``mesh_file``: a file that the viewer opens, or the content of one."""

import re
from pathlib import PurePosixPath
from typing import Any, Final

import msgspec
import numpy as np

from gateway.adapters.treeviewer.context import ReadContext
from gateway.adapters.treeviewer.fields import is_unicode
from gateway.adapters.treeviewer.images import check_image, file_content
from gateway.files.assets.mesh_formats import (
    FORMATS,
    MESH_LIMITS,
    MeshFormatError,
    decodable_texture,
    diffuse_material,
    parse_mesh,
    with_default_materials,
)
from gateway.files.gltf import GltfError
from gateway.scene.tree.geometry import Part
from gateway.scene.tree.materials import WHITE, Color, tinted
from gateway.scene.tree.transforms import scaling
from renderers.drawlist import ImageError, Texture
from scenegate.messages.field_kinds import CommandError, NothingToDraw, read_color, show
from scenegate.messages.mesh_file import MAX_FILES, spellings
from scenegate.warning_text import NOTHING_DRAWN

_ABSOLUTE: Final = re.compile(r"[/\\]|[A-Za-z][A-Za-z0-9+.-]*:")
"""Start of a file's path on another machine, or of its URL."""


def mesh_file(
    rgba: Color, context: ReadContext, *, filename: str, scale: Any, data: Any, **sent_fields: Any
) -> tuple[Part, ...]:
    """Return the parts of a mesh file with the command's colour."""
    context.require_thread()
    if not is_unicode(filename):  # it becomes the part's source, which pages and state files contain
        raise CommandError(f"filename is not Unicode text: {show(filename)}")
    xyz = (scale,) * 3 if isinstance(scale, float) else scale
    parts = (
        _parts_of_opened(filename, xyz, context)
        if data is None
        else _parts_of_sent(filename, xyz, context, data, **sent_fields)
    )
    return tuple(
        msgspec.structs.replace(part, material=tinted(part.material, rgba), source=part.source or filename)
        for part in parts
    )


def _parts_of_opened(filename: str, scale: tuple[float, float, float], context: ReadContext) -> tuple[Part, ...]:
    """Return the parts of a file on this machine."""
    if context.meshes is None:
        raise CommandError("filename: no folder of mesh files is open to clients")
    try:
        return context.meshes.load(filename, scale, context.warnings)
    except (ValueError, OSError) as error:
        if getattr(error, "missing", isinstance(error, FileNotFoundError)):
            raise NothingToDraw(f"{error}, {NOTHING_DRAWN}") from None
        reason = error.strerror if isinstance(error, OSError) else error  # without a path, for clients
        raise CommandError(f"filename: {reason}") from None


def _parts_of_sent(
    filename: str,
    scale: tuple[float, float, float],
    context: ReadContext,
    data: Any,
    files: Any,
    up: Any,
    default_color: Any,
    default_texture: Any,
) -> tuple[Part, ...]:
    """Return the parts of a file in the command. What cannot be read is left out, with a warning."""
    extension = PurePosixPath(filename).suffix[1:].lower()
    if extension not in FORMATS:
        raise NothingToDraw(f"{show(filename)} is not a file of a known format ({', '.join(sorted(FORMATS))})")
    file_by_name = files or {}
    if not isinstance(file_by_name, dict) or len(file_by_name) > MAX_FILES:
        raise CommandError(f"files must be an object of at most {MAX_FILES} files, not {show(file_by_name)}")
    if up not in (None, "z"):
        raise CommandError(f"up must be 'z' or missing, not {show(up)}")

    # glTF asks only for the last part of a path on another machine.
    elsewhere = {
        spellings(name)[-1].rpartition("/")[2]: sent
        for name, sent in file_by_name.items()
        if isinstance(name, str) and _ABSOLUTE.match(name)
    }

    def resolve(name: str) -> bytes:
        for spelling in spellings(name):
            if spelling in file_by_name:
                return file_content(file_by_name[spelling], "files")
        if name in elsewhere:
            return file_content(elsewhere[name], "files")
        raise FileNotFoundError(2, "it was not sent; clients leave out what they cannot read", name)

    warnings: list[str] = []
    try:
        content = file_content(data, "data")
        parts = parse_mesh(
            content,
            extension,
            resolve,
            MESH_LIMITS,
            warnings,
            collada_up_axis=up is None,
            gltf_up="z" if up else "auto",
        )
    except (MeshFormatError, GltfError) as error:
        raise NothingToDraw(f"{show(filename)}: {error}, {NOTHING_DRAWN}") from None
    context.warnings += [f"{show(filename)}: {text}" for text in warnings]
    if default_color is not None or default_texture is not None:
        color = np.array(WHITE if default_color is None else read_color(default_color, "default_color", context))
        texture = None
        if default_texture is not None:
            try:
                content = decodable_texture(file_content(default_texture, "default_texture"))
                image = check_image(content, context.limits.image_pixels).image
                texture = Texture(image, name="default_texture")
            except ImageError as error:
                context.warnings.append(f"default_texture cannot be decoded: {error}; it is not shown")
        plain = diffuse_material(color, None)
        parts = with_default_materials(parts, plain, plain if texture is None else diffuse_material(color, texture))
    X = scaling(*scale)
    return tuple(msgspec.structs.replace(part, X_node_part=X @ part.X_node_part) for part in parts)
