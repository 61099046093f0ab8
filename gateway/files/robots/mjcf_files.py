"""Reads the files that an MJCF document refers to, for their digests."""

import os
from collections.abc import Iterator
from typing import Final

from gateway.files.robots.limits import RobotLimits
from scenegate.robots.robot_errors import RobotFileError
from scenegate.robots.robot_files import RobotFiles
from scenegate.robots.xml_text import Element, parse_xml

MAX_FOLDERS: Final = 16
"""Maximum number of folders in which an asset is searched: robots have at most four."""
MAX_INCLUDES: Final = 1000
"""Maximum number of ``<include>`` elements that are followed: robots have fewer than 20."""


def read_mjcf_files(root: Element, files: RobotFiles, limits: RobotLimits) -> None:
    """Read the files that a document and its includes refer to, where they exist. MuJoCo reads them again.

    Raises RobotFileError if one is larger than allowed, or they have too many elements.
    """
    folder = files.path.parent
    documents = list(_included(root, files, limits))
    folders = {folder}
    for document in documents:
        for compiler in document.iter("compiler"):
            for attribute in ("assetdir", "meshdir", "texturedir"):
                folders.add(folder / (compiler.get(attribute) or ""))
    if len(folders) > MAX_FOLDERS:
        raise RobotFileError(f"its compiler elements name more than {MAX_FOLDERS} folders")
    for document in documents:
        for element in document.iter():
            for attribute, name in element.items():
                if attribute.startswith("file") and name and element.tag != "include":  # file, fileright, fileup …
                    paths = (each / name for each in sorted(folders))
                    # MuJoCo would wait for a named pipe, which ``read`` refuses.
                    if path := next((path for path in paths if path.exists() and not path.is_dir()), None):
                        files.read(path)


def _included(root: Element, files: RobotFiles, limits: RobotLimits) -> Iterator[Element]:
    """Yield the document and those that it includes, each file once. MuJoCo reports repeated includes.

    Raises RobotFileError if there are too many ``<include>`` elements, or too many elements.
    """
    remaining, include_count, element_count = [root], 0, sum(1 for _ in root.iter())
    seen = {os.fspath(files.path)}
    while remaining:
        document = remaining.pop()
        yield document
        for include in document.iter("include"):
            path = files.path.parent / include.get("file", "")
            include_count += 1
            if include_count > MAX_INCLUDES:
                raise RobotFileError(f"it includes more than {MAX_INCLUDES} files")
            if os.path.realpath(path) in seen:
                continue
            seen.add(os.path.realpath(path))
            try:
                # Without warnings: MuJoCo reads the file itself.
                included = parse_xml(files.read(path), limits.max_elements, [])
            except (OSError, RobotFileError) as error:
                if path.exists() and not path.is_file():  # MuJoCo would wait for a named pipe
                    raise RobotFileError(f"{include.get('file')} is not a regular file") from error
                continue  # MuJoCo reports it
            element_count += sum(1 for _ in included.iter())
            if element_count > limits.max_elements:
                raise RobotFileError(f"it and its includes have more than {limits.max_elements} XML elements")
            remaining.append(included)
