"""Reads a BOP scene as the format's description tells, without our code, and renders it again."""

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import trimesh
from numpy.typing import NDArray
from PIL import Image

from tests.datasets.formats.ray_caster import cast


@dataclass(frozen=True)
class BopObject:
    """An annotated object of an image."""

    gt: dict[str, Any]
    info: dict[str, Any]
    mask: NDArray[np.bool_]
    mask_visib: NDArray[np.bool_]
    rendered: NDArray[np.float64]
    """Depth in millimetres of its model in its pose, (H, W), inf where it is not."""


@dataclass(frozen=True)
class BopImage:
    """An image of a scene."""

    camera: dict[str, Any]
    color: NDArray[np.uint8]
    depth: NDArray[np.float64]
    """Millimetres; 0: unknown."""
    objects: tuple[BopObject, ...]

    @property
    def front(self) -> NDArray[np.int64]:
        """Index of the object that is nearest in each pixel, of those that are annotated; -1: none."""
        depths = np.array([item.rendered for item in self.objects])
        return np.where(np.isfinite(depths).any(axis=0), depths.argmin(axis=0), -1)


def read_bop(folder: Path) -> list[BopImage]:
    """Read all images of all scenes."""
    images = []
    for scene in sorted((folder / "train_pbr").iterdir()):
        cameras, gts, infos = (
            json.loads((scene / f"{name}.json").read_text()) for name in ("scene_camera", "scene_gt", "scene_gt_info")
        )
        for number, camera in cameras.items():
            name = f"{int(number):06d}"
            depth = pixels(scene / "depth" / f"{name}.png") * camera["depth_scale"]
            objects = tuple(
                BopObject(
                    gt,
                    info,
                    pixels(scene / "mask" / f"{name}_{k:06d}.png") == 255,
                    pixels(scene / "mask_visib" / f"{name}_{k:06d}.png") == 255,
                    render(folder, gt, camera, depth.shape[1], depth.shape[0]),
                )
                for k, (gt, info) in enumerate(zip(gts[number], infos[number], strict=True))
            )
            images.append(BopImage(camera, pixels(scene / "rgb" / f"{name}.png"), depth, objects))
    return images


def pixels(path: Path) -> NDArray[Any]:
    return np.asarray(Image.open(path))


def render(folder: Path, gt: dict[str, Any], camera: dict[str, Any], width: int, height: int) -> NDArray[np.float64]:
    mesh = trimesh.load_mesh(folder / "models" / f"obj_{gt['obj_id']:06d}.ply", process=False)
    R, t = np.reshape(gt["cam_R_m2c"], (3, 3)), np.array(gt["cam_t_m2c"])
    return cast(mesh.vertices @ R.T + t, mesh.faces, np.reshape(camera["cam_K"], (3, 3)), width, height)
