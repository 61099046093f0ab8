"""Reads MJCF. The package ``mujoco`` compiles the file, in a limited child process, and computes the kinematics."""

import os
import re
import threading
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any, Final

import msgspec
import numpy as np
from numpy.typing import NDArray

from gateway.files.robots.mjcf_geometry import COLLISION_GROUP, MjcfGeometry
from gateway.files.robots.robot import Robot, RobotLimits
from gateway.runtime.workers.limited_process import ProcessFailed, ProcessLimits, call_limited
from scenegate.name_hint import name_hint
from scenegate.robots.robot import GeometryUse, Joint, JointKind, Mimic
from scenegate.robots.robot_errors import RobotFileError, check_count
from scenegate.robots.robot_files import RobotFiles
from scenegate.robots.xml_text import Element, parse_xml

_OUT_OF_MEMORY: Final = ("Could not allocate memory", "Caught an unknown exception!")
"""Parts of MuJoCo's error messages when memory runs out; the second one is for std::bad_alloc."""
_DROPPED: Final = re.compile(
    r"Element '(composite|flexvert)'|plugin mujoco\.elasticity|invalid keyword: 'vert'|attribute: 'internal'"
    r"|no longer integrated"
)
"""Errors of MuJoCo 4 for what MuJoCo 3 reads."""
_NOTES: Final = (" is deprecated ", "may prevent the model from being saved")
"""Parts of MuJoCo's warnings that do not concern images: about masses, and about what is attached without a prefix."""
_output_decoder: Final = msgspec.msgpack.Decoder(tuple[bytes, list[str]] | str)
_VALUE_COUNTS: Final[dict[JointKind, int]] = {"floating": 7, "ball": 4, "prismatic": 1, "revolute": 1}


def read_mjcf(root: Element, files: RobotFiles, use: GeometryUse, keyframe: str, limits: RobotLimits) -> Robot:
    """Return the robot of an MJCF file. Its links are MuJoCo's bodies; its geometry in the world is the link ``world``.

    ``keyframe``: name of the ``<key>`` with the joints' default values; empty: those of the model. Raises
    RobotFileError if MuJoCo cannot compile it, it has no such keyframe, or a limit is exceeded; ImportError without
    ``mujoco``.
    """
    try:
        import mujoco
    except ImportError as error:
        needed = f"MJCF files need the package mujoco ({error}): pip install 'scenegate[robots]'; URDF files do not"
        raise ImportError(needed) from None
    read_mjcf_files(root, files, limits)
    model, compiler_warnings = _compiled(mujoco, files.path, limits)
    check_count(model.nbody, limits.max_links, "bodies")
    check_count(model.njnt, limits.max_links, "joints")
    check_count(model.ngeom, limits.max_geometries, "geometries")
    check_count(model.nmeshvert + model.nhfielddata, limits.mesh.max_vertices, "vertices")
    check_count(model.nmeshface + 2 * model.nhfielddata, limits.mesh.max_elements, "triangles")
    links = _unique_names(mujoco, model, mujoco.mjtObj.mjOBJ_BODY, model.nbody, "body")
    joints = _joints(mujoco, model, _keyframe_values(mujoco, model, keyframe))
    converter = MjcfGeometry(mujoco, model, limits.mesh.max_vertices)
    parts = converter.parts_by_body(use)
    is_shown = (model.tendon_group < COLLISION_GROUP) & (model.tendon_rgba[:, 3] > 0.0)
    tendons = np.count_nonzero(is_shown & (model.wrap_type[model.tendon_adr] != mujoco.mjtWrap.mjWRAP_JOINT))
    left_out = ((model.nskin, "skins"), (model.nflex, "flexes"), (tendons, "spatial tendons"))
    warnings = tuple(f"{count} {what} are not shown" for count, what in left_out if count)
    name = root.get("model") or files.path.stem
    kinematics = _Kinematics(mujoco, model, joints)
    notes = tuple(text for text in compiler_warnings if any(part in text for part in _NOTES))
    warnings = (*warnings, *converter.warnings, *(text for text in compiler_warnings if text not in notes))
    return Robot(name, links, joints, parts, kinematics, warnings, notes, files.digests)


