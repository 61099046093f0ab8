"""Compiles MJCF files with the package mujoco.

A small file can make its compiler allocate gigabytes or run for hours: height fields, ``<replicate>``, textures.
"""

import re
from collections.abc import Callable
from pathlib import PurePath
from typing import Final

import mujoco
import numpy as np

_CANNOT_OPEN: Final = re.compile(r"Error opening file '(.+?)'")


def compile_file(read_file: Callable[[str], bytes], path: str, max_model_bytes: int) -> tuple[bytes, list[str]] | str:
    """Return the model of a file in MuJoCo's binary format and the compiler's warnings, or an error text."""
    warnings: dict[str, None] = {}
    mujoco.set_mju_user_warning(lambda text: warnings.setdefault(f"MuJoCo: {' '.join(text.split())}"))
    try:
        model = _compile(path, warnings)
        size = mujoco.mj_sizeModel(model)
        if size > max_model_bytes:
            return f"the model has {size} bytes, the limit is max_model_bytes = {max_model_bytes}"
        data = np.empty(size, np.uint8)
        mujoco.mj_saveModel(model, None, data)
    except (ValueError, RuntimeError, MemoryError, mujoco.FatalError) as error:
        return " ".join(str(error).removeprefix("Error: ").split())
    return data.tobytes(), list(warnings)


def _compile(path: str, warnings: dict[str, None]) -> mujoco.MjModel:
    """Return the model of a file without the assets whose files cannot be opened; each adds a warning."""
    try:
        return mujoco.MjModel.from_xml_path(path)
    except ValueError as error:
        message = str(error)
        if not _CANNOT_OPEN.search(message):
            raise
    spec = mujoco.MjSpec.from_file(path)
    while match := _CANNOT_OPEN.search(message):
        _leave_out(spec, match[1], warnings)
        try:
            return spec.compile()
        except ValueError as error:
            if str(error) == message:
                raise
            message = str(error)
    raise ValueError(message)


def _leave_out(spec: mujoco.MjSpec, name: str, warnings: dict[str, None]) -> None:
    """Remove the meshes, height fields and textures of a file from a model.

    Their geoms become invisible points: bodies without a geom would have no mass, which the compiler refuses.
    """
    for asset in (*spec.meshes, *spec.hfields, *spec.textures):
        if not asset.file or not f"/{name}".endswith(f"/{asset.file}"):
            continue
        asset_name = asset.name or PurePath(asset.file).stem
        warnings[
            f"asset {asset_name!r}: the file {asset.file} cannot be opened; what it is for is drawn without it"
        ] = None
        for geom in spec.geoms:
            if asset_name in (geom.meshname, geom.hfieldname):
                geom.type, geom.size = mujoco.mjtGeom.mjGEOM_SPHERE, (1e-3, 0.0, 0.0)
                geom.meshname = geom.hfieldname = geom.material = ""
                geom.rgba = (0.0, 0.0, 0.0, 0.0)
        for material in spec.materials:
            material.textures = ["" if each == asset_name else each for each in material.textures]
        spec.delete(asset)
