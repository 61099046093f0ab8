"""Wiring of Foxglove's WebSocket."""

from __future__ import annotations

from gateway.wiring.context import Context


async def setup(context: Context) -> None:
    """Serve Foxglove's protocol on ``--foxglove-port``."""
    try:
        from gateway.adapters.foxglove.service import FoxgloveService
    except ImportError as error:
        raise ImportError(f"{error}; --foxglove-port needs pip install 'scenegate[foxglove]'") from None

    port = context.settings.foxglove_port
    assert port is not None
    sensor = context.stereo_sensor
    rig = (lambda snapshot: None) if sensor is None else sensor.rig
    service = FoxgloveService(port, context.tree, context.stereo_service, rig)
    context.run_service("foxglove", service, where="Foxglove: ws://127.0.0.1, --foxglove-port")
