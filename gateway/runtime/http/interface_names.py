"""Names of the interfaces for people, as in the documentation, and the address of their pages there."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from importlib.metadata import PackageNotFoundError, metadata
from typing import Final


@dataclass(frozen=True, slots=True)
class InterfaceName:
    """Name of an interface for people."""

    title: str
    page: str = ""
    """Name of its page in ``docs/``, without the suffix."""


NAMES: Final = {
    "kernels": InterfaceName("Kernels", "deployment"),
    "state": InterfaceName("State file", "state"),
    "render": InterfaceName("Render server", "render-server"),
    "scene": InterfaceName("Live scene", "scene-api"),
    "drakeviewer": InterfaceName("Drake's visualizer", "drake-visualizer"),
    "treeviewer": InterfaceName("Tree viewer", "tree-viewer"),
    "stereo": InterfaceName("Stereo camera", "stereo-camera"),
    "rest": InterfaceName("Stereo camera's REST port", "stereo-camera"),
    "view": InterfaceName("Browser view", "view"),
    "log": InterfaceName("Log", "logs"),
    "foxglove": InterfaceName("Foxglove", "foxglove"),
    "demo": InterfaceName("Demo"),
}
"""Names by that in ``/healthz``. Further stereo cameras are ``stereo 1``, ``stereo 2`` and so on."""


def title_of(name: str) -> str:
    """Return the title of an entry of ``/healthz``."""
    first, _, number = name.partition(" ")
    return f"{NAMES[first].title} {number}".rstrip() if first in NAMES else name


def documentation_of(name: str) -> str:
    """Return the address of an interface's page; empty if it has none, or if the address of the pages is not known."""
    entry = NAMES.get(name.partition(" ")[0])
    return documentation_url() + entry.page + "/" if documentation_url() and entry and entry.page else ""


@cache
def documentation_url() -> str:
    """Return the address of the documentation, with a slash at its end: the package's URL ``Documentation``, or ""."""
    try:
        urls = metadata("scenegate").get_all("Project-URL") or []
    except PackageNotFoundError:  # a copy of the sources that is not installed
        return ""
    found = [url.partition(", ")[2] for url in urls if url.startswith("Documentation, ")]
    return found[0].rstrip("/") + "/" if found else ""
