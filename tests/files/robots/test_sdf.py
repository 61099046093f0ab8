"""SDF: poses, frames, nested and included models, joints, geometry, and files with flaws."""

import json
import os
import subprocess
from pathlib import Path

import numpy as np
import pytest

from gateway.files.robots.reader import read_robot
from gateway.files.robots.robot import Robot
from gateway.scene.tree.geometry import Shape
from renderers.color import linear_from_srgb
from scenegate.messages.geometry import Box, Capsule, Cylinder, Ellipsoid, Sphere
from scenegate.robots.robot import JointValue
from scenegate.robots.robot_errors import RobotFileError
from scenegate.robots.robot_reader import read_robot as read_robot_of_client
from scenegate.robots.xml_text import pose_of_rpy
from tests.files.assets.mesh_files.files import DAE, png
from tests.files.gltf.builder import mesh_of
from tests.files.robots.files import TRIANGLE, write
from tests.support.waiting import SECONDS

ARM = """
<sdf version="1.9"><model name="arm" placement_frame="mount">
  <pose>9 9 9 0 0 0</pose>
  <link name="upper">
    <pose>0.1 0.2 0.3 0.1 0.2 0.3</pose>
    <visual name="v"><geometry><box><size>1 1 1</size></box></geometry></visual>
  </link>
  <link name="lower"><pose relative_to="elbow">0 0 -0.2 0 0 0</pose></link>
  <frame name="mount" attached_to="upper"><pose>0 0 0.5 0 0.3 0</pose></frame>
  <joint name="elbow" type="revolute">
    <pose relative_to="upper">0 0 0.4 0.5 0 0</pose>
    <parent>upper</parent><child>lower</child>
    <axis>
      <xyz expressed_in="__model__">0 1 0.5</xyz>
      <limit><lower>-1</lower><upper>2</upper></limit>
    </axis>
  </joint>
</model></sdf>
"""
ROBOT = """
<sdf version="1.9"><model name="robot">
  <pose>1 2 3 0 0 0.5</pose>
  <link name="base">
    <visual name="v">
      <pose relative_to="tip_frame">0 0 1 0 0 0</pose>
      <geometry><sphere><radius>1</radius></sphere></geometry>
    </visual>
  </link>
  <link name="slider">
    <pose relative_to="base" rotation_format="quat_xyzw">0 0 1   0.5 0.5 0.5 0.5</pose>
  </link>
  <joint name="slide" type="prismatic">
    <pose degrees="true">0 0 0 90 0 0</pose>
    <parent>base</parent><child>slider</child><axis><xyz>0 0 2</xyz></axis>
  </joint>
  <frame name="tip_frame" attached_to="slider"><pose>0.1 0 0 0 0 0.4</pose></frame>
  <include>
    <uri>package://arm/model.sdf</uri><name>left</name>
    <pose relative_to="tip_frame">0 1 0 0 0 0</pose>
  </include>
  <joint name="shoulder" type="ball"><parent>slider</parent><child>left::mount</child></joint>
  <model name="inner">
    <pose>0 -2 0 0.2 0 0</pose>
    <link name="wheel"/>
    <link name="hub"><pose>0 0 1 0 0 0</pose></link>
    <joint name="spin" type="revolute">
      <parent>wheel</parent><child>hub</child><axis><xyz>1 0 0</xyz></axis>
    </joint>
  </model>
  <joint name="weld" type="fixed"><parent>base</parent><child>inner::wheel</child></joint>
</model></sdf>
"""
"""Poses relative to frames, quaternions and degrees, a placement frame, an included and a nested model."""


def model(content: str, version: str = "1.9") -> str:
    return f'<sdf version="{version}"><model name="m">{content}</model></sdf>'


def geometry(shape: str, rest: str = "") -> str:
    return model(f'<link name="a"><visual name="v"><geometry>{shape}</geometry>{rest}</visual></link>')


def world(content: str) -> str:
    return f'<sdf version="1.9"><world name="w">{content}</world></sdf>'


def include(uri: str, rest: str = "") -> str:
    return f"<include><uri>{uri}</uri>{rest}</include>"


def read(folder: Path, content: str) -> Robot:
    return read_robot(write(folder, content, "robot.sdf"))


def robot_with_arm(folder: Path) -> Path:
    write(folder, ARM, "arm/model.sdf")
    return write(folder, ROBOT, "robot.sdf")


def test_links_of_models_have_their_names(tmp_path: Path) -> None:
    robot = read_robot(robot_with_arm(tmp_path))
    assert robot.name == "robot"
    assert robot.links == ("base", "slider", "left::upper", "left::lower", "inner::wheel", "inner::hub")
    assert {name: (joint.kind, joint.limits) for name, joint in robot.joints.items()} == {
        "slide": ("prismatic", None),
        "left::elbow": ("revolute", (-1.0, 2.0)),
        "shoulder": ("ball", None),
        "inner::spin": ("revolute", None),
    }
    assert robot.warnings == ()
    assert list(robot.digests) == ["robot.sdf", "arm/model.sdf"]


