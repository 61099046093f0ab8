"""A document exactly at a limit is read; one beyond it is refused with the limit's name."""

import json
from collections.abc import Callable

import numpy as np
import pytest

from gateway.files.gltf import GltfError, GltfLimits, read_gltf
from tests.files.gltf.builder import Builder, only_mesh
from tests.files.gltf.test_material_reader import png, with_texture


def triangles(count: int = 3) -> Builder:
    """Nodes that share one mesh."""
    b = Builder()
    mesh = b.triangle()
    for _ in range(count):
        b.node(mesh=mesh)
    return b


def chain(depth: int) -> Builder:
    b = Builder()
    for index in range(depth - 1):
        b.node(children=[index + 1])
    b.node(mesh=b.triangle())
    b.json["scenes"] = [{"nodes": [0]}]
    return b


def primitives(count: int) -> Builder:
    b = Builder()
    position = b.accessor(np.eye(3))
    b.node(mesh=b.mesh(*[{"attributes": {"POSITION": position}} for _ in range(count)]))
    return b


def separate_triangles(count: int) -> Builder:
    b = Builder()
    for z in range(count):
        b.draw(np.eye(3) + z)
    return b


def images(*sizes: tuple[int, int]) -> Builder:
    """A texture for each (height, width)."""
    b = with_texture(*(png((index, 0, 0), size) for index, size in enumerate(sizes)))
    for index in range(len(sizes)):
        material = {"pbrMetallicRoughness": {"baseColorTexture": {"index": index}}}
        b.draw(material=b.add("materials", material))
    return b


@pytest.mark.parametrize(
    ("make", "name", "limit"),
    [
        (triangles, "max_nodes", 3),
        (triangles, "max_instances", 3),
        (triangles, "max_drawn_elements", 3),
        (lambda: primitives(4), "max_primitives", 4),
        (lambda: separate_triangles(3), "max_vertices", 9),
        (lambda: separate_triangles(3), "max_elements", 3),
        (lambda: separate_triangles(3), "max_mesh_bytes", 3 * (3 * 72 + 12)),
        (lambda: images((4, 6)), "max_image_pixels", 24),
        (lambda: images((4, 6), (3, 7)), "max_total_image_pixels", 45),
    ],
)
def test_a_limit_is_the_largest_value_that_is_read(make: Callable[[], Builder], name: str, limit: int) -> None:
    make().read(limits=GltfLimits(**{name: limit}))
    with pytest.raises(GltfError, match=rf"{name} = {limit - 1}\b"):
        make().read(limits=GltfLimits(**{name: limit - 1}))


def test_the_limit_of_buffers_counts_decoded_bytes() -> None:
    b = separate_triangles(2)
    b.read(limits=GltfLimits(max_buffer_bytes=200))
    charged = sum(len(buffer["uri"]) * 3 // 4 for buffer in b.json["buffers"])
    b.read(limits=GltfLimits(max_buffer_bytes=charged))
    with pytest.raises(GltfError, match=rf"buffers\[1\]\.uri: .* max_buffer_bytes = {charged - 1}"):
        b.read(limits=GltfLimits(max_buffer_bytes=charged - 1))


def test_the_limits_of_the_json_text() -> None:
    text = json.dumps({"nodes": [{}] * 1000}).encode()
    read_gltf(text, limits=GltfLimits(max_json_bytes=len(text)))
    with pytest.raises(GltfError, match=f"max_json_bytes = {len(text) - 1}"):
        read_gltf(text, limits=GltfLimits(max_json_bytes=len(text) - 1))
    values = text.count(b",") + text.count(b"{") + text.count(b"[")
    read_gltf(text, limits=GltfLimits(max_json_values=values))
    with pytest.raises(GltfError, match=f"about {values} values, more than max_json_values = {values - 1}"):
        read_gltf(text, limits=GltfLimits(max_json_values=values - 1))


@pytest.mark.parametrize("count", [255, 300])
def test_an_index_beyond_the_vertices_is_refused_and_the_one_below_is_read(count: int) -> None:
    positions = np.random.default_rng(0).random((count, 3))
    Builder().draw(positions, [0, 1, count - 1]).read()
    path = r"meshes\[0\]\.primitives\[0\]\.indices: accessors\[1\]"
    with pytest.raises(GltfError, match=rf"{path} has the index {count}, but accessors\[0\] has {count} vertices"):
        Builder().draw(positions, [0, 1, count]).read()


@pytest.mark.parametrize("value", [-1e13, 1e38])
def test_large_positions_are_kept(value: float) -> None:
    scene = Builder().draw([(0, value, 0), (1, 0, 0), (0, 0, value)]).read()
    assert scene.warnings == ()
    assert only_mesh(scene).positions[0, 1] == np.float32(value)


@pytest.mark.parametrize("axis", range(3))
@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
def test_positions_that_are_not_finite_drop_their_triangles(axis: int, value: float) -> None:
    positions = np.vstack((np.eye(3), 2 * np.eye(3)))
    positions[4, axis] = value
    scene = Builder().draw(positions).read()
    assert scene.element_count == 1
    assert scene.warnings == ("meshes[0].primitives[0]: 1 elements with vertices that are not finite are left out",)
