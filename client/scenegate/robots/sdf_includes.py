"""Models that an SDF document includes: SDF and URDF files, and two models that come with Gazebo."""

from dataclasses import replace
from pathlib import Path
from typing import Final

from scenegate.robots.link_model import Link, LinkGeometry, LinkJoint, LinkModel, MeshReference
from scenegate.robots.robot_errors import RobotFileError, RobotFileLimits
from scenegate.robots.robot_files import RobotFiles
from scenegate.robots.ros_packages import split_url
from scenegate.robots.xacro_args import expand_args
from scenegate.robots.xml_text import Element, parse_xml, uses_xacro

_GAZEBO_MODELS: Final = {
    "ground_plane": b"""<sdf version="1.6"><model name="ground_plane"><link name="link">
    <visual name="visual"><geometry><plane><size>100 100</size></plane></geometry>
    <material><script><name>Gazebo/Grey</name></script></material></visual>
    <collision name="collision"><geometry><plane><size>100 100</size></plane></geometry></collision>
    </link></model></sdf>""",
    "sun": b"<sdf><light/></sdf>",
}
"""Models of each Gazebo installation by name, as Gazebo's look; used where there is no such file."""


def read_included(
    uri: str, folder: Path, files: RobotFiles, limits: RobotFileLimits, warnings: list[str]
) -> tuple[Element, Path]:
    """Return the root element of an included file, and its folder, given the folder of the file that includes it.

    Raises RobotFileError or OSError if there is no such file, or it cannot be read.
    """
    try:
        path = files.find_model(uri, folder)
    except RobotFileError:
        # The last element of a path may be a version: https://fuel.gazebosim.org/1.0/OpenRobotics/models/Ground Plane/2
        ends = [end.replace(" ", "_").replace("%20", "_") for end in uri.lower().rstrip("/").split("/")[-2:]]
        name = next((end for end in ends if end in _GAZEBO_MODELS), None)
        if name is None:
            raise
        return parse_xml(_GAZEBO_MODELS[name], limits.max_elements, warnings), folder
    root = parse_xml(files.read(path), limits.max_elements, warnings)
    expand_args(root, files.xacro_args, files.used_args, warnings)
    if root.tag == "robot" and uses_xacro(root):
        raise RobotFileError("it has xacro elements: expand it into a URDF file first")
    return root, path.parent


def prefixed(model: LinkModel, prefix: str, folder: Path) -> LinkModel:
    """Return a model with a prefix for its names, and with relative file names joined to a folder."""

    def renamed(joint: LinkJoint) -> LinkJoint:
        motion = joint.motion
        if motion is not None:
            mimic = motion.mimic and replace(motion.mimic, joint=prefix + motion.mimic.joint)
            motion = replace(motion, name=prefix + joint.name, mimic=mimic)
        name, parent, child = (prefix + each for each in (joint.name, joint.parent, joint.child))
        return replace(joint, name=name, parent=parent, child=child, motion=motion)

    links = (
        Link(prefix + link.name, tuple(in_folder(geometry, folder) for geometry in link.geometries))
        for link in model.links
    )
    return LinkModel(model.name, tuple(links), tuple(map(renamed, model.joints)))


def in_folder(geometry: LinkGeometry, folder: Path) -> LinkGeometry:
    """Return a geometry with the relative file name of its mesh, if it has one, joined to a folder."""
    shape = geometry.shape
    if not isinstance(shape, MeshReference) or split_url(shape.filename)[0]:
        return geometry
    return replace(geometry, shape=replace(shape, filename=str(folder / shape.filename)))