@pytest.mark.slow
@pytest.mark.drake
def test_poses_equal_drakes(tmp_path: Path) -> None:
    python = os.environ.get("SCENEGATE_DRAKE_PYTHON")
    if not python:
        pytest.skip("SCENEGATE_DRAKE_PYTHON does not name an interpreter with pydrake")
    path = robot_with_arm(tmp_path)
    joints = {"slide": (0.3,), "elbow": (0.7,), "spin": (-0.4,)}
    request = [{"file": str(path), "packages": {"arm": str(tmp_path / "arm")}, "joints": joints}]
    command = [python, str(Path(__file__).with_name("drake_poses.py"))]
    (theirs,) = json.loads(
        subprocess.run(
            command, input=json.dumps(request), capture_output=True, text=True, timeout=SECONDS, check=True
        ).stdout
    )
    robot = read_robot(path)
    ours = robot.link_poses({"slide": 0.3, "left::elbow": 0.7, "inner::spin": -0.4})
    assert len(theirs) == len(ours) + 1  # and the world
    for name, X_world_link in zip(robot.links, ours, strict=True):
        np.testing.assert_allclose(X_world_link, theirs[name.rpartition("::")[2]], atol=1e-12)


@pytest.mark.parametrize(
    ("shape", "expected"),
    [
        ("<box><size>1 2 3</size></box>", Box((1.0, 2.0, 3.0))),
        ("<sphere><radius>2</radius></sphere>", Sphere(2.0)),
        ("<cylinder><radius>1</radius><length>3</length></cylinder>", Cylinder(1.0, 3.0)),
        ("<capsule><radius>1</radius><length>3</length></capsule>", Capsule(1.0, 3.0)),
        ("<ellipsoid><radii>1 2 3</radii></ellipsoid>", Ellipsoid((1.0, 2.0, 3.0))),
        ("<box/>", Box((1.0, 1.0, 1.0))),  # the defaults of the specification
        ("<sphere/>", Sphere(1.0)),
        ("<cylinder><length>3</length></cylinder>", Cylinder(1.0, 3.0)),
        ("<capsule/>", Capsule(0.5, 1.0)),
        ("<ellipsoid/>", Ellipsoid((1.0, 1.0, 1.0))),
        ("<plane><normal>1 0 0</normal><size>4 5</size></plane>", Box((4.0, 5.0, 0.0))),
    ],
)
def test_shapes(tmp_path: Path, shape: str, expected: Shape) -> None:
    robot = read(tmp_path, geometry(shape))
    ((part,),) = robot.parts
    assert part.shape == expected
    assert robot.warnings == ()
    if "plane" in shape:
        np.testing.assert_allclose(part.X_node_part[:3, 2], (1, 0, 0))


def test_a_cone_has_its_origin_halfway_to_the_tip(tmp_path: Path) -> None:
    robot = read(tmp_path, geometry("<cone><radius>2</radius><length>3</length></cone>"))
    ((part,),) = robot.parts
    points = mesh_of(part).positions @ part.X_node_part[:3, :3].T + part.X_node_part[:3, 3]
    assert (points[:, 2].min(), points[:, 2].max()) == (-1.5, 1.5)
    np.testing.assert_allclose(np.abs(points[points[:, 2] > 0]).max(axis=0), (0, 0, 1.5), atol=1e-12)
    np.testing.assert_allclose(np.linalg.norm(points[:, :2], axis=1).max(), 2.0)
    assert robot.warnings == ()


@pytest.mark.parametrize(
    ("shape", "reason"),
    [
        ("<cone><radius>-2</radius><length>3</length></cone>", "radius='-2' of <cone> must be above 0"),
        ("<polyline><height>1</height></polyline>", "the shape <polyline> is not supported"),
        ("<heightmap><uri>a.png</uri></heightmap>", "the shape <heightmap> is not supported"),
    ],
)
def test_other_shapes_are_named(tmp_path: Path, shape: str, reason: str) -> None:
    assert read(tmp_path, geometry(shape)).warnings == (f"link 'a', visual: {reason}; it is not shown",)


