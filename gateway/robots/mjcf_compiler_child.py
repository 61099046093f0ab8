"""Compiles an MJCF file: the program that ``mjcf_compiler`` runs in a child process with limits.

    python mjcf_compiler_child.py FILE MODEL_BYTES

Writes a ``CompiledModel`` or an error (a string) to stdout, as MessagePack. The limits are needed because a small file
can make MuJoCo's compiler allocate gigabytes or run for hours: height fields, ``<replicate>``, textures.
"""

from __future__ import annotations

import os
import sys

import msgspec


class CompiledModel(msgspec.Struct):
    """A model in MuJoCo's binary format."""

    model: bytes
    warnings: list[str]
    """The compiler's warnings."""


def compile_file(path: str, max_model_bytes: int) -> CompiledModel | str:
    """Return the model of a file, or an error text."""
    import mujoco  # not at the top: the server imports this module for its struct
    import numpy as np

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


def main() -> None:
    output = os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)  # MuJoCo prints to stdout, which is for the result
    output.write(msgspec.msgpack.encode(compile_file(sys.argv[1], int(sys.argv[2]))))
    output.flush()


if __name__ == "__main__":
    main()