def _compiled(mujoco: Any, path: Path, limits: RobotLimits) -> tuple[Any, list[str]]:
    """Compile a file in a child process; return an ``MjModel``, and the compiler's warnings."""
    arguments = (str(path), limits.max_model_bytes)
    process_limits = ProcessLimits(limits.max_compiler_bytes, limits.max_compiler_seconds)
    try:
        result = _output_decoder.decode(
            call_limited("gateway.files.parsers.mjcf:compile_file", arguments, process_limits)
        )
    except ProcessFailed as failure:
        result = ""  # no error message: it ran out of memory or crashed
        if failure.timed_out:
            result = f"it takes longer than max_compiler_seconds = {process_limits.seconds}"
    if isinstance(result, str):
        if not result or any(message in result for message in _OUT_OF_MEMORY):
            result = f"it needs more than max_compiler_bytes = {process_limits.memory_bytes} of memory, or crashes"
        if _DROPPED.search(result):
            result = f"{result}; MuJoCo 3 reads this, version {mujoco.__version__} no more: pip install 'mujoco<4'"
        raise RobotFileError(f"MuJoCo cannot compile it: {result}")
    model, warnings = result
    return mujoco.MjModel.from_binary_path("model.mjb", {"model.mjb": model}), warnings


class _Kinematics:
    """MuJoCo's forward kinematics. Thread-safe."""

    def __init__(self, mujoco: Any, model: Any, joints: Iterable[str]) -> None:
        self._mujoco = mujoco
        self._model = model
        self._addresses = dict(zip(joints, map(int, model.jnt_qposadr), strict=True))
        """Index of each joint's first value in ``qpos``."""
        on_warning = mujoco.get_mju_user_warning()
        mujoco.set_mju_user_warning(lambda text: None)  # it would print and log again what the compiler reported
        try:
            self._data = mujoco.MjData(model)
        finally:
            mujoco.set_mju_user_warning(on_warning)
        self._lock = threading.Lock()
        """Protects ``_data``, which each call overwrites."""

    def link_poses(self, values: Mapping[str, tuple[float, ...]]) -> NDArray[np.float64]:
        """Return X_robot_link, (number of links, 4, 4) float64, for the values of all joints."""
        X_robot_link = np.tile(np.eye(4), (self._model.nbody, 1, 1))
        with self._lock:
            for name, address in self._addresses.items():
                self._data.qpos[address : address + len(values[name])] = values[name]
            self._mujoco.mj_kinematics(self._model, self._data)
            X_robot_link[:, :3, :3] = self._data.xmat.reshape(-1, 3, 3)
            X_robot_link[:, :3, 3] = self._data.xpos
        return X_robot_link


def _keyframe_values(mujoco: Any, model: Any, keyframe: str) -> NDArray[np.float64]:
    """Return the joint values of a keyframe, (nq,) float64; those of the model if the name is empty."""
    if not keyframe:
        values: NDArray[np.float64] = model.qpos0
        return values
    index = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_KEY, keyframe)
    if index < 0:
        names = [mujoco.mj_id2name(model, mujoco.mjtObj.mjOBJ_KEY, key) for key in range(model.nkey)]
        raise RobotFileError(f"it has no keyframe {keyframe!r}{name_hint(keyframe, filter(None, names))}")
    return np.asarray(model.key_qpos[index], np.float64)


def _joints(mujoco: Any, model: Any, defaults: NDArray[np.float64]) -> dict[str, Joint]:
    """Return the joints by name, in the model's order, with their default values, (nq,)."""
    kinds: dict[int, JointKind] = {
        int(mujoco.mjtJoint.mjJNT_FREE): "floating",
        int(mujoco.mjtJoint.mjJNT_BALL): "ball",
        int(mujoco.mjtJoint.mjJNT_SLIDE): "prismatic",
        int(mujoco.mjtJoint.mjJNT_HINGE): "revolute",
    }
    names = _unique_names(mujoco, model, mujoco.mjtObj.mjOBJ_JOINT, model.njnt, "joint")
    mimics = _mimics(mujoco, model, names)
    joints = {}
    for index, name in enumerate(names):
        kind, address = kinds[int(model.jnt_type[index])], int(model.jnt_qposadr[index])
        default = tuple(defaults[address : address + _VALUE_COUNTS[kind]].tolist())
        lower, upper = model.jnt_range[index].tolist()
        limits = (lower, upper) if model.jnt_limited[index] and len(default) == 1 else None
        joints[name] = Joint(name, kind, default, limits, mimics.get(name))
    return joints


