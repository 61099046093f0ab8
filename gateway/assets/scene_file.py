"""glTF files that the operator names: they may refer to files beside them, and are turned to Z up."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal

from gateway.gltf import DRAKE_GENERATORS, GltfCamera, GltfError, GltfLimits, read_gltf
from gateway.scene.transforms import Y_UP_TO_Z_UP
from gateway.scene.tree import Node
from renderers.drawlist import Light

Up = Literal["auto", "y", "z"]


class SceneFileError(ValueError):
    """A scene file cannot be used; the message names the file and why."""


@dataclass(frozen=True, slots=True, eq=False)
class SceneFile:
    """A scene in our world: Z up, metres."""

    root: Node
    """Committed tree."""
    cameras: tuple[GltfCamera, ...]
    """The file's own, their poses Z up, too."""
    warnings: tuple[str, ...]
    """What was ignored or repaired."""
    generator: str
    """``asset.generator``."""
    lights: tuple[Light, ...] = ()
    """The file's own, Z up, too."""

    @property
    def from_drake(self) -> bool:
        """Whether Drake's render client made the document."""
        return self.generator in DRAKE_GENERATORS


class FolderFiles:
    """A scene's file and the files below its folder that it names; symbolic links do not lead out of it either."""

    def __init__(self, path: Path) -> None:
        self._path = path.resolve()
        self.digests: dict[str, str] = {}
        """What was read so far, relative to the folder -> SHA-256 of the content, the scene's own file first."""

    def own(self) -> bytes:
        """The bytes of the scene's file; raises OSError."""
        return self._read(self._path)

    def __call__(self, uri: str) -> bytes:
        """The bytes of a relative URI; raises GltfError with the reason."""
        target = (self._path.parent / uri).resolve()
        if not target.is_relative_to(self._path.parent):
            raise GltfError(f"{uri} lies outside of the scene's folder")
        try:
            return self._read(target)
        except OSError as error:
            raise GltfError(f"{uri} cannot be read: {error.strerror}") from None

    def _read(self, path: Path) -> bytes:
        data = path.read_bytes()
        self.digests[path.relative_to(self._path.parent).as_posix()] = hashlib.sha256(data).hexdigest()
        return data


def read_scene_file(
    path: Path, *, up: Up = "auto", limits: GltfLimits | None = None, files: FolderFiles | None = None
) -> SceneFile:
    """Reads a ``.gltf`` or ``.glb`` file.

    Args:
        up: the file's up axis; ``auto``: Z when the generator is Drake's, else Y as the specification says.
        files: reads ``path`` and what it names, for callers that want to know what was read.

    Raises:
        SceneFileError: not readable, not glTF, or beyond a limit.
    """
    beside = files or FolderFiles(path)
    try:
        scene = read_gltf(beside.own(), resolve=beside, limits=limits or GltfLimits())
    except OSError as error:
        raise SceneFileError(f"{path}: {error.strerror or error}") from None
    except GltfError as error:
        raise SceneFileError(f"{path}: {error}") from None
    if up == "z" or (up == "auto" and scene.from_drake):
        return SceneFile(scene.root, scene.cameras, scene.warnings, scene.generator, scene.lights)
    root = scene.root
    turned = Node(root.parts, Y_UP_TO_Z_UP @ root.matrix, root.children)
    cameras = tuple(replace(camera, X_world_camera=Y_UP_TO_Z_UP @ camera.X_world_camera) for camera in scene.cameras)
    lights = tuple(
        replace(light, position=_turned(light.position), direction=_turned(light.direction)) for light in scene.lights
    )
    return SceneFile(turned, cameras, scene.warnings, scene.generator, lights)


def _turned(v: tuple[float, float, float]) -> tuple[float, float, float]:
    """A point or direction of a Y-up world in ours."""
    x, y, z = Y_UP_TO_Z_UP[:3, :3] @ v
    return float(x), float(y), float(z)
