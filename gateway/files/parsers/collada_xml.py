"""Checks the XML of COLLADA files, and rewrites what pycollada refuses, misreads or passes over."""

import contextlib
import re
from typing import Any, Final
from xml.etree import ElementTree
from xml.parsers import expat

import numpy as np
from numpy.typing import NDArray

from gateway.files.parsers.mesh_data import MeshFaultError

MAX_ELEMENTS: Final = 1_000_000
"""Maximum number of XML elements: each takes up to 1 kB while the file is read. Large scenes have some thousands."""
MAX_XML_DEPTH: Final = 512
"""Maximum depth of XML elements: 256 levels of nodes, and the elements inside the last one."""
_OF_PROFILES: Final = ("}image", "}newparam")
_EFFECT: Final = re.compile(rb"<(?:\w+:)?effect\b")
_IMAGE: Final = re.compile(rb"<(?:\w+:)?(?:image|newparam)\b")
_ACCESSOR: Final = re.compile(rb"<(?:\w+:)?accessor\b")
_ARRAY: Final = re.compile(rb"<(?:\w+:)?\w+_array\b")
_STRIDE: Final = re.compile(rb"""\bstride\s*=\s*["']0*(\d+)""")
RINGS: Final = "rings"
"""Attribute of polygons that had holes, see ``with_known_elements``."""


def checked_document(data: bytes) -> bytes:
    """Return a document without what follows it: some exporters leave rests of older files.

    Raises MeshFaultError if size or depth is beyond a limit, before a tree is built, or it is no XML.
    """
    parser = expat.ParserCreate()
    count = depth = last_tag = 0

    def start(name: str, attributes: dict[str, str]) -> None:
        nonlocal count, depth
        count, depth = count + 1, depth + 1
        if count > MAX_ELEMENTS or depth > MAX_XML_DEPTH:
            raise MeshFaultError(f"it has more than {MAX_ELEMENTS} XML elements, or more than {MAX_XML_DEPTH} levels")

    def end(name: str) -> None:
        nonlocal depth, last_tag
        depth, last_tag = depth - 1, parser.CurrentByteIndex

    def doctype(*_: object) -> None:
        raise MeshFaultError("COLLADA documents with a DOCTYPE are refused")

    parser.StartElementHandler, parser.EndElementHandler, parser.StartDoctypeDeclHandler = start, end, doctype
    try:
        parser.Parse(data, True)
    except expat.ExpatError as error:
        if depth > 0 or count == 0:
            raise MeshFaultError(f"it cannot be read as DAE: {error}") from None
        return data[: data.find(b">", last_tag) + 1]
    return data


def with_known_elements(data: bytes) -> bytes:
    """Return a document without what makes pycollada leave out a mesh or a polygon, or misplace a node.

    It refuses a mesh that also has ``<linestrips>``, and passes over polygons with holes (``<ph>``): they become ones
    without, whose attribute ``RINGS`` has the number of indices in the outline and in each hole. Its matrix of a
    ``<lookat>`` is transposed. Images and parameters of an effect are found in its profile only. It takes
    all values of a source's own array, whatever its accessor says.
    """
    starts_of_effects = [effect.partition(b"profile_COMMON")[0] for effect in _EFFECT.split(data)[1:]]
    accessors = [accessor.partition(b"accessor>")[0] for accessor in _ACCESSOR.split(data)[1:]]
    has_others = len(accessors) > len(_ARRAY.findall(data)) or any(map(_selects, accessors))
    if not (
        has_others
        or any(word in data for word in (b"linestrips", b"ph>", b"lookat"))
        or any(map(_IMAGE.search, starts_of_effects))
    ):
        return data
    root = ElementTree.fromstring(data)  # noqa: S314 - checked_document refused what could be dangerous
    for effect in root.findall(".//{*}effect[{*}profile_COMMON]"):
        effect.findall("./{*}profile_COMMON")[0][:0] = [child for child in effect if child.tag.endswith(_OF_PROFILES)]
        effect[:] = [child for child in effect if not child.tag.endswith(_OF_PROFILES)]
    if has_others:
        _copy_selected_values(root)
    for parent in root.iter():
        for child in parent.findall("./{*}ph"):
            rings = [(ring.text or "").split() for ring in child]
            if any(rings):
                polygon = ElementTree.SubElement(parent, child.tag.replace("}ph", "}p"))
                polygon.text = " ".join(index for ring in rings for index in ring)
                polygon.set(RINGS, " ".join(str(len(ring)) for ring in rings))
        if parent.find("./{*}ph") is not None or parent.find("./{*}linestrips") is not None:
            parent[:] = [child for child in parent if not child.tag.endswith(("}ph", "}linestrips"))]
        for child in parent.findall("./{*}lookat"):
            with contextlib.suppress(ValueError):
                numbers = np.array((child.text or "").replace(",", ".").split(), np.float64).reshape(3, 3)
                child.text = " ".join(map(str, _looking_at(*numbers).ravel().tolist()))
                child.tag = child.tag.replace("}lookat", "}matrix")
    return ElementTree.tostring(root)


