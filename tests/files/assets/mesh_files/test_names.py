"""Names of mesh files, and their cache."""

from pathlib import Path
from unittest.mock import Mock

import numpy as np
import pytest

from gateway.files.assets.mesh_files import MeshFileError, MeshFiles
from gateway.scene.tree import transforms as tf
from gateway.scene.tree.geometry import PointCloud
from renderers.cache import CacheBudget
from scenegate.robots.ros_packages import MAX_DEPTH, RESCAN_SECONDS, Packages
from tests.files.assets.mesh_files.files import CUBE, CUBE_MTL, RGB, TRIANGLE, mesh_of, ply, write


def test_absolute_relative_and_file_names(root: Path, files: MeshFiles) -> None:
    write(root / "sub dir" / "t.obj", TRIANGLE)
    for name in (
        "sub dir/t.obj",
        str(root / "sub dir/t.obj"),
        f"file://{root}/sub%20dir/t.obj",
        f"file:{root}/sub%20dir/t.obj",
        f"FILE://{root}/sub%20dir/t.obj",
        f"file://localhost{root}/sub%20dir/t.obj",
        "./sub dir/../sub dir/t.obj",
    ):
        assert files.load(name)


def test_packages_are_found_by_the_name_in_their_manifest(root: Path, files: MeshFiles) -> None:
    write(root / "ws" / "src" / "arm" / "package.xml", "<package format='2'>\n <name> my_arm </name></package>")
    write(root / "ws" / "src" / "arm" / "meshes" / "link.obj", TRIANGLE)
    assert files.load("package://my_arm/meshes/link.obj")
    assert files.load("package://my_arm//meshes/link.obj")
    with pytest.raises(MeshFileError, match="no package 'arm'") as caught:
        files.load("package://arm/meshes/link.obj")
    assert caught.value.missing
    with pytest.raises(MeshFileError, match="outside"):
        files.load("package://my_arm/../../../../secret.obj")


def test_relative_names_need_a_folder() -> None:
    with pytest.raises(MeshFileError, match=r"'t\.obj' .*--mesh-root"):
        MeshFiles((), any_folder=True).load("t.obj")


