"""The interfaces by name, in order of start."""

from __future__ import annotations

from collections.abc import Awaitable, Callable, Mapping
from importlib import import_module
from typing import Final

from gateway.settings import Settings
from gateway.wiring.context import Context

Setup = Callable[[Context], Awaitable[None]]


def _setup_of(module: str) -> Setup:
    """Return ``setup`` of a wiring module, which is imported on the first call.

    Its imports load compiled kernels, which must be in the cache by then. An import that fails (a system library is
    missing) stops this interface only.
    """

    async def setup(context: Context) -> None:
        await import_module(f"gateway.wiring.{module}").setup(context)

    return setup


INTERFACES: Final[Mapping[str, Setup]] = {
    "render": _setup_of("render"),
    "scene": _setup_of("sceneapi"),
    "drakeviewer": _setup_of("drakeviewer"),  # before the tree viewer, whose LCM transports it uses
    "treeviewer": _setup_of("treeviewer"),
    "stereo": _setup_of("stereo"),
    "view": _setup_of("view"),  # after the interfaces that it shows
    "foxglove": _setup_of("foxglove"),  # after the stereo camera, whose images it shows
    "demo": _setup_of("demo"),
}


def enabled_interfaces(settings: Settings) -> dict[str, Setup]:
    """Return the interfaces that the settings enable (``--only``, ``--demo``, ``--drake-viewer``, …)."""
    enabled = {
        "demo": settings.demo,
        "drakeviewer": settings.drake_viewer and settings.is_enabled("treeviewer"),
        "foxglove": settings.foxglove_port is not None,
    }
    return {name: setup for name, setup in INTERFACES.items() if enabled.get(name, settings.is_enabled(name))}
