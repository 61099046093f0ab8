"""Meshes of URDF: scale, axes and materials."""

from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from gateway.files.robots.reader import read_robot
from gateway.scene.tree.geometry import Part
from renderers.color import linear_from_srgb
from renderers.encode import png_rgb
from scenegate.robots.robot_files import RobotFiles
from tests.files.assets.mesh_files.files import DAE
from tests.files.gltf.builder import mesh_of
from tests.files.parsers.test_collada import PAINTED, document
from tests.files.robots.files import TRIANGLE, link, visual, write

BLUE = "newmtl blue\nKd 0 0 1\n"
RED = '<material name="red"><color rgba="1 0 0 1"/></material>'


def part_of(folder: Path, mesh: str, name: str, attributes: str = "", material: str = "") -> Part:
    write(folder, mesh, name)
    ((part,),) = read_robot(write(folder, visual(f'<mesh filename="{name}" {attributes}/>', material))).parts
    return part


def corners(part: Part) -> np.ndarray:
    """Return the vertices in the link's frame."""
    return np.asarray(mesh_of(part).positions @ part.X_node_part[:3, :3].T + part.X_node_part[:3, 3])


@pytest.mark.parametrize(
    ("scale", "size"), [("", (1, 1, 0)), ('scale="2 -3 1"', (2, -3, 0)), ('scale="0.001"', (0.001, 0.001, 0))]
)
def test_scale(tmp_path: Path, scale: str, size: tuple[float, float, float]) -> None:
    vertices = corners(part_of(tmp_path, TRIANGLE, "m.obj", scale, '<origin xyz="0 0 5"/>'))
    expected = [(0, 0, 5), (size[0], 0, 5), (0, size[1], 5)]
    np.testing.assert_allclose(sorted(vertices.tolist()), sorted(expected), atol=1e-7)


def test_collada_has_its_unit_but_not_its_up_axis(tmp_path: Path) -> None:
    """As in RViz: exporters write any up axis, and robots are made for software that ignores it."""
    asset = '<unit meter="0.01"/><up_axis>Y_UP</up_axis>'
    vertices = corners(part_of(tmp_path, "\n" + DAE.format(asset=asset), "m.dae"))
    np.testing.assert_allclose(sorted(vertices.tolist()), [(0, 0, 0.05), (0, 0.02, 0.05), (0.01, 0, 0.05)], atol=1e-7)


def test_the_robots_material_is_for_meshes_without_one(tmp_path: Path) -> None:
    assert part_of(tmp_path, TRIANGLE, "m.obj", material=RED).material.base_color == (1, 0, 0, 1)
    grey = part_of(tmp_path, TRIANGLE, "m.obj").material.base_color
    assert grey == pytest.approx((*[linear_from_srgb(0.9)] * 3, 1))
    write(tmp_path, BLUE, "m.mtl")
    own = "mtllib m.mtl\nusemtl blue\n" + TRIANGLE
    assert part_of(tmp_path, own, "m.obj", material=RED).material.base_color == (0, 0, 1, 1)


def test_a_mesh_that_would_vanish_is_drawn_opaque_with_a_warning(tmp_path: Path) -> None:
    write(tmp_path, BLUE + "Tr 1.0\n", "m.mtl")
    own = "mtllib m.mtl\nusemtl blue\n" + TRIANGLE
    assert part_of(tmp_path, own, "m.obj").material.base_color == (0, 0, 1, 1)
    (warning,) = read_robot(tmp_path / "robot.urdf").warnings
    assert warning == "link 'a', m.obj: all its colours have an opacity of 0; it is drawn opaque"
    write(tmp_path, BLUE + "Tr 1.0\nnewmtl red\nKd 1 0 0\n", "m.mtl")
    write(tmp_path, own + "usemtl red\nf 1 3 2\n", "m.obj")
    robot = read_robot(tmp_path / "robot.urdf")
    assert sorted(part.material.base_color[3] for part in robot.parts[0]) == [0.0, 1.0]
    assert robot.warnings == ()


@pytest.mark.parametrize(
    ("transparent", "transparency", "opacity", "warned"),
    [
        ('opaque="A_ONE"><color>1 1 1 0</color>', None, 1.0, True),
        ('opaque="A_ONE"><color>1 1 1 0.25</color>', None, 0.25, False),
        ('opaque="A_ONE"><color>1 1 1 0.5</color>', 0.5, 0.25, False),
        ('opaque="A_ONE"><color>1 1 1 1</color>', 0, 1.0, False),
        ('opaque="RGB_ZERO"><color>0 0 0 1</color>', None, 1.0, False),
        ('opaque="RGB_ZERO"><color>0.5 0.5 0.5 1</color>', None, 0.5, False),
        ('opaque="RGB_ZERO"><color>1 1 1 1</color>', 0.25, 0.75, False),
        (None, 0.4, 0.4, False),
        (None, 0, 1.0, False),
    ],
)
def test_opacity_of_collada(
    tmp_path: Path, transparent: str | None, transparency: float | None, opacity: float, warned: bool
) -> None:
    lambert = "<lambert><diffuse><color>0 1 0 1</color></diffuse>"
    if transparent is not None:
        lambert += f"<transparent {transparent}</transparent>"
    if transparency is not None:
        lambert += f"<transparency><float>{transparency}</float></transparency>"
    lambert += "</lambert>"
    part = part_of(tmp_path, document(PAINTED, shader=lambert), "m.dae")
    assert part.material.base_color == pytest.approx((0, 1, 0, opacity), abs=1e-6)
    assert bool(read_robot(tmp_path / "robot.urdf").warnings) == warned


