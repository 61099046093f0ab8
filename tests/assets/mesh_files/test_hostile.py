"""Names that lead outside of the open folders, damaged files, files beyond the limits."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
import pytest

from gateway.assets.mesh_files import MeshFileError, MeshFileLimits, MeshFiles
from gateway.gltf import GltfLimits
from tests.assets.mesh_files.files import DAE, TRIANGLE, gltf, png, write


def test_collada_with_entities_is_refused(root: Path, files: MeshFiles) -> None:
    bomb = DAE.format(asset="").replace("<COLLADA", '<!DOCTYPE x [<!ENTITY a SYSTEM "file:///etc/passwd">]><COLLADA', 1)
    write(root / "bomb.dae", bomb)
    with pytest.raises(MeshFileError, match="DOCTYPE"):
        files.load("bomb.dae")


@pytest.mark.parametrize(
    "name",
    [
        "../secret.obj",
        "sub/../../secret.obj",
        "../open-sesame/near.obj",
        "{outside}/secret.obj",
        "file://{outside}/secret.obj",
        "file://{outside}/open/%2e%2e/secret.obj",
        "/etc/passwd",
        "link/secret.obj",
        "secret-link.obj",
        "../nothing-there.obj",
    ],
)
def test_files_outside_of_the_roots_are_not_disclosed(root: Path, files: MeshFiles, name: str) -> None:
    (root / "link").symlink_to(root.parent)
    (root / "secret-link.obj").symlink_to(root.parent / "secret.obj")
    with pytest.raises(MeshFileError, match="lies outside of the folders that are open to clients") as caught:
        files.load(name.format(outside=root.parent))
    assert not caught.value.missing


def test_a_sibling_outside_is_not_taken(root: Path, files: MeshFiles) -> None:
    (root / "link.obj").symlink_to(root.parent / "secret.obj")
    with pytest.raises(MeshFileError, match="no such file"):
        files.load("link.vtp")


@pytest.mark.parametrize("name", ["http://example.org/x.obj", "https://example.org/x.obj", "ftp://h/x.obj", "data://x"])
def test_nothing_is_fetched(files: MeshFiles, name: str) -> None:
    with pytest.raises(MeshFileError, match="nothing is fetched"):
        files.load(name)


@pytest.mark.parametrize("named", ["../secret.mtl", "/etc/passwd", "leak.mtl", "http://example.org/x.mtl"])
def test_materials_outside_of_the_roots_are_left_out(root: Path, files: MeshFiles, named: str) -> None:
    write(root.parent / "secret.mtl", "newmtl m\nKd 1 0 0\n")
    (root / "leak.mtl").symlink_to(root.parent / "secret.mtl")
    write(root / "t.obj", f"mtllib {named}\nv 0 0 0\nv 1 0 0\nv 0 2 0\nusemtl m\nf 1 2 3\n")
    (part,) = files.load("t.obj")
    assert part.material.base_color == (1, 1, 1, 1)


def test_textures_outside_of_the_roots_are_left_out(root: Path, files: MeshFiles) -> None:
    write(root.parent / "secret.png", png((9, 9, 9)))
    write(root / "t.mtl", "newmtl m\nKd 1 0 0\nmap_Kd ../secret.png\n")
    write(root / "t.obj", "mtllib t.mtl\nv 0 0 0\nv 1 0 0\nv 0 2 0\nvt 0 0\nusemtl m\nf 1/1 2/1 3/1\n")
    (part,) = files.load("t.obj")
    assert part.material.base_color_texture is None
    assert part.material.base_color == (1, 0, 0, 1)


def test_gltf_buffers_outside_of_the_roots_are_refused(root: Path, files: MeshFiles) -> None:
    write(root.parent / "data.bin", b"\0" * 36)
    write(root / "t.gltf", gltf("").replace("data.bin", "../data.bin"))
    with pytest.raises(MeshFileError, match="outside"):
        files.load("t.gltf")


def test_pipes_are_refused_without_blocking(root: Path, files: MeshFiles) -> None:
    os.mkfifo(root / "pipe.obj")
    with pytest.raises(MeshFileError, match=r"known format|regular file"):
        files.load("pipe.obj")
    os.mkfifo(root / "pipe.mtl")
    write(root / "t.obj", "mtllib pipe.mtl\n" + TRIANGLE)
    assert files.load("t.obj")


def test_without_roots_everything_is_refused(root: Path) -> None:
    write(root / "t.obj", TRIANGLE)
    with pytest.raises(MeshFileError, match="no folder is open"):
        MeshFiles([]).load(str(root / "t.obj"))


@pytest.mark.parametrize("extension", ["obj", "stl", "ply", "dae", "glb", "gltf"])
@pytest.mark.parametrize(
    "content",
    [
        b"",
        b"\0" * 200,
        b"solid \xff\xfe",
        b"f 1 2 3\n",
        b"ply\nformat ascii 1.0\nelement vertex 9999999999\nend_header\n",
    ],
)
def test_damaged_files_are_errors(root: Path, files: MeshFiles, extension: str, content: bytes) -> None:
    write(root / f"bad.{extension}", content)
    with pytest.raises(MeshFileError) as caught:
        files.load(f"bad.{extension}")
    assert f"bad.{extension}" in str(caught.value)
    assert "\n" not in str(caught.value)


def test_faces_beyond_the_vertices_are_errors(root: Path, files: MeshFiles) -> None:
    write(root / "bad.obj", "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 9\n")
    with pytest.raises(MeshFileError):
        files.load("bad.obj")


def test_files_beyond_the_limits_are_refused(root: Path) -> None:
    write(root / "t.obj", TRIANGLE)
    with pytest.raises(MeshFileError, match="larger than the 10 bytes"):
        MeshFiles([root], MeshFileLimits(max_bytes=10)).load("t.obj")
    with pytest.raises(MeshFileError, match="more than 2 vertices"):
        MeshFiles([root], MeshFileLimits(gltf=GltfLimits(max_vertices=2))).load("t.obj")


def test_a_file_of_exactly_the_limit_is_read(root: Path) -> None:
    write(root / "t.obj", TRIANGLE)
    size = len(TRIANGLE)
    for limits in (MeshFileLimits(max_bytes=size), MeshFileLimits(max_total_bytes=size)):
        assert MeshFiles([root], limits).load("t.obj")
    for limits in (MeshFileLimits(max_bytes=size - 1), MeshFileLimits(max_total_bytes=size - 1)):
        with pytest.raises(MeshFileError, match=f"larger than the {size - 1} bytes that are left to it"):
            MeshFiles([root], limits).load("t.obj")
    content = GltfLimits(max_vertices=3, max_elements=1)
    assert MeshFiles([root], MeshFileLimits(gltf=content)).load("t.obj")
    with pytest.raises(MeshFileError, match="more than 3 vertices or 0 triangles"):
        MeshFiles([root], MeshFileLimits(gltf=GltfLimits(max_vertices=3, max_elements=0))).load("t.obj")


def test_the_files_that_a_mesh_refers_to_share_the_limit(root: Path) -> None:
    text = gltf("VTK")
    write(root / "t.gltf", text)
    write(root / "data.bin", np.eye(3, dtype=np.float32).tobytes())
    total = len(text) + 36
    assert MeshFiles([root], MeshFileLimits(max_total_bytes=total)).load("t.gltf")
    with pytest.raises(MeshFileError, match=r"'data\.bin' is larger than the 35 bytes that are left to it"):
        MeshFiles([root], MeshFileLimits(max_total_bytes=total - 1)).load("t.gltf")
