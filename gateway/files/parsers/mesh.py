"""Reads mesh files: COLLADA with pycollada, OBJ, STL, PLY and VTK with our own parsers."""

import re
from typing import Any, Final

import msgspec
import numpy as np
import numpy.ma  # np.unique imports it, which would take 0.2 s in each child process

from gateway.files.parsers.collada import read_collada
from gateway.files.parsers.mesh_data import MeshData, MeshFaultError, MeshOptions, Shape, as_utf8, shape_of
from gateway.files.parsers.obj import read_obj
from gateway.files.parsers.ply import read_ply
from gateway.files.parsers.stl import read_stl
from gateway.files.parsers.texture_files import ReadFile, TextureFiles
from gateway.files.parsers.vtk import read_vtk

_NOT_FINITE: Final = re.compile(rb"1\.#(?:IND|INF|QNAN|SNAN)\d*")
"""Numbers that are not finite, as programs of Visual Studio before 2015 print them."""


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
    """Make all shapes opaque if each has an opacity of 0: exporters write that for opaque meshes and faces."""
    if all(map(_is_invisible, content.shapes)):
        for shape in content.shapes:
            if shape.color is not None:
                shape.color = (*shape.color[:3], 1.0)
            if shape.colors is not None:
                shape.colors = (
                    np.frombuffer(shape.colors, np.uint32) | np.frombuffer(b"\0\0\0\xff", np.uint32)
                ).tobytes()
        content.warnings.append("all its colours have an opacity of 0; it is drawn opaque")


def _is_invisible(shape: Shape) -> bool:
    if shape.colors is not None and not np.frombuffer(shape.colors, np.uint8)[3::4].any():
        return True
    return shape.color is not None and shape.color[3] <= 0.0


def _read(read_file: ReadFile, data: bytes, extension: str, options: MeshOptions) -> MeshData:
    if extension == "dae":
        return read_collada(data, read_file, options)
    data = as_utf8(data)
    if b"1.#" in data:
        data = _NOT_FINITE.sub(lambda number: b"nan".ljust(len(number[0])), data)
    content = MeshData()
    textures = TextureFiles(read_file, content)
    if extension == "obj":
        read_obj(data, read_file, textures, options, content)
        return content
    if extension == "ply":
        content.shapes = read_ply(data, textures, options, content)
        content.instances = [(number, np.eye(4).tobytes()) for number in range(len(content.shapes))]
        return content
    if extension == "stl":
        positions, colors = read_stl(data, options.max_elements, content.warnings)
        triangles = np.arange(len(positions)).reshape(-1, 3)
        shape = shape_of(positions, triangles, content.warnings, colors=colors)
    else:
        positions, vtk_triangles, colors = read_vtk(data, options.max_vertices, options.max_elements, content.warnings)
        shape = shape_of(positions, vtk_triangles, content.warnings, colors=colors)
    if shape is not None:
        content.shapes, content.instances = [shape], [(0, np.eye(4).tobytes())]
    return content
