"""Many small scenes as Drake's client posts them, against RenderEngineVtk's images: textures, alpha, materials.

The newer RenderEngineVtk draws vertex colours otherwise. It draws these scenes and one of three others, or all with
SCENEGATE_ALL_CASES.
"""

import json
import os
import subprocess
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from gateway.adapters.render.config import RenderConfig
from gateway.adapters.render.form import LOOK_FIELD, read_fields
from gateway.adapters.render.pipeline import Pipeline
from tests.drake.conftest import COLOR_STEP, MAX_DEPTH_ERROR
from tests.support.corpus import DONT_CARE_LABEL, EMPTY_LABEL, decode_label
from tests.support.waiting import SECONDS

PYTHONS = {"1.51.1": ("SCENEGATE_DRAKE_PYTHON", 1), "1.58.0": ("SCENEGATE_NEW_DRAKE_PYTHON", 3)}
"""Environment variables that name an interpreter with pydrake, and one of how many scenes it draws, by its version."""
MAX_COLOR_FRACTION = 0.002
"""Fraction of channel values that may differ by more."""
COLOR_EXCEPTIONS = {
    "magnified_": 0.01,  # Mesa blurs magnified textures that have mip levels
    "alpha_cut_out_": 0.012,  # likewise
    "grey_alpha": 0.012,  # likewise
    "blended_texture_before_gltf_floor": 0.01,  # VTK draws one of the two things behind the film later: a hole
    "mirrored_node": 0.015,  # VTK culls the other side of mirrored meshes, as black as this one but at the rim
    "obj_mirrored": 1.0,  # black by normals that the request does not contain
}
"""Larger fractions, by the beginning of the scene's name."""
BROKEN_LABELS = ("vertex_", "without_material")
"""RenderEngineVtk multiplies labels by vertex colours. Primitives without a material carry no label."""
DEPTH_EXCEPTIONS = ("kilometres",)
"""Depth beyond a kilometre, where VTK's 24 bits of depth are worth metres."""

pytestmark = [pytest.mark.drake, pytest.mark.slow]


@pytest.fixture(scope="module", params=PYTHONS)
def captured(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Path:
    variable, step = PYTHONS[request.param]
    python = os.environ.get(variable)
    if not python:
        pytest.skip(f"{variable} does not name an interpreter with pydrake {request.param}")
    folder: Path = tmp_path_factory.mktemp("captured")
    root = Path(__file__).parents[2]
    step = 1 if "SCENEGATE_ALL_CASES" in os.environ else step
    command = [python, "-m", "tests.drake.capture", str(folder), str(step)]
    done = subprocess.run(command, cwd=root, capture_output=True, text=True, timeout=SECONDS, check=False)
    assert done.returncode == 0, done.stderr
    return folder


@dataclass(frozen=True)
class Comparison:
    name: str
    color: float
    """Fraction of channel values that differ by more than COLOR_STEP, from the nearer of the two images that
    RenderEngineVtk draws, for a context and for a copy of it: the order of drawing changes with every copy."""
    depth: int
    """Number of pixels whose depth differs by more than MAX_DEPTH_ERROR, or that are covered in one image only."""
    label: int
    """Number of pixels with another label."""

    @property
    def is_as_expected(self) -> bool:
        name = self.name
        limits = [limit for prefix, limit in COLOR_EXCEPTIONS.items() if name.startswith(prefix)]
        return (
            self.color <= max([MAX_COLOR_FRACTION, *limits])
            and (self.depth <= 5 or name in DEPTH_EXCEPTIONS)
            and (self.label <= 5 or name.startswith(BROKEN_LABELS))
        )


def image(pipeline: Pipeline, folder: Path, kind: str) -> NDArray[Any]:
    fields = json.loads((folder / f"{kind}.json").read_text())
    assert LOOK_FIELD not in fields
    request = read_fields(fields, (folder / f"{kind}.gltf").read_bytes(), RenderConfig())
    body = pipeline.render(request).body
    decoded: Any = cv2.imdecode(np.frombuffer(body, np.uint8), cv2.IMREAD_UNCHANGED)
    return decoded


def color_difference(color: NDArray[Any], path: Path) -> float:
    reference: Any = cv2.imread(str(path))
    return float((np.abs(color.astype(int) - reference) > COLOR_STEP).mean())


def compare(pipeline: Pipeline, folder: Path) -> Comparison:
    color, depth, label = (image(pipeline, folder, kind) for kind in ("color", "depth", "label"))
    vtk_depth, vtk_label = np.load(folder / "depth.npy"), np.load(folder / "label.npy").astype(np.int64)
    vtk_label[vtk_label == EMPTY_LABEL] = DONT_CARE_LABEL
    is_finite = np.isfinite(depth) & np.isfinite(vtk_depth)
    error = np.abs(np.where(is_finite, depth, 0) - np.where(is_finite, vtk_depth, 0))
    return Comparison(
        folder.name,
        min(color_difference(color, folder / name) for name in ("color.png", "color_copy.png")),
        int(((error > MAX_DEPTH_ERROR) | (np.isfinite(depth) != np.isfinite(vtk_depth))).sum()),
        int((decode_label(label[..., ::-1]) != vtk_label).sum()),
    )


def test_images_are_those_of_render_engine_vtk(captured: Path, pipeline: Pipeline) -> None:
    comparisons = [compare(pipeline, folder) for folder in sorted(captured.iterdir())]
    assert len(comparisons) >= 40
    assert not [each for each in comparisons if not each.is_as_expected]