@pytest.mark.parametrize(
    ("material", "color", "transparency"),
    [
        ("<diffuse>1 0 0 0.5</diffuse>", (1, 0, 0, 0.5), 0),
        ("<ambient>0 1 0</ambient>", (0, 1, 0, 1), 0),
        ("<script><name>Gazebo/Blue</name></script>", (0, 0, 1, 1), 0),
        ("", (*[linear_from_srgb(0.9)] * 3, 1), 0),
        ("<diffuse>1 0 0 0.5</diffuse>", (1, 0, 0, 0.1), 0.8),
        ("", (*[linear_from_srgb(0.9)] * 3, 0.2), 0.8),
    ],
)
def test_materials(tmp_path: Path, material: str, color: tuple[float, ...], transparency: float) -> None:
    rest = f"<material>{material}</material><transparency>{transparency}</transparency>"
    robot = read(tmp_path, geometry("<sphere/>", rest))
    assert robot.parts[0][0].material.base_color == pytest.approx(color)
    assert robot.warnings == ()


def test_meshes_lie_beside_the_file_that_names_them(tmp_path: Path) -> None:
    write(tmp_path, TRIANGLE, "far/thing/meshes/m.obj")
    mesh = "<mesh><uri>meshes/m.obj</uri><scale>2 2 2</scale></mesh>"
    write(tmp_path, geometry(mesh), "far/thing/thing-1.6.sdf")
    write(tmp_path, "<model><sdf version='1.6'>thing-1.6.sdf</sdf></model>", "far/thing/model.config")
    thing = "<include><uri>model://thing</uri><name>{}</name><pose>{} 0 0 0 0 0</pose></include>"
    includes = thing.format("one", 1) + thing.format("two", 2)
    robot = read_robot(write(tmp_path, world(includes), "near/w.sdf"), roots=[tmp_path / "far"])
    assert robot.links == ("one::a", "two::a")
    assert robot.warnings == ()
    assert [len(parts) for parts in robot.parts] == [1, 1]
    np.testing.assert_allclose(robot.link_poses({})[:, 0, 3], (1, 2))


def placed(name: str, place: str = "", relative_to: str = "") -> str:
    """A link with a pose, of six numbers."""
    return f"<link name='{name}'><pose{relative_to}>{place or '0 0 0 0 0 0'}</pose></link>"


def jointed(name: str, kind: str, parent: str, child: str, rest: str = "", axis: str = "1 0 0") -> str:
    ends = f"<parent>{parent}</parent><child>{child}</child><axis><xyz>{axis}</xyz></axis>"
    return f"<joint name='{name}' type='{kind}'>{rest}{ends}</joint>"


HINGE = jointed("hinge", "revolute", "a", "b", "<pose relative_to='a'>0 0 0.05 0 0 0</pose>", "0 1 0")
POLE = placed("a") + placed("b", "0 0 0.25 0 0 0", " relative_to='hinge'") + HINGE
TURNED = placed("a") + placed("b", "0 0 0 0 0 1.5707963267948966") + jointed("j", "prismatic", "a", "b")
IN_MODEL = TURNED.replace("</xyz>", "</xyz><use_parent_model_frame>{}</use_parent_model_frame>")
CART = placed("cart", "0 2 0 0 0 0") + placed("base", "0 0 1 0 0 0")
CART += jointed("slide", "prismatic", "world", "cart") + jointed("weld", "fixed", "world", "base")
WORLD = placed("world") + placed("cart", "0 0 1 0 0 0") + jointed("j", "prismatic", "world", "cart", axis="0 0 1")
WHEEL = jointed("wheel", "revolute", "a", "wheel") + placed("a") + placed("wheel", "0 1 0 0 0 0")
SAVED = "<frame name='n::__model__' attached_to='n::a'><pose relative_to='__model__'>0 2 0 0 0 0</pose></frame>"
SAVED += placed("n::a", "0 0 1 0 0 0", " relative_to='n::__model__'")
LIKE_SAVED = placed("a", "0 0 1 0 0 0") + f"<model name='n'><pose>0 3 0 0 0 0</pose>{placed('b')}</model>"
LIKE_SAVED += "".join(
    f"<frame name='{each}'><pose>5 0 0 0 0 0</pose></frame>" for each in ("", "a__model__", "n::__model__")
)
"""Frames that are not those of models: nameless, of a name that only looks like it, and one that SDF 1.8 refuses."""
OTHERS = f"<model name='m'><pose>0 0 2 0 0 0</pose>{placed('a')}</model>"
OTHERS += f"<model name='n'><pose relative_to='m::__model__'>1 0 0 0 0 0</pose>{placed('b')}</model>"


