"""Reads robot files: URDF, SDF or MJCF, decided by the root element, after xacro has expanded it.

``LinkParts`` reads the meshes of URDF and SDF, and converts their geometry to parts of the scene.
"""

import contextlib
import importlib.util
import os
from collections.abc import Iterable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Final, Literal, TypeAlias

import msgspec
import numpy as np
from numpy.typing import NDArray

from gateway.files.assets.mesh_formats import (
    MeshFormatError,
    decodable_texture,
    diffuse_material,
    parse_mesh,
    with_default_materials,
)
from gateway.files.gltf import GltfError, Up
from gateway.files.robots.robot import Robot, RobotLimits
from gateway.runtime.workers.limited_process import ProcessFailed, ProcessLimits, call_limited
from gateway.scene.draw.bounds import Bounds, instance_bounds, union
from gateway.scene.draw.flatten import flatten
from gateway.scene.tree.geometry import Part, Surface
from gateway.scene.tree.materials import mean_color
from gateway.scene.tree.nodes import Node
from gateway.scene.tree.transforms import scaling, translation
from renderers import primitives
from renderers.drawlist import Image, ImageError, Material, Mesh, Texture
from renderers.images import image_from_bytes
from renderers.stop import check_stop
from scenegate.messages.geometry import Box
from scenegate.robots.link_model import Cone, Link, LinkGeometry, LinkKinematics, LinkMaterial, MeshReference
from scenegate.robots.robot import GeometryUse
from scenegate.robots.robot_errors import RobotFileError
from scenegate.robots.robot_files import LinkFiles, RobotFiles, color_of
from scenegate.robots.robot_reader import errors_of, parse_links
from scenegate.robots.textured_box import textured_box
from scenegate.robots.xacro_args import XacroArgs, as_texts, expand_args, missing_arg, warn_of_unused
from scenegate.robots.xml_text import parse_xml, uses_xacro
from scenegate.warning_text import strict_refusal, warnings_and_notes

RobotGltfUp: TypeAlias = Literal["y", "z", "auto"]
"""Up axis of a robot's glTF meshes: ``y`` by the specification, as in Drake and RViz 2; ``auto``: by the collision
geometry, see ``nearest_up_axis``."""
_PartsOfLinks: TypeAlias = Sequence[tuple[Part, ...]]
"""Parts of each link, in the link's frame."""
MAX_LINKS_FOR_NOTE: Final = 8
"""Maximum number of links whose collision geometry is read for the note about Y up: all of a robot's take 10 times as
long as its glTF meshes."""


def read_robot(
    path: str | Path,
    *,
    roots: Iterable[str | Path] = (),
    geometry: GeometryUse = "visual",
    keyframe: str = "",
    gltf_up: RobotGltfUp = "y",
    strict: bool = False,
    xacro_args: XacroArgs | None = None,
    limits: RobotLimits | None = None,
) -> Robot:
    """Read a robot file. All that can be drawn is drawn; ``Robot.warnings`` has a sentence for each thing that cannot.

    Args:
        path: A URDF, SDF, MJCF or xacro file.
        roots: Folders to search for the packages of ``package://`` names, and for relative file names.
        geometry: Geometry of the links to return.
        keyframe: MJCF only: name of the ``<key>`` with the joints' default values. Empty: the model's ``qpos0``.
        gltf_up: Up axis of glTF meshes in URDF and SDF.
        strict: True: a warning is an error.
        xacro_args: Values of ``$(arg name)`` by name.
        limits: Limits; None: ``RobotLimits()``.

    Raises:
        RobotFileError: The file cannot be read, has no tree of links, or is beyond a limit; or ``strict`` is true and
            it has a warning. The message names the robot file and the reason.
        ImportError: The file is MJCF or has xacro elements, and the package ``mujoco`` or ``xacro`` is not installed.
    """
    limits = limits or RobotLimits()
    with errors_of(path):
        files = RobotFiles(Path(path), map(Path, roots), limits, check_stop, as_texts(xacro_args or {}))
        robot = _read(files, geometry, keyframe, gltf_up, limits)
        if strict and (refusal := strict_refusal(robot.warnings)):
            raise RobotFileError(refusal)
        return robot


