"""What a layer's shader points into lives as long as the shader."""

import gc
import weakref
from types import SimpleNamespace
from typing import Any

import pytest

from renderers.shading.studio import passes


class Job:
    """In place of the ShadingJob whose address the kernel gets."""

    address = 0


def test_a_layers_inputs_live_as_long_as_its_shader(monkeypatch: pytest.MonkeyPatch) -> None:
    """Another image would get their memory."""
    alive: list[weakref.ref[Any]] = []

    def job(*_: object, **__: object) -> Job:
        made = Job()
        alive.append(weakref.ref(made))
        return made

    monkeypatch.setattr(passes, "ShadingJob", job)
    layer: Any = SimpleNamespace(X_camera_mesh=None, first_ids=None)
    camera: Any = SimpleNamespace(width=8)
    shade = passes._layer_shader(camera, camera, passes.LightingJob(), layer, camera, 0)  # noqa: SLF001 - what it keeps
    gc.collect()
    assert [each() is not None for each in alive] == [True]
    del shade
    gc.collect()
    assert [each() is not None for each in alive] == [False]
