"""Parses SDF (http://sdformat.org/spec), models and worlds: links, joints, geometry, nested and included models.

Elements that are invalid are left out or get a default, with a warning. Links of nested models are called
``model::link``. All models become one robot.
"""

from dataclasses import dataclass, replace
from itertools import islice
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from scenegate.name_hint import name_hint
from scenegate.regular_files import reason_of
from scenegate.robots.link_model import Link, LinkJoint, LinkKinematics, LinkModel
from scenegate.robots.robot import NEUTRAL, GeometryUse, Joint, JointKind
from scenegate.robots.robot_errors import RobotFileError, RobotFileLimits, check_count, no_links
from scenegate.robots.robot_files import RobotFiles
from scenegate.robots.sdf_frames import WORLD, Frame, Frames, limits_of, read_pose, thread_pitch
from scenegate.robots.sdf_geometry import read_geometries
from scenegate.robots.sdf_includes import in_folder, prefixed, read_included
from scenegate.robots.urdf import parse_urdf
from scenegate.robots.xml_text import (
    Element,
    attribute,
    children_as_attributes,
    is_true,
    joint_kind,
    numbers,
    pose_of_rpy,
    read_mimic,
    unit_axis,
)

_KINDS: Final[dict[str, JointKind | None]] = {
    "revolute": "revolute",
    "continuous": "revolute",
    "prismatic": "prismatic",
    "screw": "revolute",
    "universal": "universal",
    "ball": "ball",
    "fixed": None,
}
"""Kind of a joint, by the attribute ``type``; None: it does not move."""
_SEPARATOR: Final = "::"
_MODEL_FRAME: Final = "::__model__"
"""End of the name of another model's own frame."""
"""Separator between the name of a model and a name in it."""
MAX_INCLUDES: Final = 1000
"""Maximum number of included models: worlds have fewer than 100."""
MAX_MODEL_DEPTH: Final = 20
"""Maximum depth of nested and included models."""
_JOINT_FRAME_VERSION: Final = (1, 5)
"""First version in which a joint's axis is in the joint's frame by default; before, in the model's."""


@dataclass(frozen=True, slots=True)
class _Scope:
    """A model whose elements are read."""

    name: str
    """Full name of the model; ``world`` at the top."""
    base: str
    """Full name of the frame that poses are relative to by default, ``__model__``."""
    folder: Path
    """Folder of the file that the model is in."""
    version: tuple[int, ...]
    depth: int

    def full_name(self, name: str) -> str:
        """Return the full name of something in the model. ``world`` and a document's own names stay as they are."""
        return name if WORLD in (self.name, name) else f"{self.name}{_SEPARATOR}{name}"

    def frame(self, name: str) -> str:
        """Return the full name of a frame, given the name in the file; without one, of the model's own."""
        name = name.removesuffix(_MODEL_FRAME)
        return self.full_name(name) if name not in ("", "__model__") else self.base


def parse_sdf(
    root: Element, files: RobotFiles, use: GeometryUse, limits: RobotFileLimits, warnings: list[str]
) -> LinkModel:
    """Return the content of an SDF document; geometry of the other use is not read. Raises RobotFileError."""
    return _SdfReader(files, use, limits, warnings).read(root)


