"""Kinds and names of scene files."""

import re
from pathlib import Path

import pytest

from gateway.datasets.errors import DatasetError
from gateway.datasets.scene_sources import MAX_NAME_CHARS, Source, SourceKind, find_sources, kind_of


def test_kind_of_a_file() -> None:
    kinds = {
        SourceKind.FILE: ("a.gltf", "A.GLB", "a.obj", "a.STL", "a.ply", "a.dae", "a.vtk"),
        SourceKind.TREE: ("a.tree.json",),
        SourceKind.REQUEST: ("a.multipart",),
        None: ("a.json", "a.txt", "obj"),
    }
    assert {
        kind: tuple(name for name in names if kind_of(Path(name)) is kind) for kind, names in kinds.items()
    } == kinds


def test_folders_are_searched_and_sorted_by_name(tmp_path: Path) -> None:
    for name in ("b.stl", "a/c.stl", "a/notes.txt", ".hidden.stl", ".git/d.stl", "folder.stl/e.stl"):
        path = tmp_path / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text("")
    sources = find_sources([tmp_path])
    assert [source.name for source in sources] == ["a/c.stl", "b.stl", "folder.stl/e.stl"]
    assert sources[0] == Source("a/c.stl", str(tmp_path / "a" / "c.stl"), SourceKind.FILE)


def test_a_named_file_keeps_its_name_and_may_be_any_json(tmp_path: Path) -> None:
    path = tmp_path / "deep" / "robot.JSON"
    path.parent.mkdir()
    path.write_text("{}")
    assert find_sources([path]) == (Source("robot.JSON", str(path), SourceKind.TREE),)
    suffixes = ".gltf, .glb, .dae, .obj, .ply, .stl, .vtk, .urdf, .sdf, .mjcf, .tree.json, .multipart"
    with pytest.raises(DatasetError, match=f"holds no scene: no {re.escape(suffixes)}$"):
        find_sources([path.parent])


def test_a_scene_that_is_named_twice_is_one(tmp_path: Path) -> None:
    (tmp_path / "a.stl").write_text("")
    assert len(find_sources([tmp_path, tmp_path / "a.stl"])) == 1


@pytest.mark.parametrize(
    ("name", "problem", "printable"),
    [
        ("a" * (MAX_NAME_CHARS - 4) + ".stl", "", None),
        ("a" * (MAX_NAME_CHARS - 3) + ".stl", f"a name of {MAX_NAME_CHARS + 1} characters", None),
        ("a b-ä.stl", "", None),
        ("a\\b.stl", r"a name with the character '\\'", None),
        ("a\tb.stl", r"a name with the character '\t'", r"a\tb.stl"),
    ],
)
def test_names_that_cannot_be_used(tmp_path: Path, name: str, problem: str, printable: str | None) -> None:
    (tmp_path / name).write_text("")
    (source,) = find_sources([tmp_path])
    assert source.name == name
    assert source.problem.startswith(problem)
    assert bool(source.problem) is bool(problem)
    assert source.printable_name == (printable or name)


def test_robots_in_folders_are_urdf_and_mjcf_but_any_named_xml(tmp_path: Path) -> None:
    for name in ("a.urdf", "b.mjcf", "package.xml"):
        (tmp_path / name).write_text("")
    found = [(source.name, source.kind) for source in find_sources([tmp_path])]
    assert found == [("a.urdf", SourceKind.FILE), ("b.mjcf", SourceKind.FILE)]
    assert find_sources([tmp_path / "package.xml"])[0].kind is SourceKind.FILE
