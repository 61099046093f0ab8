"""Director's tree viewer over LCM and TCPQ."""

from gateway.adapters.treeviewer.config import TreeViewerConfig
from gateway.adapters.treeviewer.service import TreeViewerService
from gateway.runtime.lcm.config import LcmConfig
from gateway.wiring import metrics
from gateway.wiring.context import Context, Provided


async def setup(context: Context, provided: Provided) -> Provided:
    """Run the tree viewer's service."""
    settings = context.settings
    lcm = LcmConfig(url=settings.lcm_url, tcpq_host=context.security.tcpq_host, tcpq_port=settings.tcpq_port)
    service = TreeViewerService(
        TreeViewerConfig(lcm=lcm, strict=settings.strict),
        context.tree,
        context.mesh_files,
        store=context.state,
        listeners=provided.lcm_listeners,
        page=context.page,
        local_meshfiles=context.local_mesh_files,
    )
    metrics.watch_tree_viewer(context.metrics, service)
    tcpq_only = settings.lcm_url == "off" and settings.tcpq_port is not None
    context.run_service("treeviewer", service, where="TCPQ" if tcpq_only else settings.lcm_url or "LCM")
    return provided
