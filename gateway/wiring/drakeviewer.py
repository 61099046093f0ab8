"""Wiring of Drake's visualizer channels, which are received by the tree viewer's LCM transports."""

from dataclasses import replace

from gateway.adapters.drakeviewer.channels import PREFIXES
from gateway.adapters.drakeviewer.config import DrakeViewerConfig
from gateway.adapters.drakeviewer.service import DrakeViewerService
from gateway.runtime.lcm.listener import ChannelListener
from gateway.wiring.context import Context, Provided


async def setup(context: Context, provided: Provided) -> Provided:
    """Run the service; the tree viewer's transports pass messages to it."""
    service = DrakeViewerService(
        context.tree,
        context.mesh_files,
        DrakeViewerConfig(strict=context.settings.strict),
        local_files=context.local_mesh_files,
    )
    context.run_service("drakeviewer", service, where="LCM, the channels of Drake's simulations")
    listener = ChannelListener(PREFIXES, service.receive)
    return replace(provided, lcm_listeners=(*provided.lcm_listeners, listener))
