"""A part of the gateway that receives channels of the tree viewer's LCM transports and hub."""

from dataclasses import dataclass

from scenegate.lcm.transport import OnMessage


@dataclass(frozen=True, slots=True)
class ChannelListener:
    """Receives the messages of some channels."""

    prefixes: tuple[str, ...]
    """Starts of the names of the channels."""
    on_message: OnMessage
    """Called on the event loop; must not block."""
