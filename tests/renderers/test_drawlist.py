"""Draw lists: meshes, instance sets, used vertices and names in errors."""

import numpy as np
import pytest

from renderers.drawlist import (
    DrawList,
    ImageError,
    Instance,
    InstanceSet,
    Material,
    Mesh,
    PosedInstances,
    Topology,
    name_image_errors,
    used_vertices,
)


@pytest.mark.parametrize("rows", [0, 2, 500])
@pytest.mark.parametrize("count", [7, 47, 48, 49, 50, 1000, 100_000])
def test_used_vertices_are_those_of_a_sort(rows: int, count: int) -> None:
    """Both ways, for few and for many vertices per index, give the same."""
    elements = np.random.default_rng(count).integers(0, count, (rows, 3), np.uint32)
    used, compact = used_vertices(elements, count)
    expected, places = np.unique(elements, return_inverse=True)
    assert np.array_equal(used, expected)
    assert np.array_equal(compact, places.reshape(elements.shape))
    assert (used.dtype, compact.dtype, compact.flags.c_contiguous) == (np.dtype(np.intp), np.dtype(np.uint32), True)


@pytest.mark.parametrize("topology", Topology)
def test_mesh_properties(topology: Topology) -> None:
    positions, elements = np.zeros((4, 3), np.float32), np.zeros((2, topology.value), np.uint32)
    assert Mesh(positions, elements).topology is topology
    assert Mesh(positions, elements).nbytes == 48 + 8 * topology.value
    optional = {"normals": 3, "uv0": 2, "uv1": 2, "colors": 4, "tangents": 4}
    for name, columns in optional.items():
        array = np.zeros((4, columns), np.float32)
        assert Mesh(positions, elements, **{name: array}).nbytes == 48 + 8 * topology.value + 16 * columns


def posed(count: int) -> PosedInstances:
    meshes = tuple(Mesh(np.zeros((1, 3), np.float32), np.zeros((1, 1), np.uint32)) for _ in range(count))
    materials = tuple(Material(roughness=k / 8) for k in range(count))
    poses = np.arange(16.0 * count).reshape(count, 4, 4)
    return PosedInstances(InstanceSet(meshes, materials, tuple(range(10, 10 + count))), poses)


def same(a: Instance, b: Instance) -> bool:
    poses = np.array_equal(a.X_world_mesh, b.X_world_mesh)
    return poses and (a.mesh, a.material, a.label, a.instance_id) == (b.mesh, b.material, b.label, b.instance_id)


def test_posed_instances_are_a_sequence() -> None:
    instances = posed(4)
    assert len(instances) == 4
    second = instances[1]
    assert (second.mesh, second.material) == (instances.set.meshes[1], instances.set.materials[1])
    assert (second.label, second.instance_id) == (11, 1)
    np.testing.assert_array_equal(second.X_world_mesh, np.arange(16.0, 32.0).reshape(4, 4))
    assert same(instances[-3], second)
    assert [each.label for each in instances] == [10, 11, 12, 13]
    assert [each.instance_id for each in instances[1:4:2]] == [1, 3]
    assert all(same(a, b) for a, b in zip(instances, instances[:], strict=True))
    with pytest.raises(IndexError):
        _ = instances[4]


@pytest.mark.parametrize("shape", [(1, 4, 4), (3, 4, 4), (2, 4, 3), (2, 16)])
def test_poses_must_fit_the_set(shape: tuple[int, ...]) -> None:
    with pytest.raises(ValueError, match=r"2 instances cannot have poses of shape \("):
        PosedInstances(posed(2).set, np.zeros(shape))


def test_draw_lists_that_differ_in_poses_have_one_identity() -> None:
    instances = posed(2)
    moved = PosedInstances(instances.set, instances.X_world_mesh + 1.0)
    assert DrawList(instances).identity is DrawList(moved).identity is instances.set
    plain = DrawList(tuple(instances))
    assert plain.identity is plain


@pytest.mark.parametrize(("name", "message"), [("wood", "wood: torn"), ("", "image: torn")])
def test_errors_get_the_name_of_the_image(name: str, message: str) -> None:
    with pytest.raises(ImageError) as raised, name_image_errors(name):
        raise ImageError("torn")
    assert str(raised.value) == message
    with pytest.raises(ValueError, match=r"^other$"), name_image_errors(name):
        raise ValueError("other")
