"""Expands xacro files with the package xacro.

xacro evaluates Python expressions and reads included files, so only files that the user names are expanded.
"""

import errno
import os
import sys
from collections.abc import Callable
from pathlib import Path
from types import ModuleType
from typing import Any

import xacro
from xacro.substitution_args import ArgException


def _refuse_other_files(event: str, arguments: tuple[Any, ...]) -> None:
    """Raise OSError before a file is opened that is not regular: a named pipe would block for ever."""
    if event == "open" and isinstance(arguments[0], str):
        path = Path(arguments[0])
        if path.exists() and not path.is_file():
            raise OSError(errno.EINVAL, "it is not a regular file", arguments[0])


class _Args(dict[str, str]):
    """Values of arguments by name."""

    def __init__(self, values: dict[str, str]) -> None:
        super().__init__(values)
        self.used: set[str] = set()
        """Names that the document has."""

    def __getitem__(self, name: str) -> str:
        self.used.add(name)
        return super().__getitem__(name)

    def __contains__(self, name: object) -> bool:
        self.used.add(str(name))
        return super().__contains__(name)


def _missing_arg(error: BaseException | None) -> str:
    """Return the name of the argument without a value that is the cause of an error; empty if that is another one."""
    while error is not None and not isinstance(error, ArgException):
        error = getattr(error, "exc", None) or error.__context__
    return "" if error is None else str(error)


def expand_file(
    read_file: Callable[[str], bytes], path: str, values: dict[str, str]
) -> tuple[str, str, str, list[str], list[str]]:
    """Expand a file with arguments by name. ``read_file`` returns the folder of a package.

    Returns the XML or an error text; the argument whose lack is the error, if it is one; the names of the arguments
    that it has; the paths of the files that were read.
    """
    packages = ModuleType("ament_index_python.packages")
    vars(packages)["get_package_share_directory"] = lambda name: os.fsdecode(read_file(name))
    # xacro imports this module of ROS for $(find package); it is on no package index.
    sys.modules["ament_index_python"] = ModuleType("ament_index_python")
    sys.modules["ament_index_python.packages"] = packages
    sys.addaudithook(_refuse_other_files)
    args, missing = _Args(values), ""
    try:
        document, problem = xacro.process_file(path, mappings=args).toxml(), ""
    except Exception as error:  # noqa: BLE001 - expressions of the file can raise anything
        cause = getattr(error, "exc", None)
        missing = _missing_arg(error)
        reason = cause if isinstance(cause, OSError) else error  # xacro repeats the text of its cause
        document, problem = "", " ".join(f"{reason}".split()) or type(error).__name__
    return document, problem, missing, sorted(args.used), list(dict.fromkeys(xacro.all_includes))
