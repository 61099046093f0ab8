"""The moving demo scene in the live tree (``--demo``)."""

from gateway.demo import Demo
from gateway.wiring.context import Context, Provided


async def setup(context: Context, provided: Provided) -> Provided:
    """Run the demo scene's service."""
    context.run_service("demo", Demo(context.tree))
    return provided
