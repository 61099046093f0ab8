"""A renderer of one thread and of several: images are the same."""

from collections.abc import Iterator

import pytest

from renderers.raster import CpuRenderer


@pytest.fixture(scope="module", params=[1, 3], ids=["1 thread", "3 threads"])
def renderer(request: pytest.FixtureRequest) -> Iterator[CpuRenderer]:
    renderer = CpuRenderer(request.param)
    yield renderer
    renderer.close()
