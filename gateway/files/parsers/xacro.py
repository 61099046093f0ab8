"""Expands xacro files with the package xacro.

xacro evaluates Python expressions and reads included files, so only files that the user names are expanded.
"""

from __future__ import annotations

import errno
import os
import sys
from collections.abc import Callable
from pathlib import Path
from types import ModuleType
from typing import Any

import xacro


def _refuse_other_files(event: str, arguments: tuple[Any, ...]) -> None:
    """Raise OSError before a file is opened that is not regular: a named pipe would block for ever."""
    if event == "open" and isinstance(arguments[0], str):
        path = Path(arguments[0])
        if path.exists() and not path.is_file():
            raise OSError(errno.EINVAL, "it is not a regular file", arguments[0])


def expand_file(read_file: Callable[[str], bytes], path: str) -> tuple[str, str, list[str]]:
    """Return the expanded XML, an error text if that is empty, and the paths of the files that were read.

    Args:
        read_file: Returns the folder of a package, by the package's name.
    """
    packages = ModuleType("ament_index_python.packages")
    packages.get_package_share_directory = lambda name: os.fsdecode(read_file(name))  # type: ignore[attr-defined]
    # xacro imports this module of ROS for $(find package); it is on no package index.
    sys.modules["ament_index_python"] = ModuleType("ament_index_python")
    sys.modules["ament_index_python.packages"] = packages
    sys.addaudithook(_refuse_other_files)
    try:
        document, problem = xacro.process_file(path).toxml(), ""
    except Exception as error:  # noqa: BLE001 - expressions of the file can raise anything
        cause = getattr(error, "exc", None)
        reason = cause if isinstance(cause, OSError) else error  # xacro repeats the text of its cause
        document, problem = "", " ".join(f"{reason}".split()) or type(error).__name__
    return document, problem, list(dict.fromkeys(xacro.all_includes))