@pytest.mark.parametrize(
    ("sdf", "values", "positions"),
    [
        (model(POLE), {}, {"a": (0, 0, 0), "b": (0, 0, 0.3)}),  # a joint turns about its own frame
        (model(POLE), {"hinge": np.pi / 2}, {"a": (0, 0, 0), "b": (0.25, 0, 0.05)}),
        (model(TURNED, "1.4"), {"j": 1.0}, {"a": (0, 0, 0), "b": (1, 0, 0)}),  # axes in the frame of the model
        (model(TURNED, "1.5"), {"j": 1.0}, {"a": (0, 0, 0), "b": (0, 1, 0)}),
        *(  # as libsdformat reads them
            (model(IN_MODEL.format(text), "1.6"), {"j": 1.0}, {"a": (0, 0, 0), "b": position})
            for text, position in (("True", (1, 0, 0)), (" TRUE ", (1, 0, 0)), ("1", (1, 0, 0)), ("False", (0, 1, 0)))
        ),
        (
            model(placed("a", "0 0 0 0 0 90", " degrees='True'") + placed("b", "1 0 0 0 0 0", " relative_to='a'")),
            {},
            {"a": (0, 0, 0), "b": (0, 1, 0)},
        ),
        (model(CART), {"slide": 3.0}, {"world": (0, 0, 0), "cart": (3, 2, 0), "base": (0, 0, 1)}),
        # a link may be called world
        (
            world(f"<model name='m'>{WORLD}</model>").replace("1.9", "1.6"),
            {"m::j": 0.5},
            {"world": (0, 0, 0), "m::cart": (0, 0, 1.5)},
        ),
        # the root element before version 1.3
        (f"<gazebo version='1.2'><model name='m'>{placed('a', '1 0 0 0 0 0')}</model></gazebo>", {}, {"a": (1, 0, 0)}),
        # a joint with the name of a link is renamed, as by libsdformat
        (model(WHEEL, "1.4"), {"wheel_joint": 1.0}, {"a": (0, 0, 0), "wheel": (0, 1, 0)}),
        (world(OTHERS), {}, {"m::a": (0, 0, 2), "n::b": (1, 0, 2)}),
        (model(SAVED, "1.7"), {}, {"n::a": (0, 2, 1)}),  # an included model, as Gazebo 11 saves it
        (model(LIKE_SAVED), {}, {"a": (0, 0, 1), "n::b": (0, 3, 0)}),
        # before version 1.7 frame is relative_to
        (
            model(placed("a", "0 0 1 0 0 0", " frame=''") + placed("b", "0 0 1 0 0 0", " frame='a'"), "1.6"),
            {},
            {"a": (0, 0, 1), "b": (0, 0, 2)},
        ),
    ],
)
def test_places_of_links(
    tmp_path: Path, sdf: str, values: dict[str, JointValue], positions: dict[str, tuple[float, ...]]
) -> None:
    robot = read(tmp_path, sdf)
    assert (robot.links, robot.warnings) == (tuple(positions), ())
    np.testing.assert_allclose(robot.link_poses(values)[:, :3, 3], [*positions.values()], atol=1e-12)


def test_a_merged_include_has_no_name_of_its_own(tmp_path: Path) -> None:
    write(tmp_path, model('<link name="b"><pose>1 0 0 0 0 0</pose></link>'), "other/model.sdf")
    merged = '<include merge="True"><uri>other</uri><pose>0 1 0 0 0 0</pose></include>'
    robot = read(tmp_path, model(f'<pose>0 0 1 0 0 0</pose><link name="a"/>{merged}'))
    assert robot.links == ("a", "b")
    np.testing.assert_allclose(robot.link_poses({})[:, :3, 3], ((0, 0, 1), (1, 1, 1)))


LOOP = "".join(
    f'<joint name="{parent}{child}" type="fixed"><parent>{parent}</parent><child>{child}</child></joint>'
    for parent, child in ("ab", "bc", "ca")
)


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ('<link name="b"/><link name="c"/>' + LOOP, "joint 'ca': it closes a loop of links; the joint is left out"),
        (
            "<include><uri>model://none</uri></include>",
            "the included model model://none is not shown: the package 'none'",
        ),
        ("<link/>", "a <link> has no name, it is left out"),
        (
            '<link name="b"><pose rotation_format="quat_wxyz">1 2 3 0 0 0.5</pose></link>',
            "rotation_format='quat_wxyz' is neither euler_rpy nor quat_xyzw",
        ),
        ('<link name="b"><pose>1 2</pose></link>', "<pose>1 2</pose> must be 6 finite numbers"),
        ('<link name="b"><pose relative_to="x">0 0 0 0 0 0</pose></link>', "there is no frame 'x'; the world is used"),
        ('<link name="b"><pose relative_to="b">0 0 0 0 0 0</pose></link>', "the frame 'b' is relative to itself"),
        ('<joint name="j" type="fixed"><parent>a</parent><child>x</child></joint>', "joint 'j': there is no link 'x'"),
        (
            '<link name="b"/><joint name="j" type="gearbox"><parent>a</parent><child>b</child></joint>',
            "type='gearbox' is not one of revolute, continuous, prismatic, screw,",
        ),
        (
            "<include><uri>model://sun</uri></include><include><uri>ground_plane</uri><experimental:params/></include>",
            "the included model ground_plane is shown without the changes of <experimental:params>",
        ),
    ],
)
def test_what_cannot_be_used_is_left_out_with_a_warning(tmp_path: Path, content: str, message: str) -> None:
    robot = read(tmp_path, model('<link name="a"/>' + content))
    (warning,) = robot.warnings
    assert message in warning
    assert np.isfinite(robot.link_poses({})).all()