class _SdfReader:
    """Reads one document with its includes."""

    def __init__(self, files: RobotFiles, use: GeometryUse, limits: RobotFileLimits, warnings: list[str]) -> None:
        self._files = files
        self._use = use
        self._limits = limits
        self._warnings = warnings
        self._frames = Frames(warnings)
        self._links: dict[str, tuple[Element, _Scope] | Link] = {}
        """Links by full name; those of included URDF files are parsed already, as are their joints."""
        self._joints: dict[str, tuple[Element, _Scope] | LinkJoint] = {}
        self._include_count = 0

    def read(self, root: Element) -> LinkModel:
        scope = _Scope(WORLD, WORLD, self._files.path.parent, _version(root), 0)
        worlds, models = root.findall("world"), root.findall("model")
        name = attribute((*worlds, *models, root)[0], "name")
        if not worlds and len(models) == 1:
            self._add_model(models[0], scope, name, merge=True)
        else:
            for world in worlds or [root]:
                self._add_content(world, scope)
        if not self._links:
            raise no_links(self._warnings)
        count = sum(
            len(link.geometries if isinstance(link, Link) else link[0].findall(self._use))
            for link in self._links.values()
        )
        check_count(count, self._limits.max_geometries, "geometries")
        links = tuple(link if isinstance(link, Link) else self._link(name, *link) for name, link in self._links.items())
        joints, X_robot_root = self._tree()
        if WORLD not in self._links and any(joint.parent == WORLD for joint in joints):
            links = (Link(WORLD, ()), *links)
        return LinkModel(name, links, joints, X_robot_root)

    def _add_content(self, element: Element, scope: _Scope) -> None:
        """Add the models, links, joints and frames of a world or model."""
        if scope.depth > MAX_MODEL_DEPTH:
            raise RobotFileError(f"models are nested more than {MAX_MODEL_DEPTH} deep, which is the limit")
        for child in sorted(element, key=lambda each: each.tag == "joint"):  # joints last: see _add_joint
            match child.tag:
                case "model":
                    self._add_model(child, scope, attribute(child, "name"))
                case "include":
                    self._add_include(child, scope)
                case "link":
                    self._add_link(child, scope)
                case "joint":
                    self._add_joint(child, scope)
                case "frame":
                    self._add_frame(child, scope)
                case "actor" | "population" | "road":
                    self._warnings.append(f"{child.tag} {attribute(child, 'name')[:60]!r} is not shown")

    def _add_model(
        self, model: Element, scope: _Scope, name: str, placed: Element | None = None, merge: bool = False
    ) -> None:
        """Add a model. See ``_place``."""
        inner, frame = self._place(model, scope, name, placed, merge)
        first_link = next((attribute(link, "name") for link in model.findall("link")), "")
        canonical = attribute(model, "canonical_link") or first_link
        placement = attribute(model, "placement_frame")
        if placed is not None:
            placement = (placed.findtext("placement_frame") or placement).strip()
        frame = replace(frame, placement=inner.frame(placement) if placement else "")
        self._frames.add(inner.base, replace(frame, attached_to=inner.full_name(canonical)))
        link_count = len(self._links)
        self._add_content(model, inner)
        if not canonical:  # that of the first nested model
            canonical = next(islice(self._links, link_count, None), WORLD)
            self._frames.add(inner.base, replace(frame, attached_to=canonical))

    def _add_urdf(self, robot: Element, scope: _Scope, name: str, include: Element, merge: bool) -> None:
        """Add an included URDF file. Its model frame is that of its first link without a parent.

        Raises RobotFileError if it has no tree of links, or a name that there is already.
        """
        inner, frame = self._place(robot, scope, name, include, merge)
        model = parse_urdf(robot, self._use, self._limits, self._warnings)
        model = prefixed(model, "" if merge and scope.name == WORLD else inner.name + _SEPARATOR, scope.folder)
        check_count(len(self._links) + len(model.links), self._limits.max_links, "links")
        check_count(len(self._joints) + len(model.joints), self._limits.max_links, "joints")
        if used := {*model.link_names} & {*self._links} | {each.name for each in model.joints} & {*self._joints}:
            raise RobotFileError(f"there is another {min(used)!r}")
        poses = LinkKinematics(model).link_poses({j.name: j.motion.default for j in model.joints if j.motion})
        children = {joint.child for joint in model.joints}
        root = next(link for link in model.link_names if link not in children)
        placement = (include.findtext("placement_frame") or "").strip()
        placement = inner.frame(placement) if placement else ""
        self._frames.add(inner.base, replace(frame, attached_to=root, placement=placement))
        for joint in model.joints:
            self._joints[joint.name] = joint
            self._frames.add(joint.name, Frame(joint.X_parent_joint, joint.parent, joint.child))
        for link, X in zip(model.links, poses, strict=True):
            self._links[link.name] = link
            self._frames.add(link.name, Frame(X, inner.base, link.name))
        for element in robot.findall("frame"):  # Drake's
            xyz, rpy = (
                numbers(element, each, (0.0, 0.0, 0.0), f"frame {attribute(element, 'name')!r}", self._warnings)
                for each in ("xyz", "rpy")
            )
            link_name = inner.frame(attribute(element, "link"))
            frame = Frame(pose_of_rpy(xyz, rpy), link_name, link_name)
            self._frames.add(inner.full_name(attribute(element, "name")), frame)

    def _place(
        self, model: Element, scope: _Scope, name: str, placed: Element | None, merge: bool
    ) -> tuple[_Scope, Frame]:
        """Return the scope of a model with a name, and its frame, attached to nothing so far.

        ``placed``: the ``<include>`` whose pose and placement frame override the model's. ``merge``: names in the model
        do not start with the model's name.
        """
        full_name = scope.full_name(name or f"model_{len(self._links)}")
        frame = f"{full_name}{_SEPARATOR}__merged__" if merge else full_name
        unique = frame
        while unique in self._frames:
            unique += "_"
        if unique != frame and not merge:
            self._warnings.append(f"a second model is called {full_name!r}, it is called {unique!r}")
            full_name = unique
        place = placed if placed is not None and placed.find("pose") is not None else model
        X, relative_to = read_pose(place, f"model {name!r}", self._warnings)
        inner = _Scope(scope.name if merge else full_name, unique, scope.folder, scope.version, scope.depth + 1)
        return inner, Frame(X, scope.frame(relative_to), "")

    def _add_include(self, include: Element, scope: _Scope) -> None:
        uri = (include.findtext("uri") or "").strip()
        self._include_count += 1
        if self._include_count > MAX_INCLUDES:
            raise RobotFileError(f"it includes more than {MAX_INCLUDES} models, which is the limit")
        try:
            root, folder = read_included(uri, scope.folder, self._files, self._limits, self._warnings)
            model = root if root.tag in ("model", "robot") else root.find("model")
            if model is None:
                if root.find("light") is None:  # lights are not used anywhere
                    self._warnings.append(f"the included file {uri[:200]} has no <model>, it is not shown")
                return
            name = (include.findtext("name") or attribute(model, "name")).strip()
            merge = is_true(attribute(include, "merge"))
            inner = _Scope(scope.name, scope.base, folder, _version(root), scope.depth)
            if model.tag == "robot":
                self._add_urdf(model, inner, name, include, merge)
                return
        except (OSError, RobotFileError) as error:
            self._warnings.append(f"the included model {uri[:200]} is not shown: {reason_of(error)}")
            return
        if include.find("experimental:params") is not None:
            self._warnings.append(
                f"the included model {uri[:200]} is shown without the changes of <experimental:params>"
            )
        self._add_model(model, inner, name, include, merge)

    def _add_link(self, link: Element, scope: _Scope) -> None:
        name = attribute(link, "name")
        if not name:
            self._warnings.append("a <link> has no name, it is left out")
            return
        full_name = scope.full_name(name)
        if full_name in self._links:
            unique = f"{full_name}_{len(self._links)}"
            while unique in self._frames:
                unique += "_"
            self._warnings.append(f"a second link is called {full_name!r}, it is called {unique!r}")
            full_name = unique
        check_count(len(self._links) + 1, self._limits.max_links, "links")
        X, relative_to = read_pose(link, f"link {full_name!r}", self._warnings)
        self._frames.add(full_name, Frame(X, scope.frame(relative_to), full_name))
        self._links[full_name] = (link, scope)

    def _add_joint(self, joint: Element, scope: _Scope) -> None:
        name = full_name = scope.full_name(attribute(joint, "name") or f"joint_{len(self._joints)}")
        if name in self._frames:  # a link, model or joint of that name; libsdformat renames the joint, too
            full_name = f"{name}_joint"
            number = len(self._joints)
            while full_name in self._frames:
                full_name = f"{name}_joint{number}"
                number += 1
        if name in self._joints:
            self._warnings.append(f"a second joint is called {name!r}, it is called {full_name!r}")
        check_count(len(self._joints) + 1, self._limits.max_links, "joints")
        child = scope.frame((joint.findtext("child") or "").strip())
        X, relative_to = read_pose(joint, f"joint {full_name!r}", self._warnings)
        self._frames.add(full_name, Frame(X, scope.frame(relative_to) if relative_to else child, child))
        self._joints[full_name] = (joint, scope)

    def _add_frame(self, frame: Element, scope: _Scope) -> None:
        X, relative_to = read_pose(frame, f"frame {attribute(frame, 'name')!r}", self._warnings)
        attached = attribute(frame, "attached_to")
        attached_to = scope.frame(attached)
        base = scope.frame(relative_to) if relative_to else attached_to
        name = attribute(frame, "name")
        if scope.version < (1, 8):  # Gazebo 11 saves an included model as frames such as ``model::__model__``
            name = name.removesuffix(_MODEL_FRAME)
        self._frames.add(scope.full_name(name), Frame(X, base, attached_to))

    def _link(self, name: str, element: Element, scope: _Scope) -> Link:
        def X_link(frame: str) -> NDArray[np.float64]:
            X_world_link = self._frames.X_world(name)
            return np.linalg.inv(X_world_link) @ self._frames.X_world(scope.frame(frame))

        geometries = read_geometries(element, name, self._use, X_link, self._warnings)
        return Link(name, tuple(in_folder(geometry, scope.folder) for geometry in geometries))

    def _tree(self) -> tuple[tuple[LinkJoint, ...], dict[str, NDArray[np.float64]]]:
        """Return the joints that make a tree, and the poses of the links that have no parent.

        A joint whose child has a parent already closes a loop, which SDF allows: it is left out.
        """
        joints: dict[str, LinkJoint] = {}
        parent_of: dict[str, str] = {}
        for name, joint in self._joints.items():
            ends = (joint.parent, joint.child) if isinstance(joint, LinkJoint) else self._ends(name, *joint)
            if ends is None:
                continue
            parent, child = ends
            above: str | None = parent
            while above is not None and above != child:
                above = parent_of.get(above)
            if child in parent_of or above == child:
                self._warnings.append(f"joint {name!r}: it closes a loop of links; the joint is left out")
                continue
            if not isinstance(joint, LinkJoint):
                joint = self._joint(name, *joint, parent, child)
            if parent != WORLD or joint.motion is not None:
                parent_of[child] = parent
                joints[name] = joint
        roots = {name: self._frames.X_world(name) for name in self._links if name not in parent_of}
        return tuple(joints.values()), roots

    def _ends(self, name: str, element: Element, scope: _Scope) -> tuple[str, str] | None:
        """Return a joint's parent (a link or ``world``) and child; None, with a warning, if one does not exist."""
        ends = []
        for tag in ("parent", "child"):
            frame = scope.frame((element.findtext(tag) or "-").strip())
            link = self._frames.link_of(frame) if frame in self._frames else ""
            if not link or (tag == "child" and link == WORLD):
                hint = name_hint(frame, self._links)
                self._warnings.append(f"joint {name!r}: there is no link {frame[:60]!r}{hint}; the joint is left out")
                return None
            ends.append(link)
        return ends[0], ends[1]

    def _joint(self, name: str, element: Element, scope: _Scope, parent: str, child: str) -> LinkJoint:
        where = f"joint {name!r}"
        X_world_parent, X_world_joint = self._frames.X_world(parent), self._frames.X_world(name)
        sdf_type = attribute(element, "type")
        kind = joint_kind(sdf_type, _KINDS, where, self._warnings)
        axis = element.find("axis")
        direction, kind = self._axis(axis, scope, X_world_joint, kind, where)
        second_axis = (0.0, 1.0, 0.0)
        if kind == "universal":
            second_axis, kind = self._axis(element.find("axis2"), scope, X_world_joint, kind, where)
        motion = None
        if kind is not None:
            mimic = axis.find("mimic") if axis is not None else None
            rule = read_mimic(None if mimic is None else children_as_attributes(mimic), where, self._warnings)
            rule = None if rule is None else replace(rule, joint=scope.full_name(rule.joint))
            limits = limits_of(axis, where, self._warnings) if kind != "universal" else None
            motion = Joint(name, kind, NEUTRAL[kind], limits, rule)
        return LinkJoint(
            name,
            parent,
            child,
            np.linalg.inv(X_world_parent) @ X_world_joint,
            direction,
            motion,
            np.linalg.inv(X_world_joint) @ self._frames.X_world(child),
            thread_pitch(element, where, self._warnings) if sdf_type == "screw" else 0.0,
            second_axis,
        )

    def _axis(
        self,
        axis: Element | None,
        scope: _Scope,
        X_world_joint: NDArray[np.float64],
        kind: JointKind | None,
        where: str,
    ) -> tuple[tuple[float, float, float], JointKind | None]:
        """Return the unit vector of an axis in the joint's frame, and the joint's kind; see ``unit_axis``."""
        if axis is None:
            return (0.0, 0.0, 1.0), kind
        direction = np.array(numbers(children_as_attributes(axis), "xyz", (0.0, 0.0, 1.0), where, self._warnings))
        frame = attribute(axis.find("xyz"), "expressed_in")
        in_model = is_true(axis.findtext("use_parent_model_frame"))
        if frame or in_model or scope.version < _JOINT_FRAME_VERSION:
            X_world_frame = self._frames.X_world(scope.frame(frame))
            direction = X_world_joint[:3, :3].T @ X_world_frame[:3, :3] @ direction
        x, y, z = direction.tolist()
        return unit_axis((x, y, z), kind, where, self._warnings)


def _version(root: Element) -> tuple[int, ...]:
    """Return the version of a document as integers; ``_JOINT_FRAME_VERSION`` if it names none."""
    try:
        return tuple(int(number) for number in attribute(root, "version").split("."))
    except ValueError:
        return _JOINT_FRAME_VERSION
