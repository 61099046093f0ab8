"""Meshes: file format and surface."""

import io
from typing import Any

import numpy as np
import pytest
import trimesh
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp
from numpy.typing import NDArray

from gateway.adapters.stereo.device.profile import read_profile
from renderers.stereo.mesh.disparity_mesh import MeshOptions, disparity_mesh, smallest_bin_size
from renderers.stereo.model import Intrinsics
from tests.adapters.stereo.analytic import plane, sphere

MODEL = read_profile("rc_visard_160c").model
K = MODEL.intrinsics(6)


def encode(depth: NDArray[np.float32], k: Intrinsics = K) -> NDArray[np.uint16]:
    with np.errstate(divide="ignore"):
        return np.round(k.focal_length * MODEL.baseline / depth * 16).astype(np.uint16)


def read(parts: tuple[bytes, memoryview, memoryview]) -> tuple[list[str], NDArray[np.void], NDArray[np.uint32]]:
    """Return header lines, vertices and faces of a file in the vendor's layout."""
    data = b"".join(parts)
    end = data.index(b"end_header\n") + len(b"end_header\n")
    lines = data[:end].decode("ascii").splitlines()
    count, fields, faces = 0, [], 0
    for line in lines:
        words = line.split()
        if words[:2] == ["element", "vertex"]:
            count = int(words[2])
        elif words[:2] == ["element", "face"]:
            faces = int(words[2])
        elif words[0] == "property" and words[1] != "list":
            fields.append((words[2], {"float32": "<f4", "uint8": "u1"}[words[1]]))
    vertex = np.dtype(fields)
    face = np.dtype([("n", "u1"), ("i", "<u4", (3,))])
    assert len(data) == end + count * vertex.itemsize + faces * face.itemsize
    triangles = np.frombuffer(data, face, faces, end + count * vertex.itemsize)
    assert (triangles["n"] == 3).all()
    return lines, np.frombuffer(data, vertex, count, end), triangles["i"]


def points(vertices: NDArray[np.void]) -> NDArray[np.float64]:
    return np.stack([vertices[c] for c in "xyz"], axis=1).astype(np.float64)


def test_header_is_the_vendor_s() -> None:
    lines, _, _ = read(disparity_mesh(encode(plane(K, 0, 1.0)), K, MODEL.baseline, MeshOptions()))
    assert lines == [
        "ply",
        "format binary_little_endian 1.0",
        "comment Created with Scenegate",
        "comment Origin 0 0 0",
        "comment Camera [1 0 0; 0 1 0; 0 0 1] [0 0 0]",
        "element vertex 34240",
        "property float32 x",
        "property float32 y",
        "property float32 z",
        "property float32 scan_size",
        f"element face {213 * 159 * 2}",
        "property list uint8 uint32 vertex_indices",
        "end_header",
    ]


@pytest.mark.parametrize("options", [MeshOptions(), MeshOptions(max_points=3000), MeshOptions(3000, min_depth=True)])
def test_points_lie_on_the_true_surface(options: MeshOptions) -> None:
    k = MODEL.intrinsics(2)
    tolerance = 1 / 32
    focal_times_baseline = k.focal_length * MODEL.baseline
    d = encode(plane(k, 0, 1.5, 0.4, 0.2), k)
    d[20:60, 30:33] = 0  # bins with some pixels missing
    _, vertices, faces = read(disparity_mesh(d, k, MODEL.baseline, options))
    p = points(vertices)
    # On a plane z = 1.5 + 0.4 x + 0.2 y, up to the rounding of disparity.
    true = 1.5 / (1 - 0.4 * p[:, 0] / p[:, 2] - 0.2 * p[:, 1] / p[:, 2])
    assert np.abs(focal_times_baseline / p[:, 2] - focal_times_baseline / true).max() < tolerance * 1.01
    if options.max_points:
        assert len(p) <= 3000
    normals = np.cross(p[faces[:, 1]] - p[faces[:, 0]], p[faces[:, 2]] - p[faces[:, 0]])
    assert (np.einsum("ij,ij->i", normals, p[faces[:, 0]]) < 0).all(), "triangles face the camera"


def test_surfaces_are_cut_at_steps_and_holes() -> None:
    depth = np.minimum(plane(K, 0, 2.0), sphere(K, 0, (0, 0, 1.0), 0.3))
    d = encode(depth)
    d[10:20, 10:20] = 0
    _, vertices, faces = read(disparity_mesh(d, K, MODEL.baseline, MeshOptions()))
    z = vertices["z"][faces]
    step = K.focal_length * MODEL.baseline * (1 / z.min(axis=1) - 1 / z.max(axis=1))
    assert step.max() <= 2.0 + 1e-3
    assert len(vertices) == (d > 0).sum()
    assert ((z.max(axis=1) < 1.2) | (z.min(axis=1) > 1.6)).all(), "no triangle between sphere and wall"
    assert (z.max(axis=1) < 1.2).any()


@pytest.mark.parametrize(("step", "count", "triangles"), [(32, 9, 8), (33, 6, 4)])
def test_cells_are_connected_up_to_two_pixels(step: int, count: int, triangles: int) -> None:
    d = np.full((3, 3), 800, np.uint16)
    d[2] += step
    _, vertices, faces = read(disparity_mesh(d, Intrinsics(3, 3, 10.0, 1.5, 1.5), 0.1, MeshOptions()))
    assert (len(vertices), len(faces)) == (count, triangles)


