"""What a layer's shader points into lives as long as the shader."""

import gc
import weakref
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from renderers.shading.studio import layout, passes


def test_a_layers_inputs_live_as_long_as_its_shader(monkeypatch: pytest.MonkeyPatch) -> None:
    """Another image would get their memory."""
    alive: list[weakref.ref[Any]] = []

    def job(*_: object) -> tuple[Any, tuple[object, ...]]:
        inputs, pointed_to = np.zeros(1, layout.StudioInputs.dtype), np.zeros(1)
        alive.extend((weakref.ref(inputs), weakref.ref(pointed_to)))
        return inputs, (pointed_to,)

    monkeypatch.setattr(passes, "_job", job)
    nothing: Any = SimpleNamespace(X_camera_mesh=None, first_ids=None, width=8)
    shade = passes._layer_shader(nothing, nothing, nothing, nothing, nothing, 0, 0, 0)  # noqa: SLF001 - what it keeps
    gc.collect()
    assert [each() is not None for each in alive] == [True, True]
    del shade
    gc.collect()
    assert [each() is not None for each in alive] == [False, False]
