"""A renderer of two threads."""

from collections.abc import Iterator

import pytest

from renderers.raster import CpuRenderer


@pytest.fixture(scope="package")
def renderer() -> Iterator[CpuRenderer]:
    renderer = CpuRenderer(2)
    yield renderer
    renderer.close()
