"""Drake's own robots as its client posts them, against RenderEngineVtk's images."""

import lzma
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from gateway.adapters.render.config import RenderConfig
from gateway.adapters.render.form import FormReader
from gateway.adapters.render.pipeline import Pipeline
from tests.drake.conftest import COLOR_STEP, MAX_DEPTH_ERROR
from tests.support.corpus import DONT_CARE_LABEL, EMPTY_LABEL, corpus_path, decode_label

MAX_COLOR_FRACTION = 0.001
"""Fraction of channel values that may differ by more."""
MAX_PIXELS = 4
"""Number of pixels at edges with another label, or covered in one image only."""

HERE = Path(__file__).parent / "robots"
CORPUS = corpus_path()
FOLDERS = [*HERE.glob("*_*"), *((CORPUS / "drake_robots").glob("*_*") if CORPUS else ())]


def image(pipeline: Pipeline, folder: Path, kind: str) -> NDArray[Any]:
    config = RenderConfig()
    reader = FormReader((folder / f"{kind}.ctype").read_text().strip(), config)
    reader.feed(lzma.decompress((folder / f"{kind}.multipart.xz").read_bytes()))
    decoded: Any = cv2.imdecode(np.frombuffer(pipeline.render(reader.request()).body, np.uint8), -1)
    return decoded


@pytest.mark.parametrize("folder", sorted(FOLDERS), ids=lambda folder: folder.name)
def test_images_are_those_of_render_engine_vtk(pipeline: Pipeline, folder: Path) -> None:
    vtk = np.load(folder / "vtk.npz")
    difference = np.abs(image(pipeline, folder, "color")[..., ::-1].astype(int) - vtk["color"])
    assert (difference > COLOR_STEP).mean() <= MAX_COLOR_FRACTION
    expected = np.where(vtk["label"] == EMPTY_LABEL, DONT_CARE_LABEL, vtk["label"].astype(np.int64))
    labels = decode_label(image(pipeline, folder, "label")[..., ::-1])
    assert len(np.unique(labels)) > 1
    assert (labels != expected).sum() <= MAX_PIXELS
    if "depth" in vtk and (folder / "depth.ctype").exists():
        depth = image(pipeline, folder, "depth")
        is_covered, is_covered_in_vtk = np.isfinite(depth), np.isfinite(vtk["depth"])
        assert (is_covered != is_covered_in_vtk).sum() <= MAX_PIXELS
        both = is_covered & is_covered_in_vtk
        assert np.abs(depth[both] - vtk["depth"][both]).max() <= MAX_DEPTH_ERROR
