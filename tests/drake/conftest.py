"""Our images beside those of RenderEngineVtk."""

from collections.abc import Iterator
from typing import Final

import pytest

from gateway.adapters.render.config import RenderConfig
from gateway.adapters.render.pipeline import Pipeline
from renderers.raster import CpuRenderer

COLOR_STEP: Final = 20
"""Difference of a channel, of 255, that Drake's integration test tolerates."""
MAX_DEPTH_ERROR: Final = 1e-3
"""Metres."""


@pytest.fixture(scope="module")
def pipeline() -> Iterator[Pipeline]:
    renderer = CpuRenderer(2)
    yield Pipeline(renderer, RenderConfig())
    renderer.close()
