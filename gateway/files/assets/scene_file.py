"""Reads glTF files that the operator names, and rotates them to Z up. They may refer to files in their own folder."""

import hashlib
import os
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path

import msgspec

from gateway.files.gltf import DRAKE_MERGER, AnimationTime, GltfError, PlacedCamera, Up, read_gltf
from gateway.scene.tree.geometry import Part
from gateway.scene.tree.nodes import Node, TreeEdit
from gateway.scene.tree.nodes import Path as TreePath
from gateway.scene.tree.transforms import Y_UP_TO_Z_UP, scaling
from renderers.drawlist import Light
from scenegate.regular_files import errors_as, read_regular
from scenegate.warning_text import warnings_and_notes


class SceneFileError(ValueError):
    """A scene file that cannot be used. The message names the file and the reason."""


@dataclass(frozen=True, slots=True, eq=False)
class SceneFile:
    """A scene with Z up, in metres."""

    root: Node
    """Root of the tree, which does not change any more."""
    cameras: tuple[PlacedCamera, ...] = ()
    """The file's cameras, in the Z-up world."""
    warnings: tuple[str, ...] = ()
    """Sentences about properties that were ignored or repaired."""
    notes: tuple[str, ...] = ()
    """Sentences about choices that the reader made."""
    generator: str = ""
    """``asset.generator`` of a glTF file."""
    digests: Mapping[str, str] = field(default_factory=dict)
    """SHA-256 in hexadecimal of the files that were read, by path relative to the scene file's folder. The scene file
    is first."""

    models: Mapping[TreePath, str] = field(default_factory=dict)
    """Names of a glTF file's meshes, by the paths of their nodes."""

    @property
    def from_drake(self) -> bool:
        """True for a document that Drake's render client merged."""
        return self.generator == DRAKE_MERGER


def scaled(scene: SceneFile, scale: float) -> SceneFile:
    """Return a scene in which all lengths are multiplied by a factor."""
    if scale == 1.0:
        return scene
    root = Node(scene.root.parts, scaling(scale, scale, scale) @ scene.root.matrix, scene.root.children)
    cameras: list[PlacedCamera] = []
    for camera in scene.cameras:
        pose = camera.X_world_camera.copy()
        pose[:3, 3] *= scale
        far, xmag = (None if length is None else scale * length for length in (camera.zfar, camera.xmag))
        cameras.append(replace(camera, X_world_camera=pose, znear=scale * camera.znear, zfar=far, xmag=xmag))
    edit = TreeEdit(root)
    for path, node in scene.root.walk():
        if any(isinstance(part.shape, Light) for part in node.parts or ()):
            edit.set_parts(path, tuple(_with_scaled_range(part, scale) for part in node.parts or ()))
    return replace(scene, root=edit.commit(), cameras=tuple(cameras))


def _with_scaled_range(part: Part, scale: float) -> Part:
    light = part.shape
    if not isinstance(light, Light) or light.range is None:
        return part
    return msgspec.structs.replace(part, shape=replace(light, range=scale * light.range))


class FolderFiles:
    """Reads a scene file and the files that it refers to, which must be below its folder (links resolved)."""

    def __init__(self, path: Path) -> None:
        self._path = path.resolve()
        self.digests: dict[str, str] = {}
        """SHA-256 in hexadecimal of each file read so far, by path relative to the folder; the scene file is first."""

    def read_scene(self) -> bytes:
        """Return the bytes of the scene file; raises OSError."""
        return self._read(self._path)

    def resolve(self, uri: str) -> bytes:
        """Return the bytes of a file that the scene file refers to by a relative URI; raises GltfError."""
        # Path.resolve raises RuntimeError for links in a circle.
        target = Path(os.path.realpath(self._path.parent / uri))
        if not target.is_relative_to(self._path.parent):
            raise GltfError(f"{uri} lies outside of the scene's folder")
        try:
            return self._read(target)
        except OSError as error:
            raise GltfError(f"{uri} cannot be read: {error.strerror}") from None

    def _read(self, path: Path) -> bytes:
        data = read_regular(path)
        self.digests[path.relative_to(self._path.parent).as_posix()] = hashlib.sha256(data).hexdigest()
        return data


def read_scene_file(
    path: Path, *, up: Up = "auto", variant: str | None = None, animation: AnimationTime | None = None
) -> SceneFile:
    """Read a ``.gltf`` or ``.glb`` file. Raises SceneFileError if it is not readable, not glTF, or beyond a limit.

    ``up``: the file's up axis; ``auto``: Z for documents that Drake merged, else Y by the specification. ``variant``:
    name of a variant of KHR_materials_variants; None: the default materials. ``animation``: the one whose pose the
    nodes have; None: the stored pose.
    """
    files = FolderFiles(path)
    with errors_as(SceneFileError, path, GltfError):
        data = files.read_scene()
        scene = read_gltf(
            data, resolve=files.resolve, variant=variant, decode_images=True, animation=animation, posted=up == "z"
        )
    sentences = list(scene.warnings)
    is_z_up = scene.is_z_up(up, sentences)
    warnings, notes = warnings_and_notes(sentences)
    file = SceneFile(
        scene.root,
        scene.cameras,
        warnings,
        notes=notes,
        generator=scene.generator,
        digests=files.digests,
        models=scene.models,
    )
    if is_z_up:
        return file
    root = scene.root
    rotated = Node(root.parts, Y_UP_TO_Z_UP @ root.matrix, root.children)
    cameras = tuple(replace(camera, X_world_camera=Y_UP_TO_Z_UP @ camera.X_world_camera) for camera in scene.cameras)
    return replace(file, root=rotated, cameras=cameras)
