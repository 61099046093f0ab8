"""The interfaces by name, in order of start: each after those whose part of ``Provided`` it uses."""

from collections.abc import Awaitable, Callable, Mapping
from functools import partial
from importlib import import_module
from typing import Final

from gateway.runtime.settings import Settings
from gateway.wiring.context import Context
from gateway.wiring.provided import Provided

Setup = Callable[[Context, Provided], Awaitable[Provided]]
"""Starts an interface. Gets and returns what the interfaces that have started provide."""


async def _setup(module: str, context: Context, provided: Provided) -> Provided:
    """Import a wiring module, and call its ``setup``.

    Its imports load compiled kernels, which must be in the cache by then. An import that fails (a system library is
    missing) stops this interface only.
    """
    setup: Setup = import_module(f"gateway.wiring.{module}").setup
    return await setup(context, provided)


INTERFACES: Final[Mapping[str, Setup]] = {
    "render": partial(_setup, "render"),
    "drakeviewer": partial(_setup, "drakeviewer"),
    "treeviewer": partial(_setup, "treeviewer"),
    "stereo": partial(_setup, "stereo"),
    "scene": partial(_setup, "sceneapi"),
    "view": partial(_setup, "view"),
    "foxglove": partial(_setup, "foxglove"),
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
