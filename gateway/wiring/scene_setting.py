"""Scene files that settings name, read while the gateway starts."""

import asyncio
from pathlib import Path
from typing import Final

import structlog

from gateway.files.assets.scene_file import SceneFile
from gateway.files.robots.scene_files import SceneOptions, read_scene
from gateway.runtime.settings import Settings
from gateway.runtime.workers.pool_errors import CallerCancelled
from renderers.stop import StopFlag

_log = structlog.get_logger("gateway")

MAX_LOGGED: Final = 20
"""Maximum number of warnings about a file in the log."""


async def read_scene_setting(file: str, settings: Settings) -> SceneFile:
    """Read the scene file of a setting in a thread. Reading may take minutes; cancelling the task stops it.

    Settings have the options of scene files (``--up``, ``--mesh-root``, ``--strict``, …). Raises SceneFileError.
    """
    _log.info("Reading a scene file", file=file)
    options = SceneOptions(
        settings.up,
        settings.scale,
        roots=settings.mesh_folders,
        xacro_args=settings.xacro_arg,
        robot_gltf_up=settings.robot_gltf_up,
        strict=settings.strict,
    )
    stop = StopFlag()
    try:
        scene = await asyncio.to_thread(stop.run, lambda: read_scene(Path(file), options))
    except asyncio.CancelledError:
        stop.set(CallerCancelled("the gateway stops"))
        raise
    for warning in scene.warnings[:MAX_LOGGED]:
        _log.warning("Part of a scene file is not shown", file=file, reason=warning)
    for note in scene.notes:
        _log.info("A scene file was read", file=file, choice=note)
    return scene
