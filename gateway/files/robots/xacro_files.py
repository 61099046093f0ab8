"""Expands xacro files with the package ``xacro``, in a child process with limited memory and time."""

import contextlib
import importlib.util
import os
from typing import Final

import msgspec

from gateway.files.robots.limits import RobotLimits
from gateway.runtime.workers.limited_process import ProcessFailed, ProcessLimits, call_limited
from scenegate.robots.robot_errors import RobotFileError
from scenegate.robots.robot_files import RobotFiles
from scenegate.robots.xacro_args import missing_arg

MAX_NAMED_ARGS: Final = 16
"""Maximum number of arguments that an error names."""
_output_decoder: Final = msgspec.msgpack.Decoder(tuple[str, str, str, list[str], list[str]])


def expand_xacro(files: RobotFiles, limits: RobotLimits) -> bytes:
    """Return the URDF or SDF document of the robot file, which has xacro elements. ``files`` has read what it includes.

    Raises RobotFileError if it cannot be expanded within the limits, ImportError without ``xacro``.
    """
    if importlib.util.find_spec("xacro") is None:
        raise ImportError(
            "it has xacro elements, which need the package xacro: pip install 'scenegate[robots]'; "
            "or expand it first, xacro robot.urdf.xacro > robot.urdf"
        )

    if files.is_pipe:
        raise RobotFileError("xacro reads files only, not pipes: write it into a file first")

    def package_folder(name: str) -> bytes:
        folder = files.find_package(name)
        if folder is None:
            raise FileNotFoundError(f"the package {name!r} is not found; name a folder that contains it with --root")
        return os.fsencode(folder)

    process_limits = ProcessLimits(limits.max_xacro_bytes, limits.max_xacro_seconds)
    arguments = str(files.path), files.xacro_args
    try:
        output = call_limited("gateway.files.parsers.xacro:expand_file", arguments, process_limits, package_folder)
    except ProcessFailed as error:
        raise RobotFileError(f"xacro cannot expand it: {error}") from None
    document, problem, missing, used, includes = _output_decoder.decode(output)
    files.used_args.update(used)
    for include in includes:
        with contextlib.suppress(OSError, RobotFileError):  # xacro has read it, or says why not
            files.read(files.path.parent / include)
    if missing:
        raise RobotFileError(f"xacro cannot expand it: {missing_arg(missing)}")
    if problem:
        names = f"; its arguments (--xacro-arg) are {', '.join(used[:MAX_NAMED_ARGS])}" if used else ""
        raise RobotFileError(f"xacro cannot expand it: {problem}{names}")
    if "<robot" in document and "<link" not in document:
        raise RobotFileError("it has no links, perhaps only macros: name the file that uses them")
    return document.encode()
