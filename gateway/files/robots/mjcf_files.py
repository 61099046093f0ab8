"""Finds the files that an MJCF document refers to: for their digests, and to name the link in an error of MuJoCo."""

import os
from collections.abc import Iterator
from pathlib import Path
from typing import Final

from gateway.files.robots.limits import RobotLimits
from scenegate.robots.robot_errors import RobotFileError
from scenegate.robots.robot_files import RobotFiles
from scenegate.robots.xml_text import Element, parse_xml

MAX_FOLDERS: Final = 16
"""Maximum number of folders in which an asset is searched: robots have at most four."""
MAX_INCLUDES: Final = 1000
"""Maximum number of ``<include>`` elements that are followed: robots have fewer than 20."""


class MjcfFiles:
    """Files that a document and its includes refer to. MuJoCo reads them again, and reports errors in them."""

    def __init__(self, root: Element, files: RobotFiles, limits: RobotLimits) -> None:
        """Read the files that exist, so that their digests are recorded.

        Raises RobotFileError if one is larger than allowed, or they have too many elements.
        """
        self._files = files
        self._limits = limits
        self._folder = files.path.parent
        self._documents = list(self._included(root))
        folders = {self._folder}
        for document in self._documents:
            for compiler in document.iter("compiler"):
                for attribute in ("assetdir", "meshdir", "texturedir"):
                    folders.add(self._folder / (compiler.get(attribute) or ""))
        if len(folders) > MAX_FOLDERS:
            raise RobotFileError(f"its compiler elements name more than {MAX_FOLDERS} folders")
        for document in self._documents:
            for element in document.iter():
                for attribute, name in element.items():
                    if attribute.startswith("file") and name and element.tag != "include":  # file, fileright, fileup …
                        self._record(folder / name for folder in sorted(folders))

    def link_prefix(self, message: str) -> str:
        """Return "link 'a': " for the first body with the mesh file of an error of MuJoCo; or an empty text."""
        body_by_mesh: dict[str, str | None] = {}
        for document in self._documents:
            for body in document.iter("body"):
                for geom in body.findall("geom"):
                    body_by_mesh.setdefault(geom.get("mesh", ""), body.get("name"))
        for document in self._documents:
            for mesh in document.iter("mesh"):
                name = mesh.get("file", "")
                body_name = body_by_mesh.get(mesh.get("name") or Path(name).stem)
                if name and body_name is not None and Path(name).name in message:
                    return f"link {body_name!r}: "
        return ""

    def _included(self, root: Element) -> Iterator[Element]:
        """Yield the document and those that it includes, each file once. MuJoCo reports repeated includes.

        Raises RobotFileError if there are too many ``<include>`` elements, or too many elements.
        """
        remaining, include_count, element_count = [root], 0, sum(1 for _ in root.iter())
        seen = {os.fspath(self._files.path)}
        while remaining:
            document = remaining.pop()
            yield document
            for include in document.iter("include"):
                path = self._folder / include.get("file", "")
                include_count += 1
                if include_count > MAX_INCLUDES:
                    raise RobotFileError(f"it includes more than {MAX_INCLUDES} files")
                if os.path.realpath(path) in seen:
                    continue
                seen.add(os.path.realpath(path))
                try:
                    # Without warnings: MuJoCo reads the file itself.
                    included = parse_xml(self._files.read(path), self._limits.max_elements, [])
                except (OSError, RobotFileError) as error:
                    if path.exists() and not path.is_file():  # MuJoCo would wait for a named pipe
                        raise RobotFileError(f"{include.get('file')} is not a regular file") from error
                    continue  # MuJoCo reports it
                element_count += sum(1 for _ in included.iter())
                if element_count > self._limits.max_elements:
                    raise RobotFileError(f"it and its includes have more than {self._limits.max_elements} XML elements")
                remaining.append(included)

    def _record(self, candidates: Iterator[Path]) -> None:
        """Read the first file that exists, which records its digest.

        Raises RobotFileError if it is too large, or not a regular file. MuJoCo would wait for a named pipe.
        """
        for path in candidates:
            if path.exists() and not path.is_dir():
                self._files.read(path)
                return