def test_surfaces_of_few_points_are_whole_and_cut_at_steps() -> None:
    k = MODEL.intrinsics(1)
    d = encode(plane(k, 0, 1.5, 0.4, 1.0), k)  # 5.4 pixels from bin to bin
    d[: 13 * 36] = encode(plane(k, 0, 8.0), k)[: 13 * 36]
    _, vertices, faces = read(disparity_mesh(d, k, MODEL.baseline, MeshOptions(max_points=1000)))
    rows, columns = (-(-length // 36) for length in d.shape)
    assert len(vertices) == rows * columns
    assert len(faces) == 2 * (rows - 2) * (columns - 1), "all cells but those between the two surfaces"
    z = vertices["z"][faces]
    assert ((z.min(axis=1) > 7.9) | (z.max(axis=1) < 4.7)).all()


def test_watertight_is_one_surface_without_holes() -> None:
    d = encode(np.minimum(plane(K, 0, 2.0), sphere(K, 0, (0, 0, 1.0), 0.3)))
    d[10:20, 10:20] = 0
    d[:30] = 0
    d[:, :8] = 0
    d[100] = 0
    _, vertices, faces = read(disparity_mesh(d, K, MODEL.baseline, MeshOptions(watertight=True)))
    assert len(vertices) == d.size
    assert len(faces) == (K.width - 1) * (K.height - 1) * 2
    mesh = trimesh.Trimesh(points(vertices), faces, process=False)
    assert mesh.euler_number == 1, "a disc"
    # What was filled lies behind: the hole in the plane beside nothing nearer got the plane's depth.
    filled = vertices["z"].reshape(K.height, K.width)[10:20, 10:20]
    assert filled == pytest.approx(2.0, rel=0.02)


def test_colours_are_the_left_image_over_each_pixel() -> None:
    left = np.random.default_rng(1).integers(0, 256, (960, 1280, 3), np.uint8)
    d = encode(plane(K, 0, 1.0))
    lines, vertices, _ = read(disparity_mesh(d, K, MODEL.baseline, MeshOptions(textured=True), left))
    assert [l.split()[-1] for l in lines if "uint8" in l and "list" not in l] == [
        "diffuse_red", "diffuse_green", "diffuse_blue", "red", "green", "blue",
    ]  # fmt: skip
    pixel = vertices.reshape(K.height, K.width)[7, 11]
    mean = left[42:48, 66:72].reshape(-1, 3).mean(axis=0)
    for name, value in zip(("red", "green", "blue"), mean, strict=True):
        assert abs(int(pixel[name]) - value) <= 1
        assert pixel[f"diffuse_{name}"] == pixel[name]
    parts = disparity_mesh(d, K, MODEL.baseline, MeshOptions(textured=True), left)
    loaded: Any = trimesh.load(io.BytesIO(b"".join(parts)), file_type="ply", process=False)
    assert np.asarray(loaded.visual.vertex_colors)[7 * K.width + 11, :3].tolist() == [
        pixel["red"], pixel["green"], pixel["blue"],
    ]  # fmt: skip


def test_scan_size_is_the_footprint_of_a_pixel() -> None:
    _, vertices, _ = read(disparity_mesh(encode(plane(K, 0, 1.0)), K, MODEL.baseline, MeshOptions()))
    row = vertices.reshape(K.height, K.width)[80]
    assert row["scan_size"][50] == pytest.approx(2.8 * (row["x"][51] - row["x"][50]), rel=1e-3)


@given(st.integers(1, 700), st.integers(1, 700), st.integers(0, 10**6))
def test_bins_are_the_smallest_that_suffice(width: int, height: int, limit: int) -> None:
    n = smallest_bin_size(width, height, limit)
    if limit:
        assert -(-width // n) * -(-height // n) <= limit
        assert n == 1 or -(-width // (n - 1)) * -(-height // (n - 1)) > limit
    else:
        assert n == 1


@given(
    hnp.arrays(
        np.uint16,
        hnp.array_shapes(min_dims=2, max_dims=2, max_side=12),
        elements=st.sampled_from([0, 1, 16, 20, 65535]),
    ),
    st.sampled_from([0, 1, 4, 30]),
    st.booleans(),
    st.booleans(),
    st.booleans(),
)
def test_any_disparity_image_gives_a_valid_file(
    d: NDArray[np.uint16], max_points: int, min_depth: bool, watertight: bool, textured: bool
) -> None:
    height, width = d.shape
    k = Intrinsics(width, height, 10.0, width / 2, height / 2)
    left = np.zeros((height * 2, width * 2), np.uint8)
    options = MeshOptions(max_points, min_depth, watertight, textured)
    _, vertices, faces = read(disparity_mesh(d, k, 0.1, options, left))
    n = smallest_bin_size(width, height, max_points)
    columns, rows = -(-width // n), -(-height // n)
    assert len(vertices) <= rows * columns
    if watertight:
        assert len(vertices) == (rows * columns if d.any() and min(rows, columns) > 1 else 0)
    assert (np.unique(faces) == np.arange(len(vertices))).all(), "vertices that no face uses"
    if len(faces):
        first, second, third = (points(vertices)[faces[:, corner]] for corner in range(3))
        assert (np.linalg.det(np.stack((first, second, third), axis=1)) < 0).all(), "faces the camera"
        assert (faces[:, 0] != faces[:, 1]).all()
        assert (faces[:, 1] != faces[:, 2]).all()
        assert (faces[:, 0] != faces[:, 2]).all()
    assert np.isfinite(points(vertices)).all()
    assert (vertices["z"] > 0).all()
