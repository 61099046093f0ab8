"""Scenes of square plates that face a camera at the origin: their pixels follow from one line of arithmetic.

The camera looks along +Z of the world with +X to the right and +Y down, 64 x 48 pixels, f = 40 pixels.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from gateway.datasets.annotated_scene import annotate_scene
from gateway.datasets.classes import ClassTable, classes_of_models
from gateway.datasets.rendering import SampleInputs, render_sample
from gateway.datasets.scenes import LoadedScene
from gateway.files.robots.scene_files import SceneOptions
from gateway.scene.draw.style import Style
from renderers.camera import Camera
from renderers.raster import CpuRenderer
from scenegate.datasets.manifest import ImageType, ObjectRecord, Silhouette, decode_silhouettes
from tests.datasets.conftest import loaded
from tests.files.gltf.builder import Builder, data_uri

WIDTH, HEIGHT, FOCAL = 64, 48, 40.0
FORMATS: dict[ImageType, str] = {"depth": "tiff", "instance": "png", "class": "png", "amodal": "json"}


@dataclass(frozen=True)
class Plate:
    """A square of 1 m in the plane z = 0 of its node, from (-0.5, -0.5) to (0.5, 0.5)."""

    name: str
    translation: Sequence[float] = (0.0, 0.0, 4.0)
    mesh: str = "plate"
    node: dict[str, Any] = field(default_factory=dict)
    """More properties of the node."""
    material: dict[str, Any] = field(default_factory=dict)
    half: bool = False
    """True: the texture of the material has alpha 0 in its left half."""


def write_plates(path: Path, plates: Sequence[Plate]) -> Path:
    """Write a glTF file of plates that is Z up. Plates with the same name of the mesh share it."""
    b = Builder()
    square = {
        "POSITION": b.accessor([(-0.5, -0.5, 0), (0.5, -0.5, 0), (0.5, 0.5, 0), (-0.5, 0.5, 0)]),
        "NORMAL": b.accessor([(0, 0, -1)] * 4),
        "TEXCOORD_0": b.accessor([(0, 0), (1, 0), (1, 1), (0, 1)]),
    }
    indices = b.accessor([0, 2, 1, 0, 3, 2], "B")
    pixels = np.full((4, 4, 4), 255, np.uint8)
    pixels[:, :2, 3] = 0
    b.add("images", {"uri": data_uri(cv2.imencode(".png", pixels)[1].tobytes(), "image/png")})
    b.add("textures", {"source": 0, "sampler": b.add("samplers", {"magFilter": 9728, "minFilter": 9728})})
    meshes: dict[str, int] = {}
    for plate in plates:
        if plate.mesh not in meshes:
            pbr = plate.material.get("pbrMetallicRoughness", {}) | (
                {"baseColorTexture": {"index": 0}} if plate.half else {}
            )
            material = b.add("materials", {**plate.material, "pbrMetallicRoughness": pbr})
            meshes[plate.mesh] = b.mesh({"attributes": square, "indices": indices, "material": material})
            b.json["meshes"][-1]["name"] = plate.mesh
        b.node(name=plate.name, mesh=meshes[plate.mesh], translation=list(plate.translation), **plate.node)
    path.write_bytes(b.text())
    return path


def scene_of(folder: Path, *plates: Plate) -> LoadedScene:
    """Load a scene of plates, from a file in a folder."""
    return loaded(write_plates(folder / "plates.gltf", plates), SceneOptions(up="z"))


def plate_camera(**changes: Any) -> Camera:
    """Return the camera of this module, with changes."""
    values = {"width": WIDTH, "height": HEIGHT, "fx": FOCAL, "fy": FOCAL, "cx": WIDTH / 2, "cy": HEIGHT / 2}
    return Camera(**{**values, "near": 0.1, "far": 100.0, "X_world_camera": np.eye(4), **changes})


@dataclass(frozen=True)
class Seen:
    """A decoded sample."""

    objects: dict[str, ObjectRecord]
    """By the name of the node."""
    instance: NDArray[np.uint16]
    silhouettes: dict[int, Silhouette]
    images: dict[ImageType, bytes]

    def mask(self, name: str) -> NDArray[np.bool_]:
        """Return the silhouette of an object."""
        return self.silhouettes[self.objects[name].instance].mask


def see(
    renderer: CpuRenderer,
    scene: LoadedScene,
    camera: Camera | None = None,
    classes: ClassTable | None = None,
    style: Style | None = None,
) -> Seen:
    """Annotate an image of a scene."""
    if classes is None:
        classes = classes_of_models(each.model for each in scene.objects)
    annotated = annotate_scene(scene, classes, lambda record, data: None)
    images, objects = render_sample(
        renderer, SampleInputs(scene, camera or plate_camera(), annotated), FORMATS, style or Style()
    )
    instance = np.asarray(cv2.imdecode(np.frombuffer(images["instance"], np.uint8), cv2.IMREAD_UNCHANGED), np.uint16)
    by_name = {str(each.path[-1]): each for each in objects}
    return Seen(by_name, instance, decode_silhouettes(images["amodal"], "amodal"), images)