def test_unknown_packages_do_not_start_a_search_each(root: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    now = [5.0]
    packages = Packages((root,), clock=lambda: now[0])
    scan = Mock(wraps=packages.scan)
    monkeypatch.setattr(packages, "scan", scan)
    for _ in range(50):
        assert packages.folder("late") is None
    write(root / "late" / "package.xml", "<name>late</name>")
    now[0] += RESCAN_SECONDS - 0.001
    assert packages.folder("late") is None
    assert scan.call_count == 1
    now[0] += 0.001
    assert packages.folder("late") == root / "late"


def test_siblings_of_a_known_format_replace_unknown_ones(root: Path, files: MeshFiles) -> None:
    write(root / "link.obj", TRIANGLE)
    write(root / "other.vtm", "<VTKFile/>")
    assert files.load("link.vtp")
    with pytest.raises(MeshFileError, match="not a file of a known format") as caught:
        files.load("other.vtm")
    assert not caught.value.missing


def test_a_link_within_the_roots_is_followed(root: Path, files: MeshFiles) -> None:
    write(root / "real" / "t.obj", TRIANGLE)
    (root / "alias.obj").symlink_to(root / "real" / "t.obj")
    assert files.load("alias.obj")


def test_names_that_the_system_refuses(files: MeshFiles) -> None:
    with pytest.raises(MeshFileError):
        files.load("x" * 300 + ".obj")
    with pytest.raises(MeshFileError):
        files.load("\ud800.obj")


def test_a_file_is_loaded_once_until_it_or_its_material_changes(root: Path, files: MeshFiles) -> None:
    write(root / "cube.obj", CUBE)
    material = write(root / "cube.mtl", CUBE_MTL)
    first = files.load("cube.obj")
    assert files.load(str(root / "cube.obj"))[0].shape is first[0].shape
    scaled = files.load("cube.obj", (2, 2, 2))
    assert scaled[0].shape is first[0].shape
    np.testing.assert_array_equal(scaled[0].X_node_part, tf.scaling(2, 2, 2))
    write(material, CUBE_MTL.replace("d 0.25", "d 0.75"))
    again = files.load("cube.obj")
    assert sorted(part.material.base_color[3] for part in again) == [0.75, 1.0]


def test_cache_is_limited_in_bytes(root: Path) -> None:
    for index in range(4):
        write(root / f"{index}.obj", TRIANGLE)
    one = MeshFiles([root])
    one.load("0.obj")
    size = one.cache.nbytes
    files = MeshFiles([root], caches=CacheBudget(2 * size))
    kept = [files.load(f"{index}.obj")[0].shape for index in range(4)]
    assert files.cache.nbytes == 2 * size
    assert files.load("3.obj")[0].shape is kept[3]
    assert files.load("0.obj")[0].shape is not kept[0]


def test_known_packages_start_no_search(root: Path) -> None:
    write(root / "arm" / "package.xml", "<name>arm</name>")
    now = [0.0]
    packages = Packages((root,), clock=lambda: now[0])
    assert packages.folder("arm") == root / "arm"
    (root / "arm" / "package.xml").unlink()
    now[0] = 60.0
    assert packages.folder("arm") == root / "arm"
    assert packages.folder("other") is None  # a search, which does not find it any more
    assert packages.folder("arm") is None


@pytest.mark.parametrize(("depth", "found"), [(MAX_DEPTH, True), (MAX_DEPTH + 1, False)])
def test_packages_are_searched_to_a_depth(root: Path, depth: int, found: bool) -> None:
    folder = root.joinpath(*["x"] * depth)
    write(folder / "package.xml", "<name>deep</name>")
    assert Packages((root,)).scan() == ({"deep": folder} if found else {})


def test_searches_end_at_a_number_of_folders(root: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("a", "b", "c"):
        write(root / name / "package.xml", f"<name>{name}</name>")
    monkeypatch.setattr("scenegate.robots.ros_packages.MAX_FOLDERS", 3)  # the root itself, a and b
    assert list(Packages((root,)).scan()) == ["a", "b"]


def test_the_first_package_of_a_name_counts_and_packages_hold_no_others(root: Path) -> None:
    for path in ("one/b", "one/a", "two/a", "one/a/inside", ".git/hidden", "node_modules/hidden"):
        name = path.rpartition("/")[2]
        write(root / path / "package.xml", f"<name>{name}</name>")
    found = Packages((root / "two", root)).scan()
    assert found == {"a": root / "two/a", "b": root / "one/b"}


@pytest.mark.parametrize(
    "manifest", ["", "<name></name>", f"<name>{'x' * 257}</name>", " " * (1 << 16) + "<name>a</name>"]
)
def test_manifests_without_a_usable_name_are_no_packages(root: Path, manifest: str) -> None:
    write(root / "a" / "package.xml", manifest)
    assert Packages((root,)).scan() == {}


@pytest.mark.parametrize(
    "name", ["", "a\0b.obj", "x" * 4093 + ".obj", "x/" * 2046 + "x.obj"], ids=["empty", "zero", "one name", "path"]
)
def test_rejects_invalid_file_names(files: MeshFiles, name: str) -> None:
    with pytest.raises(MeshFileError, match="is not a file name"):
        files.load(name)


@pytest.mark.parametrize("name", ["nothing.obj", "x/" * 2046 + ".obj"], ids=["short", "4096 characters"])
def test_missing_files_say_so(files: MeshFiles, name: str) -> None:
    with pytest.raises(MeshFileError, match="': there is no such file") as caught:
        files.load(name)
    assert caught.value.missing


@pytest.mark.parametrize(("length", "shortened"), [(120, False), (121, True)])
def test_long_names_are_shortened_in_messages(files: MeshFiles, length: int, shortened: bool) -> None:
    name = "y" * (length - 4) + ".obj"
    with pytest.raises(MeshFileError) as caught:
        files.load(name)
    assert (name in str(caught.value)) != shortened
    assert ("..." in str(caught.value)) == shortened


def test_the_size_of_a_loaded_file_is_that_of_its_arrays(root: Path) -> None:
    """And a kilobyte for each part."""
    write(root / "p.ply", ply(2, "0 0 0 1 2 3\n1 0 0 4 5 6\n", *RGB))
    files = MeshFiles([root])
    (part,) = files.load("p.ply")
    assert isinstance(part.shape, PointCloud)
    expected = 1024 + part.shape.points.nbytes + part.shape.channels["rgb"].nbytes
    assert part.shape.points.nbytes == 2 * 12
    assert files.cache.nbytes == expected
    write(root / "t.obj", TRIANGLE)
    (part,) = files.load("t.obj")
    assert files.cache.nbytes == expected + 1024 + mesh_of(part).nbytes
