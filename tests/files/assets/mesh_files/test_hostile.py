"""Names that lead outside of the open folders, damaged files, files beyond the limits."""

import os
import socket
from pathlib import Path

import numpy as np
import pytest

from gateway.files.assets.mesh_files import MeshFileError, MeshFileLimits, MeshFiles
from gateway.files.gltf import GltfLimits
from tests.files.assets.mesh_files.files import DAE, TRIANGLE, gltf, load_painted, png, write


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
    with pytest.raises(MeshFileError, match="outside of the folders") as caught:
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
    """Each sender has a cache of its own: what one loads that may is not shown to all."""
    write(root.parent / "secret.png", png((9, 9, 9)))
    local, _ = load_painted(MeshFiles([root], any_folder=True), root, "Kd 1 0 0\nmap_Kd ../secret.png")
    assert local.material.base_color_texture is not None
    part, _ = load_painted(files, root, "Kd 1 0 0\nmap_Kd ../secret.png")
    assert part.material.base_color_texture is None
    assert part.material.base_color == (1, 0, 0, 1)


def test_gltf_buffers_outside_of_the_roots_are_refused(root: Path, files: MeshFiles) -> None:
    write(root.parent / "data.bin", b"\0" * 36)
    write(root / "t.gltf", gltf("").replace("data.bin", "../data.bin"))
    with pytest.raises(MeshFileError, match="outside"):
        files.load("t.gltf")


@pytest.fixture
def anywhere() -> MeshFiles:
    return MeshFiles((), any_folder=True)


def test_any_folder_with_materials_and_textures(root: Path, anywhere: MeshFiles) -> None:
    write(root.parent / "textures" / "red.png", png((255, 0, 0)))
    load_painted(MeshFiles([root]), root, "Kd 1 0 0\nmap_Kd ../textures/red.png")
    (root / "link.obj").symlink_to(root / "t.obj")
    for name in (f"{root}/t.obj", f"file://{root}/t.obj", f"{root}/link.obj", f"{root}/t.vtp"):
        (part,) = anywhere.load(name)
        assert part.material.base_color_texture is not None
    assert anywhere.read(str(root / "t.mtl")).startswith(b"newmtl")


def test_packages_of_the_environment_in_any_folder(
    root: Path, files: MeshFiles, monkeypatch: pytest.MonkeyPatch
) -> None:
    write(root.parent / "ws" / "arm" / "package.xml", "<name>arm</name>")
    write(root.parent / "ws" / "arm" / "t.obj", TRIANGLE)
    monkeypatch.setenv("ROS_PACKAGE_PATH", str(root.parent / "ws"))
    assert MeshFiles((), any_folder=True).load("package://arm/t.obj")
    with pytest.raises(MeshFileError, match="no package"):
        files.load("package://arm/t.obj")


@pytest.mark.parametrize(
    "name",
    [
        "/etc/passwd",
        "/proc/self/environ",
        "/proc/self/fd/0",
        "/dev/zero",
        "{root}/passwd.obj",
        "{root}/environ.obj",
        "{root}/zero.obj",
        "{root}/pipe.obj",
        "{root}/pipe.vtp",
        "{root}/socket.obj",
        "{root}/folder.obj",
        "{root}/key.pem",
        "{root}/key.obj",
    ],
)
def test_any_folder_has_regular_files_of_known_formats_only(root: Path, anywhere: MeshFiles, name: str) -> None:
    write(root / "key.pem", TRIANGLE)
    for link, target in {"passwd": "/etc/passwd", "environ": "/proc/self/environ", "zero": "/dev/zero"}.items():
        (root / f"{link}.obj").symlink_to(target)
    (root / "key.obj").symlink_to(root / "key.pem")
    (root / "folder.obj").mkdir()
    os.mkfifo(root / "pipe.obj")
    with socket.socket(socket.AF_UNIX) as sock:
        sock.bind(str(root / "socket.obj"))
        for load in (anywhere.load, anywhere.read):
            with pytest.raises(MeshFileError, match=r"known format|regular file|no such file"):
                load(name.format(root=root))


@pytest.mark.parametrize("named", ["/etc/passwd", "../key.pem", "passwd.mtl", "/dev/zero", "http://example.org/x.mtl"])
def test_meshes_in_any_folder_refer_to_known_formats_only(root: Path, anywhere: MeshFiles, named: str) -> None:
    """A pattern of a material in the file would colour the part."""
    write(root.parent / "key.pem", "newmtl m\nKd 1 0 0\n")
    (root / "passwd.mtl").symlink_to("/etc/passwd")
    write(root / "t.obj", f"mtllib {named}\nv 0 0 0\nv 1 0 0\nv 0 2 0\nusemtl m\nf 1 2 3\n")
    (part,) = anywhere.load(str(root / "t.obj"))
    assert part.material.base_color == (1, 1, 1, 1)


def test_huge_files_in_any_folder_are_not_read(root: Path) -> None:
    with write(root / "huge.stl", "").open("r+b") as file:
        file.truncate(1 << 40)
    with pytest.raises(MeshFileError, match="is larger than"):
        MeshFiles((), any_folder=True).load(str(root / "huge.stl"))


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


@pytest.mark.parametrize(
    ("limits", "message"),
    [
        (MeshFileLimits(max_bytes=len(TRIANGLE)), None),
        (MeshFileLimits(max_total_bytes=len(TRIANGLE)), None),
        (MeshFileLimits(max_bytes=len(TRIANGLE) - 1), f"is larger than the {len(TRIANGLE) - 1} bytes that are left"),
        (MeshFileLimits(max_total_bytes=10), "is larger than the 10 bytes that are left to it"),
        (MeshFileLimits(gltf=GltfLimits(max_vertices=3, max_elements=1)), None),
        (MeshFileLimits(gltf=GltfLimits(max_vertices=2)), "more than 2 vertices"),
        (MeshFileLimits(gltf=GltfLimits(max_vertices=3, max_elements=0)), "more than 3 vertices or 0 triangles"),
    ],
)
def test_files_beyond_the_limits_are_refused(root: Path, limits: MeshFileLimits, message: str | None) -> None:
    name = write(root / "t.obj", TRIANGLE).as_uri()  # the message has the client's name, not the file's alone
    files = MeshFiles([root], limits)
    if message is None:
        assert files.load(name)
        return
    with pytest.raises(MeshFileError, match=f"^'{name}'.* {message}"):
        files.load(name)


def test_the_files_that_a_mesh_refers_to_share_the_limit(root: Path) -> None:
    text = gltf("VTK")
    write(root / "t.gltf", text)
    write(root / "data.bin", np.eye(3, dtype=np.float32).tobytes())
    total = len(text) + 36
    assert MeshFiles([root], MeshFileLimits(max_total_bytes=total)).load("t.gltf")
    with pytest.raises(MeshFileError, match=r"'data\.bin' .*35 bytes"):
        MeshFiles([root], MeshFileLimits(max_total_bytes=total - 1)).load("t.gltf")
