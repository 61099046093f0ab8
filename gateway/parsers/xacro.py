"""Expands xacro files with the package xacro.

xacro evaluates Python expressions and reads the files that it includes, so only files of the user are expanded.
"""

from __future__ import annotations

import os
import sys
from collections.abc import Callable
from types import ModuleType

import xacro


def expand_file(read_file: Callable[[str], bytes], path: str) -> tuple[str, str]:
    """Return the expanded XML and an empty string, or an empty string and an error text.

    Args:
        read_file: Returns the folder of a package, by the package's name.
    """
    packages = ModuleType("ament_index_python.packages")
    packages.get_package_share_directory = lambda name: os.fsdecode(read_file(name))  # type: ignore[attr-defined]
    # xacro imports this module of ROS for $(find package); it is on no package index.
    sys.modules["ament_index_python"] = ModuleType("ament_index_python")
    sys.modules["ament_index_python.packages"] = packages
    try:
        return xacro.process_file(path).toxml(), ""
    except Exception as error:  # noqa: BLE001 - expressions of the file can raise anything
        return "", " ".join(f"{error}".split()) or type(error).__name__