def test_links_joints_and_models_of_one_name_are_renamed(tmp_path: Path) -> None:
    shape = '<visual name="v"><geometry><sphere><radius>1</radius></sphere></geometry></visual>'
    robot = read(tmp_path, model(f'<link name="a"/><link name="a"><pose>1 0 0 0 0 0</pose>{shape}</link>'))
    assert robot.links == ("a", "a_1")
    assert robot.warnings == ("a second link is called 'a', it is called 'a_1'",)
    assert len(robot.parts[1]) == 1
    assert robot.link_poses({})[:, 0, 3].tolist() == [0, 1]
    joint = "<joint name='j' type='revolute'><parent>{}</parent><child>{}</child></joint>"
    links = "".join(f"<link name='{name}'/>" for name in "wxyz")
    robot = read(tmp_path, model(links + "".join(joint.format(*ends) for ends in ("wx", "xy", "yz"))))
    assert [*robot.joints] == ["j", "j_joint", "j_joint2"]
    assert robot.warnings == tuple(
        f"a second joint is called 'j', it is called '{name}'" for name in [*robot.joints][1:]
    )
    robot = read(tmp_path, world(2 * '<model name="m"><link name="a"/></model>'))
    assert robot.links == ("m::a", "m_::a")
    assert robot.warnings == ("a second model is called 'm', it is called 'm_'",)


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ('<sdf version="1.9"/>', "it has no links"),
        (world("<model name='m'>" * 30 + "</model>" * 30), "nested more than 20 deep"),
    ],
)
def test_errors(tmp_path: Path, content: str, message: str) -> None:
    with pytest.raises(RobotFileError, match=message):
        read(tmp_path, content)


def test_a_model_that_includes_itself_ends(tmp_path: Path) -> None:
    twice = "".join(include(".", f"<name>{name}</name>") for name in "xy")
    with pytest.raises(RobotFileError, match=r"nested more than 20 deep|includes more than 1000 models"):
        read_robot(write(tmp_path, model(f'<link name="a"/>{twice}'), "model.sdf"))


@pytest.mark.parametrize("uri", ["hand", "model://hand"])
def test_models_are_found_by_name(tmp_path: Path, uri: str) -> None:
    """Beside that which includes them, or in the folder of models beside that of a world."""
    write(tmp_path, "<sdf><model name='hand'><link name='palm'/></model></sdf>", "models/hand/model.sdf")
    robot = read_robot(write(tmp_path, model(include(uri) + "<link name='a'/>"), "models/arm/model.sdf"))
    assert (robot.links, robot.warnings) == (("hand::palm", "a"), ())
    if uri.startswith("model:"):
        assert read_robot(write(tmp_path, world(include(uri)), "worlds/w.world")).links == ("hand::palm",)


@pytest.mark.parametrize(
    ("uri", "reason"),
    [
        ("model://gone", "the package 'gone' is not above or beside the robot file"),
        ("https://fuel.gazebosim.org/1.0/models/hand", "only files, package:// and file:// can be read"),
        ("https://fuel.gazebosim.org/1.0/openrobotics/models/hand", "the package 'hand' is not above or beside"),
    ],
)
def test_an_included_model_that_is_missing_is_a_warning(tmp_path: Path, uri: str, reason: str) -> None:
    """The model's own folder, which has a ``model.config``, is not taken for it."""
    write(tmp_path, "<model><sdf>robot.sdf</sdf></model>", "model.config")
    robot = read(tmp_path, model(include(uri) + "<link name='a'/>"))
    assert robot.links == ("a",)
    (warning,) = robot.warnings
    assert f"the included model {uri} is not shown: {reason}" in warning


@pytest.mark.parametrize("uri", ["sun", "sun/", "https://fuel.gazebosim.org/1.0/OpenRobotics/models/Sun/2", "lamp"])
def test_the_sun_of_gazebo_may_be_missing_and_models_may_be_lights(tmp_path: Path, uri: str) -> None:
    write(tmp_path, "<sdf version='1.9'><light name='lamp'/></sdf>", "lamp/model.sdf")
    uri = uri if uri.startswith("https") else f"model://{uri}"
    assert read(tmp_path, model(include(uri) + "<link name='a'/>")).warnings == ()