def _mimics(mujoco: Any, model: Any, names: tuple[str, ...]) -> dict[str, Mimic]:
    """Return the joints that follow another one by an equality constraint (``<equality><joint polycoef>``).

    A simulation enforces such constraints softly; here they hold exactly. A constraint is left out if its follower
    already follows a joint, or if it would close a cycle.
    """
    mimics: dict[str, Mimic] = {}
    for index in range(model.neq):
        follower, leader = int(model.eq_obj1id[index]), int(model.eq_obj2id[index])
        if int(model.eq_type[index]) != int(mujoco.mjtEq.mjEQ_JOINT) or not model.eq_active0[index] or leader < 0:
            continue
        followed = names[leader]
        while followed != names[follower] and followed in mimics:
            followed = mimics[followed].joint
        if names[follower] in mimics or followed == names[follower]:
            continue
        offset, *others = model.eq_data[index][:5].tolist()
        qpos0_of_follower, qpos0_of_leader = (float(model.qpos0[model.jnt_qposadr[i]]) for i in (follower, leader))
        mimics[names[follower]] = Mimic(names[leader], (qpos0_of_follower + offset, *others), qpos0_of_leader)
    return mimics


def _unique_names(mujoco: Any, model: Any, kind: Any, count: int, prefix: str) -> tuple[str, ...]:
    """Return the names of a model's objects of one kind; an object without a name gets one such as ``body_7``."""
    names = [mujoco.mj_id2name(model, kind, index) for index in range(count)]
    used = {name for name in names if name}
    for index, name in enumerate(names):
        if not name:
            names[index] = f"{prefix}_{index}"
            while names[index] in used:
                names[index] += "_"
            used.add(names[index])
    return tuple(names)


MAX_FOLDERS: Final = 16
"""Maximum number of folders in which an asset is searched: robots have at most four."""
MAX_INCLUDES: Final = 1000
"""Maximum number of ``<include>`` elements that are followed: robots have fewer than 20."""


def read_mjcf_files(root: Element, files: RobotFiles, limits: RobotLimits) -> None:
    """Read the files that a document and its includes refer to, where they exist. MuJoCo reads them again.

    Raises RobotFileError if one is larger than allowed, or they have too many elements.
    """
    folder = files.path.parent
    documents = list(_included(root, files, limits))
    folders = {folder}
    for document in documents:
        for compiler in document.iter("compiler"):
            for attribute in ("assetdir", "meshdir", "texturedir"):
                folders.add(folder / (compiler.get(attribute) or ""))
    if len(folders) > MAX_FOLDERS:
        raise RobotFileError(f"its compiler elements name more than {MAX_FOLDERS} folders")
    for document in documents:
        for element in document.iter():
            for attribute, name in element.items():
                if attribute.startswith("file") and name and element.tag != "include":  # file, fileright, fileup …
                    paths = (each / name for each in sorted(folders))
                    # MuJoCo would wait for a named pipe, which ``read`` refuses.
                    if path := next((path for path in paths if path.exists() and not path.is_dir()), None):
                        files.read(path)


def _included(root: Element, files: RobotFiles, limits: RobotLimits) -> Iterator[Element]:
    """Yield the document and those that it includes, each file once. MuJoCo reports repeated includes.

    Raises RobotFileError if there are too many ``<include>`` elements, or too many elements.
    """
    remaining, include_count, element_count = [root], 0, sum(1 for _ in root.iter())
    seen = {os.fspath(files.path)}
    while remaining:
        document = remaining.pop()
        yield document
        for include in document.iter("include"):
            path = files.path.parent / include.get("file", "")
            include_count += 1
            if include_count > MAX_INCLUDES:
                raise RobotFileError(f"it includes more than {MAX_INCLUDES} files")
            if os.path.realpath(path) in seen:
                continue
            seen.add(os.path.realpath(path))
            try:
                # Without warnings: MuJoCo reads the file itself.
                included = parse_xml(files.read(path), limits.max_elements, [])
            except (OSError, RobotFileError) as error:
                if path.exists() and not path.is_file():  # MuJoCo would wait for a named pipe
                    raise RobotFileError(f"{include.get('file')} is not a regular file") from error
                continue  # MuJoCo reports it
            element_count += sum(1 for _ in included.iter())
            if element_count > limits.max_elements:
                raise RobotFileError(f"it and its includes have more than {limits.max_elements} XML elements")
            remaining.append(included)
