"""Scene files that settings name, read while the gateway starts."""

from __future__ import annotations

import asyncio
from pathlib import Path

import structlog

from gateway.assets.scene_file import SceneFile
from gateway.robots.scene_files import read_scene
from gateway.runtime.worker_pool import CallerCancelled
from gateway.settings import Settings
from renderers.stop import StopFlag

_log = structlog.get_logger("gateway")


async def read_scene_setting(file: str, settings: Settings) -> SceneFile:
    """Read the scene file of a setting in a thread. Reading may take minutes; cancelling the task stops it.

    Args:
        file: path of the file.
        settings: settings with the up axis and the folders of robot packages (``--up``, ``--mesh-root``).

    Raises:
        SceneFileError: see ``read_scene``.
    """
    _log.info("Reading a scene file", file=file)
    stop = StopFlag()
    try:
        return await asyncio.to_thread(
            stop.run, lambda: read_scene(Path(file), up=settings.up, roots=settings.mesh_root)
        )
    except asyncio.CancelledError:
        stop.set(CallerCancelled("the gateway stops"))
        raise