def test_models_of_fuel_are_those_on_this_machine(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("HOME", str(tmp_path / "home"))
    url = "https://fuel.gazebosim.org/1.0/OpenRobotics/models/"
    mesh = f"<mesh><uri>{url}Big%20Hand/tip/files/meshes/a.obj</uri></mesh>"
    for version in ("9", "10"):
        folder = f"home/.gz/fuel/fuel.gazebosim.org/openrobotics/models/big hand/{version}"
        write(tmp_path, geometry(mesh).replace('"a"', f'"of_{version}"'), f"{folder}/model.sdf")
        write(tmp_path, TRIANGLE, f"{folder}/meshes/a.obj")
    write(tmp_path, model("<link name='own'/>"), "models/Small/model.sdf")
    models = enumerate(("Big Hand", "Big%20Hand/3", "Small"))
    includes = "".join(include(url + uri, f"<name>m{each}</name>") for each, uri in models)
    robot = read_robot(write(tmp_path, world(includes), "worlds/w.world"))
    assert (robot.links, robot.warnings) == (("m0::of_10", "m1::of_10", "m2::own"), ())


def test_a_material_script_is_named_in_a_warning(tmp_path: Path) -> None:
    material = "<material><script><uri>model://m/materials/scripts</uri><name>Model/Paint</name></script></material>"
    (warning,) = read(tmp_path, geometry("<box/>", material)).warnings
    assert "'Model/Paint'" in warning


def test_a_submesh_is_the_only_node_that_is_shown(tmp_path: Path) -> None:
    """Its bounds are 0 0 0 to 1 2 0, 10 above the origin. The unnamed node above it belongs to the named one."""
    start, _, end = DAE.format(asset="").partition('<node id="n">')
    node = '<node name="wheel"><node><translate>0 0 5</translate>'
    body = '<node name="body"><instance_geometry url="#g"/></node>'
    write(tmp_path, f"{start}{body}{node}{end.replace('</node>', '</node></node>', 1)}", "m.dae")
    mesh = "<mesh><uri>m.dae</uri><scale>2 2 2</scale><submesh><name>{}</name><center>{}</center></submesh></mesh>"
    for center, offset in (("false", (0, 0, 20)), ("1", (-1, -2, 0))):
        robot = read(tmp_path, geometry(mesh.format("wheel", center)))
        assert robot.warnings == ()
        ((part,),) = robot.parts
        np.testing.assert_allclose(part.X_node_part[:3, 3], offset)
    (warning,) = read(tmp_path, geometry(mesh.format("door", "false"))).warnings
    assert warning.endswith("m.dae is not shown: it has no node 'door' with geometry")
    write(tmp_path, f"{TRIANGLE}g wheel\nv 0 0 7\nf 1 2 4\n", "m.obj")
    robot = read(tmp_path, geometry(mesh.format("wheel", "false").replace(".dae", ".obj")))
    ((part,),) = robot.parts
    assert (mesh_of(part).positions[:, 2].max(), len(mesh_of(part).positions), robot.warnings) == (7.0, 3, ())
    (warning,) = read(tmp_path, geometry(mesh.format("door", "false").replace(".dae", ".obj"))).warnings
    assert warning.endswith("m.obj is not shown: it has no group 'door' with faces")


def test_a_client_warns_that_it_does_not_centre_a_mesh(tmp_path: Path) -> None:
    write(tmp_path, TRIANGLE, "m.obj")
    mesh = "<mesh><uri>m.obj</uri><submesh><center>true</center></submesh></mesh>"
    robot = read_robot_of_client(write(tmp_path, geometry(mesh), "robot.sdf"))
    (warning,) = robot.warnings
    assert warning.endswith("m.obj: <center> is ignored, the mesh is not moved")


@pytest.mark.parametrize("name", ["paint.png", "model://other/materials/textures/paint.png"])
def test_textures_of_meshes_in_the_folders_of_gazebo(tmp_path: Path, name: str) -> None:
    folder = "m" if name == "paint.png" else "other"
    write(tmp_path, png((255, 0, 0), (255, 0, 0)), f"{folder}/materials/textures/paint.png")
    write(tmp_path, "mtllib m.mtl\nvt 0 0\n" + TRIANGLE.replace("f 1 2 3", "usemtl own\nf 1/1 2/1 3/1"), "m/mesh/m.obj")
    write(tmp_path, f"newmtl own\nmap_Kd {name}\n", "m/mesh/m.mtl")
    robot = read(tmp_path, geometry("<mesh><uri>model://m/mesh/m.obj</uri></mesh>"))
    assert robot.warnings == ()
    assert robot.parts[0][0].material.base_color_texture is not None


def test_colors_and_empty_geometry_of_visuals(tmp_path: Path) -> None:
    """Three numbers have no warning, as the opacity is optional in SDF. Nor has geometry that is empty on purpose."""
    visual = "<visual name='v'><material><diffuse>{}</diffuse></material><geometry>{}</geometry></visual>"
    cases = (("255 0 0 255", "<box/>"), ("0 1 0", "<box/>"), ("1 1 1", "<empty/>"))
    visuals = "".join(visual.format(*case) for case in cases)
    robot = read(tmp_path, model(f"<link name='l'>{visuals}</link>"))
    assert [part.material.base_color for part in robot.parts[0]] == [(1, 0, 0, 1), (0, 1, 0, 1)]
    assert robot.warnings == ("link 'l', visual 'v': diffuse='255 0 0 255' is read as 0 to 255",)


def test_a_world_of_which_nothing_is_shown_says_why(tmp_path: Path) -> None:
    with pytest.raises(RobotFileError, match=r"no links: .*model://none "):
        read(tmp_path, world(include("model://none")))


PENDULUM = """<robot name="pendulum">
  <link name="rod"><visual><geometry><mesh filename="m.obj"/></geometry></visual></link>
  <link name="base"/><link name="bob"/>
  <joint name="swing" type="revolute">
    <parent link="base"/><child link="rod"/><origin xyz="0 0 1" rpy="0 0 1.5707963267948966"/><axis xyz="1 0 0"/>
  </joint>
  <joint name="spin" type="continuous">
    <parent link="rod"/><child link="bob"/><origin xyz="0 2 0"/><mimic joint="swing" multiplier="2"/>
  </joint>
  <frame name="tip" link="bob" xyz="0 0 0.5" rpy="0 0 0"/>
</robot>"""
"""Its first link is not its root."""


def test_an_included_urdf_is_a_robot(tmp_path: Path) -> None:
    write(tmp_path, TRIANGLE, "robots/m.obj")
    write(tmp_path, PENDULUM, "robots/p.urdf")
    write(tmp_path, model('<link name="a"/>'), "box.sdf")
    include = "<include><uri>robots/p.urdf</uri><name>{}</name><pose>{} 0 0 0 0 0</pose></include>"
    boxes = "".join(
        f'<include><uri>box.sdf</uri><name>box{i}</name><pose relative_to="{frame}">0.1 0 0 0 0 0</pose></include>'
        for i, frame in enumerate(("p", "p::rod", "p::swing", "p::tip"))
    )
    joint = '<joint name="weld" type="fixed"><parent>p::tip</parent><child>box3</child></joint>'
    robot = read(tmp_path, world(include.format("p", 1) + include.format("q", 5) + boxes + joint))
    assert robot.warnings == ()
    assert [len(parts) for parts in robot.parts] == [1, 0, 0, 1, 0, 0, 0, 0, 0, 0]
    X = dict(zip(robot.links, robot.link_poses({}), strict=True))
    expected = {
        "p::rod": (1, 0, 1),
        "p::base": (1, 0, 0),
        "p::bob": (-1, 0, 1),
        "q::rod": (5, 0, 1),
        "box0::a": (1.1, 0, 0),
        "box1::a": (1, 0.1, 1),
        "box2::a": (1, 0.1, 1),
        "box3::a": (-1, 0.1, 1.5),
    }
    for name, position in expected.items():
        np.testing.assert_allclose(X[name][:3, 3], position, atol=1e-12, err_msg=name)
    assert [*robot.joints] == ["p::swing", "p::spin", "q::swing", "q::spin"]
    moved = dict(zip(robot.links, robot.link_poses({"p::swing": np.pi / 2}), strict=True))
    np.testing.assert_allclose(moved["p::bob"][:3, 3], (1, 0, 3), atol=1e-12)
    np.testing.assert_allclose(moved["p::bob"][:3, 2], (-1, 0, 0), atol=1e-12)  # spin is pi
    assert np.linalg.norm(moved["box3::a"][:3, 3] - moved["p::bob"][:3, 3]) == pytest.approx(np.hypot(0.1, 0.5))
    assert read_robot_of_client(tmp_path / "robot.sdf").links == robot.links


def test_an_included_urdf_may_be_merged_or_placed_by_a_frame(tmp_path: Path) -> None:
    write(tmp_path, PENDULUM, "p.urdf")
    placed = "<placement_frame>tip</placement_frame><pose>0 0 3 0 0 0</pose>"
    include = f'<include merge="true"><uri>p.urdf</uri>{placed}</include>'
    robot = read(tmp_path, model(f'<link name="a"/>{include}'))
    assert robot.links == ("a", "rod", "base", "bob")
    np.testing.assert_allclose(robot.link_poses({})[3, :3, 3], (0, 0, 2.5), atol=1e-12)


@pytest.mark.parametrize(
    ("urdf", "reason"),
    [
        ("<robot/>", "it has no links"),
        ('<robot xmlns:xacro="x"><xacro:arm/><link name="b"/></robot>', "xacro"),
        ("<robot><link name='a'/></robot>", "there is another 'a'"),
        (
            "<robot><link name='b'/><joint name='j' type='fixed'><parent link='b'/><child link='b'/></joint></robot>",
            "circle",
        ),
    ],
)
def test_an_included_urdf_that_is_no_robot_is_left_out(tmp_path: Path, urdf: str, reason: str) -> None:
    write(tmp_path, urdf, "p.urdf")
    robot = read(tmp_path, model('<link name="a"/><include merge="true"><uri>p.urdf</uri></include>'))
    assert robot.links == ("a",)
    assert reason in robot.warnings[-1]


@pytest.mark.parametrize("end", ["left", "left::__model__", "left::inner", "left::inner::__model__", "left::inner::f"])
def test_joints_join_the_links_of_models_and_frames(tmp_path: Path, end: str) -> None:
    inner = '<model name="inner"><pose>0 0 1 0 0 0</pose><link name="a"/><frame name="f"/></model>'
    right = '<model name="right"><pose>0 1 0 0 0 0</pose><link name="b"/></model>'
    ends = f"<parent>{end}</parent><child>right::__model__</child>"
    joint = f'<joint name="j" type="revolute">{ends}<axis><xyz>0 0 1</xyz></axis></joint>'
    robot = read(tmp_path, model(f'<model name="left">{inner}</model>{right}{joint}'))
    assert (robot.links, [*robot.joints], robot.warnings) == (("left::inner::a", "right::b"), ["j"], ())
    np.testing.assert_allclose(robot.link_poses({"j": 1.0})[:, :3, 3], ((0, 0, 1), (0, 1, 0)), atol=1e-12)


@pytest.mark.parametrize(
    "uri", ["model://ground_plane", "ground_plane", "https://fuel.gazebosim.org/1.0/OpenRobotics/models/Ground Plane/1"]
)
def test_the_ground_plane_of_gazebo_may_be_missing(tmp_path: Path, uri: str) -> None:
    sun = "<include><uri>model://sun</uri></include>"
    robot = read(tmp_path, world(f"<include><uri>{uri}</uri><pose>0 0 -1 0 0 0</pose></include>{sun}"))
    assert (robot.links, robot.warnings) == (("ground_plane::link",), ())
    assert [part.shape for part in robot.parts[0]] == [Box((100.0, 100.0, 0.0))]
    np.testing.assert_allclose(robot.link_poses({})[0, :3, 3], (0, 0, -1))
    write(tmp_path, model("<link name='a'/>"), "ground_plane/model.sdf")
    assert (read_robot(tmp_path / "robot.sdf").links == ("m::a",)) != uri.startswith("https")


@pytest.mark.parametrize(
    ("version", "kind", "content", "value", "pose"),
    [
        ("1.9", "screw", "", 1.0, (0.0348, -0.0059, 1.1552, 0.2219, 0.0250, 1.2927)),
        ("1.9", "screw", "<thread_pitch>0.1</thread_pitch>", 1.0, (-2.1835, 0.3696, -8.7517, 0.2219, 0.025, 1.2927)),
        (
            "1.10",
            "screw",
            "<screw_thread_pitch>0.2</screw_thread_pitch><thread_pitch>0.1</thread_pitch>",
            1.0,
            (0.007, -0.0012, 1.031, 0.2219, 0.025, 1.2927),
        ),
        ("1.4", "screw", "<thread_pitch>0.1</thread_pitch>", 1.0, (0, 0, -9, 0.1, 0.2, 1.3)),
        ("1.9", "universal", "<axis2><xyz>1 0 0</xyz></axis2>", (0.4, 0.3), (0, 0, 1, 0.4701, 0.1454, 0.7024)),
    ],
)
def test_screw_and_universal_joints_move_as_in_drake(
    tmp_path: Path, version: str, kind: str, content: str, value: JointValue, pose: tuple[float, ...]
) -> None:
    """Poses of Drake 1.58."""
    links = '<link name="a"/><link name="b"><pose>0 0 1 0.1 0.2 0.3</pose></link>'
    ends = "<parent>a</parent><child>b</child><axis><xyz>0 0 1</xyz></axis>"
    robot = read(tmp_path, model(f'{links}<joint name="j" type="{kind}">{ends}{content}</joint>', version))
    assert robot.warnings == ()
    X = robot.link_poses({"j": value})[1]
    np.testing.assert_allclose(X, pose_of_rpy(pose[:3], pose[3:]), atol=2e-4)


@pytest.mark.parametrize("element", ["actor", "population", "road"])
def test_what_a_world_has_beside_models_is_a_warning(tmp_path: Path, element: str) -> None:
    robot = read(tmp_path, world(f'<light name="l"/><{element} name="x"/><model name="m">{placed("a")}</model>'))
    assert robot.warnings == (f"{element} 'x' is not shown",)
