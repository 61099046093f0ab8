"""The pictures of docs/render-server.md: RenderEngineVtk beside the looks ``auto`` and ``gltf``.

    python -m tests.drake.capture CAPTURED      (by an interpreter with pydrake)
    python -m tools.pictures.looks CAPTURED OUT.png

Every row is a scene of tests/drake/scenes.py, twice as large.
"""

import json
import sys
from pathlib import Path
from typing import Any, Final

import cv2
import numpy as np
from numpy.typing import NDArray

from gateway.adapters.render.config import RenderConfig
from gateway.adapters.render.form import read_fields
from gateway.adapters.render.pipeline import Pipeline
from gateway.scene.draw.style import Style
from renderers.raster import CpuRenderer

SCENES: Final = (
    "alpha_opaque_texture_double",
    "alpha_cut_out_mask",
    "stacked_gltf_210",
    "primitives_half_alpha",
    "wrap_mirror_clamp",
    "minified_nearest_mipmap_nearest",
    "emissive_factor",
    "vertex_grey",
    "mirrored_node",
    "obj_mirrored",
    "magnified_none",
    "stacked_boxes_beside_gltf",
)
SCALE: Final = 2
CAPTION_ROWS: Final = 18


def captioned(image: NDArray[Any], caption: str) -> NDArray[Any]:
    height, width = (SCALE * side for side in image.shape[:2])
    result = np.full((height + CAPTION_ROWS, width, 3), 255, np.uint8)
    result[CAPTION_ROWS:] = cv2.resize(image, (width, height), interpolation=cv2.INTER_NEAREST)
    cv2.putText(result, caption, (4, 13), cv2.FONT_HERSHEY_SIMPLEX, 0.42, (40, 40, 40), 1, cv2.LINE_AA)
    return result


def main() -> None:
    folder, out = Path(sys.argv[1]), sys.argv[2]
    renderer = CpuRenderer()
    pipelines = {
        "--look auto": Pipeline(renderer, RenderConfig()),
        "--look gltf": Pipeline(renderer, RenderConfig(style=Style("gltf"))),
    }
    rows = []
    for name in SCENES:
        vtk = cv2.imread(str(folder / name / "color.png"))
        assert vtk is not None, f"{folder / name} was not captured"
        images = [captioned(vtk, f"RenderEngineVtk: {name}")]
        fields = json.loads((folder / name / "color.json").read_text())
        scene = (folder / name / "color.gltf").read_bytes()
        for caption, pipeline in pipelines.items():
            body = pipeline.render(read_fields(fields, scene, RenderConfig())).body
            image = cv2.imdecode(np.frombuffer(body, np.uint8), cv2.IMREAD_COLOR)
            assert image is not None
            images.append(captioned(image, caption))
        rows.append(np.hstack(images))
    cv2.imwrite(out, np.vstack(rows))
    renderer.close()


if __name__ == "__main__":
    main()