def _selects(accessor: bytes) -> bool:
    """Return True if an accessor may not select all values of its array."""
    stride = _STRIDE.search(accessor)
    return b"offset" in accessor or accessor.count(b"name") != int(stride[1] if stride else 1)


def _copy_selected_values(root: ElementTree.Element) -> None:
    """Give each source the values of its named components as an array of its own: it may select a part of another's."""
    arrays = {f"#{array.get('id')}": (array.text or "").split() for array in root.iterfind(".//{*}float_array")}
    for source in root.iterfind(".//{*}source[{*}technique_common]"):
        accessor = source.find("./{*}technique_common/{*}accessor")
        values = None if accessor is None else arrays.get(accessor.get("source", ""))
        if accessor is None or values is None:
            continue
        params = accessor.findall("./{*}param")
        named = [number for number, param in enumerate(params) if param.get("name")]
        offset, stride = int(accessor.get("offset", 0)), int(accessor.get("stride", 1))
        if not named or offset < 0 or stride <= named[-1] or params[0].get("type") == "float4x4":
            continue
        array = source.find("./{*}float_array")
        if array is None:
            array = ElementTree.SubElement(source, accessor.tag.removesuffix("accessor") + "float_array")
        starts = range(offset, len(values) - named[-1], stride)[: int(accessor.get("count", len(values)))]
        array.text = " ".join(values[start + number] for start in starts for number in named)
        for number in set(range(len(params))).difference(named):
            accessor.remove(params[number])


def _looking_at(eye: NDArray[Any], target: NDArray[Any], up: NDArray[Any]) -> NDArray[np.float64]:
    """Return the (4, 4) pose of a frame at ``eye`` whose -z axis points at ``target``."""
    z = eye - target
    x = np.cross(up, z)
    X = np.eye(4)
    X[:3] = np.column_stack([axis / np.linalg.norm(axis) for axis in (x, np.cross(z, x), z)] + [eye])
    return X


def with_images_of_samplers(data: bytes) -> bytes:
    """Return a document whose textures name images in place of samplers that name no surface.

    COLLADA 1.5 has no surfaces, and files of images in ``<ref>``. Files of 1.4 may name a surface that they do not
    have, and in ``<texture>`` an image.
    """
    root = ElementTree.fromstring(data)  # noqa: S314 - checked_document refused what could be dangerous
    for source in root.findall(".//{*}init_from"):
        source.text = source.findtext("./{*}ref") or source.text
    for profile in root.findall("./{*}library_effects/{*}effect/{*}profile_COMMON"):
        params = [(parent, param) for parent in profile.iter() for param in parent.findall("./{*}newparam")]
        surfaces = {param.get("sid") for _, param in params if param.find("./{*}surface") is not None}
        images: dict[str | None, str] = {}
        lost = set()
        for _, param in params:
            sampler = param.find("./{*}sampler2D")
            if sampler is not None and sampler.findtext("./{*}source") not in surfaces:
                lost.add(param)
                for image in sampler.findall("./{*}instance_image"):
                    images[param.get("sid")] = image.get("url", "").removeprefix("#")
        for parent in {parent for parent, _ in params}:
            parent[:] = [child for child in parent if child not in lost]
        for texture in profile.findall(".//{*}texture"):
            name = texture.get("texture", "")
            texture.set("texture", images.get(name, name))
    return ElementTree.tostring(root)


def without_lost_materials(document: Any, data: bytes) -> bytes:
    """Return a document without references to materials that could not be read: pycollada leaves out their meshes."""
    root = ElementTree.fromstring(data)  # noqa: S314 - checked_document refused what could be dangerous
    known = {f"#{material.id}" for material in document.materials}
    for parent in root.iter():
        for child in list(parent):
            if child.tag.endswith("}instance_material") and child.get("target") not in known:
                parent.remove(child)
    return ElementTree.tostring(root)