def test_meshes_without_triangles_and_missing_textures_are_warnings(tmp_path: Path) -> None:
    write(tmp_path, DAE.format(asset="").replace('<instance_geometry url="#g"/>', ""), "empty.dae")
    texture = '<material name="t"><texture filename="wood.png"/></material>'
    robot = read_robot(write(tmp_path, visual('<mesh filename="empty.dae"/>', texture)))
    assert robot.parts == ((),)
    assert robot.warnings == (
        "link 'a': the texture wood.png of its material is not shown: there is no such file",
        "link 'a': the mesh empty.dae is not shown: the file holds no triangles or points",
    )


def test_the_texture_of_a_material(tmp_path: Path) -> None:
    """On boxes, and meshes with texture coordinates but without a material. Others have the texture's mean colour."""
    pixels = np.array([[(255, 0, 0), (0, 0, 255)]], np.uint8)
    (tmp_path / "t.png").write_bytes(png_rgb(pixels))
    texture = '<material name="t"><color rgba="0 1 0 1"/><texture filename="t.png"/></material>'
    with_uv = "vt 0 0\nvt 1 0\nvt 0 1\n" + TRIANGLE.replace("f 1 2 3", "f 1/1 2/2 3/3")
    material = part_of(tmp_path, with_uv, "m.obj", material=texture).material
    np.testing.assert_array_equal(material.base_color_texture.image.decode()[..., :3], pixels)
    assert material.base_color == pytest.approx((1.0, 1.0, 1.0, 1.0))
    mean = (linear_from_srgb(0.5), 0, linear_from_srgb(0.5), 1)
    plain = part_of(tmp_path, TRIANGLE, "m.obj", material=texture).material
    assert plain.base_color_texture is None
    assert plain.base_color == pytest.approx(mean)
    ((part,),) = read_robot(write(tmp_path, visual('<sphere radius="1"/>', texture))).parts
    assert part.material == plain
    ((part,),) = read_robot(write(tmp_path, visual('<box size="1 2 3"/>', texture))).parts
    assert part.material == material
    positions, uv = mesh_of(part).positions, mesh_of(part).uv0
    right_face = positions[:, 0].reshape(6, 4).min(axis=1) == 0.5
    top_left = np.where(np.all(uv == 0.0, axis=1).reshape(6, 4)[right_face])[1]
    np.testing.assert_allclose(positions.reshape(6, 4, 3)[right_face][0, top_left], [(0.5, -1.0, 1.5)])
    (tmp_path / "t.png").write_bytes(b"no image")
    robot = read_robot(tmp_path / "robot.urdf")
    assert "the texture t.png of its material is not shown: " in robot.warnings[0]
    assert part_of(tmp_path, with_uv, "m.obj", material=RED).material.base_color == (1, 0, 0, 1)


@pytest.mark.parametrize("suffix", ["bmp", "tga", "dds", "gif"])
def test_a_texture_in_an_older_format(tmp_path: Path, suffix: str) -> None:
    image = Image.new("RGB", (4, 4), (0, 0, 255))
    image.save(tmp_path / f"t.{suffix}")
    texture = f'<material name="t"><texture filename="t.{suffix}"/></material>'
    robot = read_robot(write(tmp_path, visual('<sphere radius="1"/>', texture)))
    assert robot.warnings == ()
    ((part,),) = robot.parts
    np.testing.assert_allclose(part.material.base_color, (0, 0, 1, 1), atol=0.01)


def test_a_texture_is_read_once(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "t.png").write_bytes(png_rgb(np.zeros((1, 2, 3), np.uint8)))
    names = []
    read = RobotFiles.read

    def counted(self: RobotFiles, path: Path, *limit: int) -> bytes:
        names.append(path.name)
        return read(self, path, *limit)

    monkeypatch.setattr(RobotFiles, "read", counted)
    texture = '<material name="t"><texture filename="t.png"/></material>'
    box = f'<visual><geometry><box size="1 1 1"/></geometry>{texture}</visual>'
    first, second = read_robot(write(tmp_path, link(box + box))).parts[0]
    assert first.material == second.material
    assert not first.material.base_color_texture.image.decode()[..., :3].any()
    assert names.count("t.png") == 1


@pytest.mark.parametrize(
    ("name", "content", "reason"),
    [
        ("m.dae", "nothing", "it cannot be read as DAE: "),
        ("m.stl", "version https://git-lfs.github.com/spec/v1\n", "it is a pointer of Git LFS"),
    ],
)
def test_a_broken_mesh_is_left_out_with_a_warning(tmp_path: Path, name: str, content: str, reason: str) -> None:
    write(tmp_path, content, name)
    robot = read_robot(write(tmp_path, visual(f'<mesh filename="{name}"/>')))
    assert robot.parts == ((),)
    assert robot.warnings[0].startswith(f"link 'a': the mesh {name} is not shown: {reason}")


def test_a_mesh_is_read_once(tmp_path: Path) -> None:
    write(tmp_path, TRIANGLE, "m.obj")
    one = '<visual><geometry><mesh filename="m.obj"/></geometry></visual>'
    first, second = read_robot(write(tmp_path, link(one + one))).parts[0]
    assert first.shape is second.shape
