"""Limits of documents, exceptions of the reader and their conversion to warnings, and checked access to arrays."""

from dataclasses import dataclass
from typing import Final, TypeVar

from renderers.drawlist import ImageError


@dataclass(frozen=True, slots=True)
class GltfLimits:
    """Limits of a document. The error message for a document beyond a limit has the limit's name and value."""

    max_json_bytes: int = 16 << 20
    """Size of the JSON text without embedded data URIs of 1 KiB and more. Drake's largest scenes (25 MB bodies) have
    about 0.3 MB."""
    max_json_values: int = 2_000_000
    """Commas, opening brackets and opening braces of that text, which are about as many as its values. A parsed value
    takes up to 200 bytes, so that the default allows 400 MB."""
    max_nodes: int = 100_000
    """Nodes of the scene; 30 times the largest robot cell seen."""
    max_node_depth: int = 256
    """Levels of nodes; kinematic chains have tens. Deeper nodes of glTF files become siblings of their ancestor at this
    depth. COLLADA files with deeper nodes are refused, since code that walks them recurses."""
    max_primitives: int = 100_000
    """Primitives of the meshes in use; reading one takes about 30 us."""
    max_instances: int = 200_000
    """Primitives of all nodes together; many nodes may share one mesh."""
    max_vertices: int = 20_000_000
    """Vertices of the meshes in use, each mesh counted once: a vertex takes up to 72 bytes."""
    max_draco_bytes: int = 2 << 30
    """Memory of the process that decompresses a document's Draco meshes, where the system can limit it. It takes 0.3 GB
    by itself, and some hundred bytes for each vertex."""
    max_elements: int = 20_000_000
    """Triangles, lines and points of the meshes in use, each mesh counted once: 12 bytes each."""
    max_drawn_elements: int = 10_000_000
    """Triangles, lines and points of all instances; many instances may share one mesh. Each takes about 210 bytes while
    it is rendered (vertices, edges, position in the image), so that the default allows 2 GB."""
    max_buffer_bytes: int = 512 << 20
    """Buffers and encoded images together, after base64 decoding."""
    max_mesh_bytes: int = 512 << 20
    """Arrays of the meshes. Many accessors can read the same bytes, so the size of the file does not limit them."""
    max_lights: int = 64
    """Nodes with a light (KHR_lights_punctual); every pixel is lit by all of them."""
    max_image_pixels: int = 64 << 20
    """Pixels of one image (8192 x 8192), read from its header before decoding: 256 MB of RGBA."""
    max_total_image_pixels: int = 256 << 20
    """Pixels of all images in use, each different image counted once."""


T = TypeVar("T")

MAX_WARNINGS: Final = 10_000
"""Maximum number of warnings that are kept: a document may have millions of flaws."""


class GltfError(ValueError):
    """A document that cannot be read. The message names the property, its value and the reason."""


class GltfLimitError(GltfError):
    """A document beyond one of ``GltfLimits``."""


class as_warning:  # noqa: N801  # used like the functions of contextlib, which take twice as long
    """Context in which a ``GltfError`` or an ``ImageError`` becomes a warning. A ``GltfLimitError`` stays an error."""

    __slots__ = ("_consequence", "_warnings")

    def __init__(self, warnings: list[str], consequence: str) -> None:
        """``consequence``: what is done instead, for the end of the warning that is appended."""
        self._warnings, self._consequence = warnings, consequence

    def __enter__(self) -> None:
        pass

    def __exit__(self, kind: object, error: BaseException | None, traceback: object) -> bool:
        if not isinstance(error, GltfError | ImageError) or isinstance(error, GltfLimitError):
            return False
        if len(self._warnings) < MAX_WARNINGS:
            self._warnings.append(f"{error}; {self._consequence}")
        return True


def checked_item(items: list[T | None] | None, index: object, array_name: str, path: str) -> T:
    """Return ``items[index]``, where ``index`` comes from the document.

    Raises GltfError with ``array_name`` and ``path``, the property that holds the index, if it is not an integer or out
    of range, or the item is null or invalid.
    """
    if type(index) is int and items is not None and 0 <= index < len(items):
        item = items[index]
        if isinstance(item, GltfError):  # from the parser, in place of an invalid object
            raise GltfError(str(item))
        if item is not None:
            return item
        raise GltfError(f"{path}: {array_name}[{index}] is null")
    raise GltfError(f"{path}: {index} is out of range ({len(items) if items else 0} {array_name})")
