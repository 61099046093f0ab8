"""Point clouds: fields, colours, rows, damage."""

import numpy as np
import pytest
from numpy.typing import NDArray

from gateway.adapters.drakeviewer.wire import MessageError
from gateway.scene.tree.geometry import PointCloud
from tests.adapters.drakeviewer.conftest import Viewer
from tests.adapters.drakeviewer.encoding import cloud

CHANNEL = "DRAKE_POINT_CLOUD"
XYZ = [("x", 0, 7, 1), ("y", 4, 7, 1), ("z", 8, 7, 1)]
RGB = ("rgb", 12, 6, 1)
NORMALS = [("normal_x", 16, 7, 1), ("normal_y", 20, 7, 1), ("normal_z", 24, 7, 1)]
POINTS = np.array([[1, 2, 3], [4, 5, 6]], np.float32)


def shown(viewer: Viewer, name: str = "default") -> PointCloud:
    (part,) = viewer.node("point clouds", name).parts or ()
    assert isinstance(part.shape, PointCloud)
    return part.shape


def colored(normals: int = 0) -> NDArray[np.void]:
    fields = [("xyz", "<f4", 3), ("rgb", "u1", 4), ("n", "<f4", normals)]
    points = np.zeros(2, fields)
    points["xyz"] = POINTS
    points["rgb"] = [(255, 0, 51, 9), (0, 102, 255, 9)]
    return points


@pytest.mark.parametrize(("channel", "name"), [(CHANNEL, "default"), (f"{CHANNEL}_FOO", "FOO"), (f"{CHANNEL}2", "2")])
def test_points_and_names(viewer: Viewer, channel: str, name: str) -> None:
    viewer.handle(channel, cloud(POINTS.tobytes(), 2, XYZ, 12))
    assert shown(viewer, name).points.tolist() == POINTS.tolist()
    assert not shown(viewer, name).channels


@pytest.mark.parametrize("normals", [0, 3])
def test_colors_with_and_without_normals(viewer: Viewer, normals: int) -> None:
    fields = [*XYZ, RGB, *NORMALS[:normals]]
    viewer.handle(CHANNEL, cloud(colored(normals).tobytes(), 2, fields, 16 + 4 * normals))
    np.testing.assert_allclose(shown(viewer).channels["rgb"], [(1, 0, 0.2), (0, 0.4, 1)])


@pytest.mark.parametrize("columns", [(0, 1, 2), (2, 0, 1)])
def test_doubles_big_endian_rows_and_gaps(viewer: Viewer, columns: tuple[int, int, int]) -> None:
    data = np.zeros((2, 5, 4), ">f8")
    values = np.arange(12.0).reshape(2, 2, 3)
    data[:, :2, columns] = values
    x, y, z = columns
    fields = [("z", 8 * z, 8, 1), ("x", 8 * x, 8, 1), ("y", 8 * y, 8, 1), ("other", 24, 3, 2)]
    viewer.handle(CHANNEL, cloud(data.tobytes(), 2, fields, 32, 2, 160, 1))
    assert shown(viewer).points.tolist() == values.reshape(-1, 3).tolist()


@pytest.mark.parametrize("coordinate", [np.nan, np.inf, -np.inf, 1e30, -1e30])
def test_points_that_are_not_finite_or_far_away_are_left_out(viewer: Viewer, coordinate: float) -> None:
    points = colored()
    points["xyz"][0, 1] = coordinate
    viewer.handle(CHANNEL, cloud(points.tobytes(), 2, [*XYZ, RGB], 16, flags=0))
    assert shown(viewer).points.tolist() == [[4, 5, 6]]
    np.testing.assert_allclose(shown(viewer).channels["rgb"], [(0, 0.4, 1)])


@pytest.mark.parametrize(("width", "height"), [(0, 1), (0, 2**62), (2**62, 0)])
def test_a_cloud_without_points(viewer: Viewer, width: int, height: int) -> None:
    viewer.handle(CHANNEL, cloud(b"", width, [*XYZ, RGB], 16, height, row_step=0))
    assert shown(viewer).points.shape == (0, 3)


def test_colors_that_cannot_be_read_leave_the_points(viewer: Viewer) -> None:
    problem = viewer.problem(CHANNEL, cloud(bytes(32), 2, [*XYZ, ("rgb", 12, 1, 1)], 16))
    assert "rgb has the type 1 and 1 values instead of 4 bytes, so the points are white" in problem
    assert (shown(viewer).points.shape, dict(shown(viewer).channels)) == ((2, 3), {})


def test_a_cloud_without_fields_and_points_replaces_another(viewer: Viewer) -> None:
    viewer.handle(CHANNEL, cloud(POINTS.tobytes(), 2, XYZ, 12))
    assert viewer.problem(CHANNEL, cloud(b"", 0, [], 0)) == ""
    assert shown(viewer).points.shape == (0, 3)


@pytest.mark.parametrize(
    ("message", "reason"),
    [
        (cloud(bytes(24), 2, XYZ[:2], 12), "no field z, only x, y"),
        (cloud(bytes(23), 2, XYZ, 12), "have 23 bytes instead of 24"),
        (cloud(bytes(24), 2, XYZ, 8), "z ends at byte 12 of points of 8 bytes"),
        (cloud(bytes(24), 2, [*XYZ[:2], ("z", -4, 7, 1)], 12), "z ends at byte 0"),
        (cloud(bytes(48), 2, XYZ, 12, 2, 12), "2 points of 12 bytes are 12 bytes apart"),
        (cloud(bytes(24), 2, [*XYZ[:2], ("z", 8, 99, 1)], 12), "z has the type 99"),
    ],
)
def test_damage(viewer: Viewer, message: bytes, reason: str) -> None:
    with pytest.raises(MessageError, match=reason):
        viewer.handle(CHANNEL, message)
