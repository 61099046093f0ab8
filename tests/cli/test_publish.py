"""Requests in JSON that ``scenegate publish`` puts below a path."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from gateway.cli.publish import _read_request
from gateway.client.tree.geometry import Mesh, PointCloud
from gateway.client.tree.parts import geometries_of
from gateway.client.tree.published import Changes, Entry
from gateway.scene.geometry import Box, Part
from gateway.scene.geometry import PointCloud as Points
from gateway.scene.transforms import translation
from renderers.drawlist import Material


def read(folder: Path, request: Any) -> Changes:
    source, changes = folder / "request.json", Changes()
    source.write_text(json.dumps(request))
    _read_request(source, ("root",), changes)
    return changes


def test_commands_are_put_below_the_path(tmp_path: Path) -> None:
    box, ball, move = {"type": "box"}, {"type": "sphere"}, {"translation": [1, 2, 3]}
    request = {
        "settransform": [{"path": ["a"], "transform": move}, {"path": ["b"]}],
        "setgeometry": [
            {"path": "a/b", "geometry": box},
            {"path": [], "geometries": [box, ball]},
            {"path": ["c"], "geometry": None},
        ],
        "delete": [{"path": ["old", 2]}],
    }
    changes = read(tmp_path, request)
    assert list(changes.deleted) == [("root", "old", 2)]
    assert changes.entries == {
        ("root", "a", "b"): Entry([box]),
        ("root",): Entry([box, ball]),
        ("root", "c"): Entry([]),
        ("root", "a"): Entry(None, move),
        ("root", "b"): Entry(None, {}),
    }


@pytest.mark.parametrize("request_", [[], {}, {"geometry": []}, 3])
def test_other_json_is_no_request(tmp_path: Path, request_: Any) -> None:
    with pytest.raises(ValueError, match="has no delete, setgeometry or settransform"):
        read(tmp_path, request_)


@pytest.mark.parametrize("command", [{}, {"path": 3}, {"path": None}, "a", ["a"]])
def test_commands_without_a_path_are_rejected(tmp_path: Path, command: Any) -> None:
    with pytest.raises(ValueError, match=r"setgeometry\[1\] has no path"):
        read(tmp_path, {"setgeometry": [{"path": "a"}, command]})


def test_parts_become_meshes_and_points_of_the_path() -> None:
    """In the frame of the path, with sRGB colours limited to 1, and with faces whose front stays outside."""
    material = Material(base_color=(0.5, 0.0, 2.0, 0.25))
    mirror = np.diag((-1.0, 1.0, 1.0, 1.0))
    for X in (translation(10.0, 0.0, 0.0), translation(10.0, 0.0, 0.0) @ mirror):
        (mesh,) = geometries_of(Part(Box((2.0, 4.0, 6.0)), material, X))
        assert isinstance(mesh, Mesh)
        vertices, faces = np.asarray(mesh.vertices), np.asarray(mesh.faces)
        assert vertices.min(0) == pytest.approx((9, -2, -3))
        assert vertices.max(0) == pytest.approx((11, 2, 3))
        corners = vertices[faces]
        normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        assert (np.einsum("ij,ij->i", normals, corners.mean(1) - (10, 0, 0)) > 0).all()
        assert mesh.color == pytest.approx([0.7354, 0.0, 1.0, 0.25], abs=1e-4)


def test_points_are_moved_and_keep_their_colours() -> None:
    rgb = np.array([(1, 0, 0), (0, 1, 0)], np.float32)
    shape = Points(np.array([(0, 0, 0), (1, 2, 3)], np.float32), {"rgb": rgb})
    (points,) = geometries_of(Part(shape, Material(), translation(0.0, 0.0, 3.0)))
    assert isinstance(points, PointCloud)
    np.testing.assert_array_equal(points.points, [(0, 0, 3), (1, 2, 6)])
    np.testing.assert_array_equal(points.rgb, rgb)