def _read(files: RobotFiles, geometry: GeometryUse, keyframe: str, gltf_up: RobotGltfUp, limits: RobotLimits) -> Robot:
    warnings: list[str] = []
    root = parse_xml(files.read_robot_file(), limits.max_elements, warnings)
    is_xacro = files.path.suffix.lower() == ".xacro"
    if is_xacro or uses_xacro(root):
        try:
            root = parse_xml(expand_xacro(files, limits), limits.max_elements, warnings)
        except RobotFileError as error:
            if is_xacro:
                raise
            warnings.append(f"{error}; its xacro elements are ignored")  # rests of an expanded file
    else:
        expand_args(root, files.xacro_args, files.used_args, warnings)
    if root.tag == "mujoco":
        if files.is_pipe:
            raise RobotFileError("MuJoCo reads files only, not pipes: write it into a file first")
        from gateway.files.robots.mjcf import read_mjcf  # needs the package mujoco, which is optional

        robot = read_mjcf(root, files, geometry, keyframe, limits)
        warn_of_unused(files.xacro_args, files.used_args, warnings)
        return replace(robot, warnings=(*robot.warnings, *warnings))
    if keyframe:
        raise RobotFileError("only MJCF files have keyframes")
    model = parse_links(root, files, geometry, limits, warnings)
    warn_of_unused(files.xacro_args, files.used_args, warnings)
    joints, kinematics = model.moving_joints(warnings), LinkKinematics(model)
    parts = LinkParts(files, limits, warnings, "z" if gltf_up == "z" else "y").of_links(model.links)
    sentences, gloss = warnings_and_notes(warnings)
    more = f", as in {len(gloss) - 1} more" if len(gloss) > 1 else ""
    notes = (*files.notes, *(f"{note}{more}" for note in gloss[:1]))
    digests = dict(files.digests)  # without those of the collision geometry, unless it decides what is drawn
    with_gltf = [index for index, link in enumerate(model.links) if _has_gltf(link)]
    if gltf_up != "z" and with_gltf:
        collision = parse_links(root, files, "collision", limits, []).links
        compared = [index for index in with_gltf if collision[index].geometries]
        if gltf_up == "y":
            compared = compared[:MAX_LINKS_FOR_NOTE]
        z_up = LinkParts(files, limits, [], "z").of_links(model.links[index] for index in compared)
        expected = LinkParts(files, limits, [], "y").of_links(collision[index] for index in compared)
        up = nearest_up_axis([parts[index] for index in compared], z_up, expected)
        reason = "bounds are nearer to those of the collision geometry"
        if gltf_up == "auto":
            if up == "z":
                parts = LinkParts(files, limits, [], "z").of_links(model.links)
            digests = files.digests
            notes += (f"glTF meshes are taken as {up.upper()} up: their {reason}",)
        elif up == "z":
            notes += (f"glTF meshes are taken as Y up; with --robot-gltf-up z, their {reason}",)
    name = model.name or files.path.stem
    return Robot(name, model.link_names, joints, parts, kinematics, sentences, notes, digests)


def _has_gltf(link: Link) -> bool:
    shapes = [geometry.shape for geometry in link.geometries]
    return any(isinstance(each, MeshReference) and each.filename.lower().endswith((".gltf", ".glb")) for each in shapes)


MAX_NAMED_ARGS: Final = 16
"""Maximum number of arguments that an error names."""
_output_decoder: Final = msgspec.msgpack.Decoder(tuple[str, str, str, list[str], list[str]])


def expand_xacro(files: RobotFiles, limits: RobotLimits) -> bytes:
    """Return the URDF or SDF document of the robot file, which has xacro elements. ``files`` has read what it includes.

    Raises RobotFileError if it cannot be expanded within the limits, ImportError without ``xacro``.
    """
    if importlib.util.find_spec("xacro") is None:
        raise ImportError(
            "it has xacro elements, which need the package xacro: pip install 'scenegate[robots]'; "
            "or expand it first, xacro robot.urdf.xacro > robot.urdf"
        )

    if files.is_pipe:
        raise RobotFileError("xacro reads files only, not pipes: write it into a file first")

    def package_folder(name: str) -> bytes:
        folder = files.find_package(name)
        if folder is None:
            raise FileNotFoundError(f"the package {name!r} is not found; name a folder that contains it with --root")
        return os.fsencode(folder)

    process_limits = ProcessLimits(limits.max_xacro_bytes, limits.max_xacro_seconds)
    arguments = str(files.path), files.xacro_args
    try:
        output = call_limited("gateway.files.parsers.xacro:expand_file", arguments, process_limits, package_folder)
    except ProcessFailed as error:
        raise RobotFileError(f"xacro cannot expand it: {error}") from None
    document, problem, missing, used, includes = _output_decoder.decode(output)
    files.used_args.update(used)
    for include in includes:
        with contextlib.suppress(OSError, RobotFileError):  # xacro has read it, or says why not
            files.read(files.path.parent / include)
    if missing:
        raise RobotFileError(f"xacro cannot expand it: {missing_arg(missing)}")
    if problem:
        names = f"; its arguments (--xacro-arg) are {', '.join(used[:MAX_NAMED_ARGS])}" if used else ""
        raise RobotFileError(f"xacro cannot expand it: {problem}{names}")
    if "<robot" in document and "<link" not in document:
        raise RobotFileError("it has no links, perhaps only macros: name the file that uses them")
    return document.encode()


