"""Compiles MJCF with the package ``mujoco``, in a child process with limited memory and time."""

from __future__ import annotations

from pathlib import Path
from typing import Any, Final

import msgspec

from gateway.robots.limits import RobotLimits
from gateway.runtime.limited_process import ProcessFailed, ProcessLimits, call_limited
from scenegate.robots.errors import RobotFileError

_OUT_OF_MEMORY: Final = ("Could not allocate memory", "Caught an unknown exception!")
"""Parts of MuJoCo's error messages when memory runs out; the second one is for std::bad_alloc."""

_output_decoder: Final = msgspec.msgpack.Decoder(tuple[bytes, list[str]] | str)


def compile_mjcf(mujoco: Any, path: Path, limits: RobotLimits) -> tuple[Any, list[str]]:
    """Return the model of an MJCF file, an ``MjModel``, and the compiler's warnings.

    Args:
        mujoco: The package ``mujoco``.
        path: The robot file.
        limits: Limits of the child process and of the model.

    Raises:
        RobotFileError: MuJoCo cannot compile the file within the limits.
    """
    arguments = (str(path), limits.max_model_bytes)
    process_limits = ProcessLimits(limits.max_compiler_bytes, limits.max_compiler_seconds)
    try:
        result = _output_decoder.decode(call_limited("gateway.parsers.mjcf:compile_file", arguments, process_limits))
    except ProcessFailed as failure:
        result = ""  # no error message: it ran out of memory or crashed
        if failure.timed_out:
            result = f"it takes longer than max_compiler_seconds = {process_limits.seconds}"
    if isinstance(result, str):
        if not result or any(message in result for message in _OUT_OF_MEMORY):
            result = f"it needs more than max_compiler_bytes = {process_limits.memory_bytes} of memory, or crashes"
        raise RobotFileError(f"MuJoCo cannot compile it: {result}")
    model, warnings = result
    return mujoco.MjModel.from_binary_path("model.mjb", {"model.mjb": model}), warnings
