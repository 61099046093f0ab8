"""Random geometry for the state tests, and its exact description for comparisons."""

import dataclasses
from collections.abc import Mapping
from enum import Enum
from typing import Any

import msgspec
import numpy as np
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from gateway.scene.tree.geometry import Line, Part, PointCloud, Shape, Surface
from gateway.scene.tree.nodes import Node, Path
from gateway.scene.tree.transforms import IDENTITY
from renderers.drawlist import AlphaMode, Image, Light, LightKind, Material, Mesh, Sampler, Texture, Wrap
from renderers.encode import png_rgba
from renderers.images import image_from_bytes
from tests.support.solids import solids

numbers = st.floats(allow_nan=True, allow_infinity=True)
sizes = st.floats(0.0, 1e6)
triples = st.tuples(sizes, sizes, sizes)
names = st.text(st.characters(), max_size=8)
"""Includes lone surrogates, which JSON allows in names."""


def floats32(*shape: int) -> st.SearchStrategy[Any]:
    return hnp.arrays(np.float32, shape, elements=st.floats(-1e3, 1e3, width=32))


@st.composite
def clouds(draw: st.DrawFn) -> PointCloud:
    count = draw(st.integers(0, 200))
    channels = draw(
        st.dictionaries(names, st.sampled_from([(count,), (count, 3)]).flatmap(lambda s: floats32(*s)), max_size=2)
    )
    return PointCloud(draw(floats32(count, 3)), channels)


@st.composite
def meshes(draw: st.DrawFn) -> Mesh:
    count, corners = draw(st.integers(1, 60)), draw(st.sampled_from([1, 2, 3]))
    elements = draw(hnp.arrays(np.uint32, (draw(st.integers(0, 60)), corners), elements=st.integers(0, count - 1)))
    optional = {
        name: draw(st.none() | floats32(count, width))
        for name, width in {"normals": 3, "uv0": 2, "uv1": 2, "colors": 4, "tangents": 4}.items()
    }
    return Mesh(draw(floats32(count, 3)), elements, **optional)


@st.composite
def images(draw: st.DrawFn) -> Image:
    pixels = draw(hnp.arrays(np.uint8, (draw(st.integers(1, 9)), draw(st.integers(1, 9)), 4)))
    if draw(st.booleans()):
        return Image(b"pixels", lambda: pixels)
    return image_from_bytes(png_rgba(pixels))


textures = st.builds(
    Texture,
    images(),
    st.builds(Sampler, st.sampled_from(Wrap), st.sampled_from(Wrap), st.booleans()),
    st.sampled_from([0, 1]),
    st.none() | st.tuples(*[sizes] * 6),
    names,
)
materials = st.builds(
    Material,
    base_color=st.tuples(*[st.floats(0, 1)] * 4),
    base_color_texture=st.none() | textures,
    roughness=st.floats(0, 1),
    emissive=triples,
    alpha_mode=st.sampled_from(AlphaMode),
    double_sided=st.booleans(),
    point_size=sizes,
)
shapes: st.SearchStrategy[Shape] = st.one_of(
    solids(numbers),
    st.builds(Surface, meshes()),
    clouds(),
    st.builds(
        Line,
        st.integers(0, 40).flatmap(lambda n: floats32(n, 3)),
        sizes,
        st.booleans(),
        st.booleans(),
        head_length=st.none() | sizes,
    ),
    st.builds(Light, st.sampled_from(LightKind), triples, sizes, range=st.none() | sizes),
)
matrices = hnp.arrays(np.float64, (4, 4), elements=st.floats(-1e3, 1e3))
parts = st.builds(Part, shapes, materials, st.just(IDENTITY) | matrices, names, names)


def described(value: Any) -> Any:
    """Return a value as plain data: types, shapes and all bits of all numbers."""
    if isinstance(value, np.ndarray):
        return ("array", value.dtype.str, value.shape, np.ascontiguousarray(value).tobytes())
    if isinstance(value, float):
        return np.float64(value).tobytes()
    if isinstance(value, Image):
        return ("image", described(value.decode()))
    if isinstance(value, Enum):
        return value
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        fields = [(field.name, described(getattr(value, field.name))) for field in dataclasses.fields(value)]
        return (type(value).__name__, fields)
    if isinstance(value, msgspec.Struct):
        return (type(value).__name__, [(name, described(getattr(value, name))) for name in value.__struct_fields__])
    if isinstance(value, Mapping):
        return [(described(key), described(entry)) for key, entry in value.items()]
    if isinstance(value, tuple):
        return tuple(described(entry) for entry in value)
    return (type(value).__name__, value)


def tree(root: Node, excluded: tuple[Path, ...] = ()) -> list[Any]:
    """Return a tree as plain data, in the order of its nodes."""
    found = []
    for path, node in root.walk():
        if any(path[: len(other)] == other for other in excluded):
            continue
        pose = node.pose
        transform = ("pose", described(pose)) if pose is not None else ("matrix", described(node.matrix))
        hidden = sum(c.nodes_with_parts for name, c in node.children.items() if (*path, name) in excluded)
        own = described(node.parts), transform, (node.visible, node.opacity), node.nodes_with_parts - hidden
        found.append(([(type(e), e) for e in path], own))
    return found