def nearest_up_axis(y_up: _PartsOfLinks, z_up: _PartsOfLinks, collision: _PartsOfLinks) -> Literal["y", "z"]:
    """Return the up axis for which the visual geometry's bounds are nearer to those of the collision geometry.

    Boxes are compared by the sum of the absolute differences of their corners. A link without one is skipped.
    """
    differences = {"y": 0.0, "z": 0.0}
    for y_parts, z_parts, collision_parts in zip(y_up, z_up, collision, strict=True):
        expected = _bounds(collision_parts)
        y_box, z_box = _bounds(y_parts), _bounds(z_parts)
        if expected is not None and y_box is not None and z_box is not None:
            differences["y"] += float(np.abs(y_box - expected).sum())
            differences["z"] += float(np.abs(z_box - expected).sum())
    return "z" if differences["z"] < differences["y"] else "y"


def _bounds(parts: tuple[Part, ...]) -> Bounds | None:
    return union([box for box in instance_bounds(flatten(Node(parts)).instances) if box is not None])


class LinkParts:
    """Converts geometry to parts."""

    def __init__(self, files: RobotFiles, limits: RobotLimits, warnings: list[str], gltf_up: Literal["y", "z"]) -> None:
        """``gltf_up``: up axis of glTF meshes. Those that Drake merged are Z up in any case."""
        self._files = files
        self._link_files = LinkFiles(files, warnings, (MeshFormatError, GltfError, ImageError))
        self._warnings = warnings
        self._gltf_up: Up = "auto" if gltf_up == "y" else "z"
        self._limits = limits

    def of_links(self, links: Iterable[Link]) -> tuple[tuple[Part, ...], ...]:
        """Return the parts of each link, in the link's frame. What cannot be read is left out with a warning."""
        return tuple(tuple(part for each in link.geometries for part in self._parts(link.name, each)) for link in links)

    def _parts(self, link: str, geometry: LinkGeometry) -> list[Part]:
        shape, X = geometry.shape, geometry.X_link_geometry
        material, textured = self._materials(link, geometry.material)
        if isinstance(shape, Cone):
            X_cone = translation(0.0, 0.0, 0.5 * shape.length) @ scaling(shape.radius, shape.radius, shape.length)
            return [Part(Surface(primitives.cone()), material, X @ X_cone)]
        if isinstance(shape, Box) and textured.base_color_texture is not None:
            box = textured_box(0.5 * np.array(shape.lengths))
            return [Part(Surface(Mesh(box.positions, box.triangles, box.normals, uv0=box.uv)), textured, X)]
        if not isinstance(shape, MeshReference):
            return [Part(shape, material, X)]
        X = X @ scaling(*shape.scale)
        parts = self._link_files.mesh(link, shape, lambda path, data: self._read_mesh(link, shape, path, data)) or ()
        if shape.center and parts:
            X = X @ translation(*-_centre(parts))
        parts = with_default_materials(parts, material, textured)
        return [msgspec.structs.replace(part, X_node_part=X @ part.X_node_part) for part in parts]

    def _materials(self, link: str, material: LinkMaterial | None) -> tuple[Material, Material]:
        """Return two materials: of the texture's mean colour, for geometry without texture coordinates; for others."""
        rgba = np.array(color_of(material))
        texture = self._link_files.texture(link, material, self._read_image)
        if material is None or texture is None:
            plain = diffuse_material(rgba, None)
            return plain, plain
        image, mean = texture
        textured = diffuse_material(rgba, Texture(image, name=material.texture or ""))
        return replace(textured, base_color=(*mean, rgba[3]), base_color_texture=None), textured

    def _read_mesh(self, link: str, mesh: MeshReference, path: Path, data: bytes) -> tuple[Part, ...]:
        warnings: list[str] = []
        extension = Path(mesh.filename).suffix[1:].lower()
        if mesh.submesh and extension not in ("dae", "obj"):
            warnings.append("<submesh> is ignored, the whole mesh is shown")
        parts = parse_mesh(
            data,
            extension,
            lambda other: self._files.read_beside(path, other),
            self._limits.mesh,
            warnings,
            collada_up_axis=False,
            gltf_up=self._gltf_up,
            submesh=mesh.submesh,
        )
        self._warnings += [f"link {link!r}, {mesh.filename}: {text}" for text in warnings]
        return parts

    def _read_image(self, path: Path, data: bytes) -> tuple[Image, tuple[float, float, float]]:
        """Return an image and its mean colour."""
        image = image_from_bytes(decodable_texture(data), max_pixels=self._limits.mesh.max_image_pixels)
        image.decode()
        return image, mean_color(image)


def _centre(parts: tuple[Part, ...]) -> NDArray[np.float64]:
    """Return the centre of the bounds of a mesh's parts, (3,)."""
    points = [
        part.shape.mesh.positions @ part.X_node_part[:3, :3].T + part.X_node_part[:3, 3]
        for part in parts
        if isinstance(part.shape, Surface)
    ]
    bounds = np.concatenate([*points, np.zeros((0, 3))])
    return 0.5 * (bounds.min(axis=0) + bounds.max(axis=0)) if len(bounds) else np.zeros(3)
