"""Names of the interfaces for people, as in the documentation, and the address of their pages there."""

from dataclasses import dataclass
from functools import cache
from importlib.metadata import PackageNotFoundError, metadata
from typing import Final


@dataclass(frozen=True, slots=True)
class InterfaceTitle:
    """Title of an interface for people, and its page."""

    title: str
    page: str = ""
    """Name of its page in ``docs/``, without the suffix."""


NAMES: Final = {
    "kernels": InterfaceTitle("Kernels", "deployment"),
    "state": InterfaceTitle("State file", "state"),
    "render": InterfaceTitle("Render server", "render-server"),
    "scene": InterfaceTitle("Live scene", "scene-api"),
    "drakeviewer": InterfaceTitle("Drake's visualizer", "drake-visualizer"),
    "treeviewer": InterfaceTitle("Tree viewer", "tree-viewer"),
    "stereo": InterfaceTitle("Stereo camera", "stereo-camera"),
    "rest": InterfaceTitle("Stereo camera's REST port", "stereo-camera"),
    "view": InterfaceTitle("Browser view", "view"),
    "log": InterfaceTitle("Log", "logs"),
    "foxglove": InterfaceTitle("Foxglove", "foxglove"),
    "demo": InterfaceTitle("Demo"),
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
