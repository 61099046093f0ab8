"""Settings of LCM. ``gateway.wiring`` fills them from the options."""

from dataclasses import dataclass

from scenegate.lcm.transport import MIB, TransportLimits


@dataclass(frozen=True, slots=True, kw_only=True)
class LcmConfig(TransportLimits):
    """Addresses and limits of the LCM transports."""

    url: str | None = None
    """LCM URL. None: LCM_DEFAULT_URL, or liblcm's default udpm://239.255.76.67:7667?ttl=0. ``off``: no LCM."""
    tcpq_host: str = "127.0.0.1"
    """Address on which the TCPQ hub listens."""
    tcpq_port: int | None = 7700
    """Port of the TCPQ hub. None: no hub; 0: a free port."""
    hub_clients: int = 256
    """Maximum number of connections to the hub."""
    hub_client_send_bytes: int = 512 * MIB
    """Maximum bytes queued for one client of the hub. A client that reads too slowly is disconnected."""
    hub_subscriptions: int = 256
    """Maximum number of subscriptions of one hub client."""
