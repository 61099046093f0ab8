"""The interfaces by name, in order of start."""

from __future__ import annotations

from collections.abc import Awaitable, Callable, Mapping
from functools import partial
from importlib import import_module
from typing import Final

from gateway.runtime.settings import Settings
from gateway.wiring.context import Context

Setup = Callable[[Context], Awaitable[None]]


async def _setup(module: str, context: Context) -> None:
    """Import a wiring module, and call its ``setup``.

    Its imports load compiled kernels, which must be in the cache by then. An import that fails (a system library is
    missing) stops this interface only.
    """
    await import_module(f"gateway.wiring.{module}").setup(context)


INTERFACES: Final[Mapping[str, Setup]] = {
    "render": partial(_setup, "render"),
    "scene": partial(_setup, "sceneapi"),
    "drakeviewer": partial(_setup, "drakeviewer"),  # before the tree viewer, whose LCM transports it uses
    "treeviewer": partial(_setup, "treeviewer"),
    "stereo": partial(_setup, "stereo"),
    "view": partial(_setup, "view"),  # after the interfaces that it shows
    "foxglove": partial(_setup, "foxglove"),  # after the stereo camera, whose images it shows
    "demo": partial(_setup, "demo"),
}


def enabled_interfaces(settings: Settings) -> dict[str, Setup]:
    """Return the interfaces that the settings enable (``--only``, ``--demo``, ``--drake-viewer``, …)."""
    enabled = {
        "demo": settings.demo,
        "drakeviewer": settings.drake_viewer and settings.is_enabled("treeviewer"),
        "foxglove": settings.foxglove_port is not None,
    }
    return {name: setup for name, setup in INTERFACES.items() if enabled.get(name, settings.is_enabled(name))}
