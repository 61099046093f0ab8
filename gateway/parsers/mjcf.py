"""Compiles MJCF files with the package mujoco.

A small file can make its compiler allocate gigabytes or run for hours: height fields, ``<replicate>``, textures.
"""

from __future__ import annotations

from collections.abc import Callable

import mujoco
import numpy as np

from gateway.parsers.mjcf_data import CompiledModel


def compile_file(read_file: Callable[[str], bytes], path: str, max_model_bytes: int) -> CompiledModel | str:
    """Return the model of a file, or an error text."""
    warnings: dict[str, None] = {}
    mujoco.set_mju_user_warning(lambda text: warnings.setdefault(f"MuJoCo: {' '.join(text.split())}"))
    try:
        model = mujoco.MjModel.from_xml_path(path)
        size = mujoco.mj_sizeModel(model)
        if size > max_model_bytes:
            return f"the model has {size} bytes, the limit is max_model_bytes = {max_model_bytes}"
        data = np.empty(size, np.uint8)
        mujoco.mj_saveModel(model, None, data)
    except (ValueError, RuntimeError, MemoryError, mujoco.FatalError) as error:
        return " ".join(str(error).removeprefix("Error: ").split())
    return CompiledModel(data.tobytes(), list(warnings))
