"""Content of the page's status bar."""

from typing import Any

from gateway.adapters.viewer.messages import Fact, InterfaceState, Status
from gateway.runtime.http.interface_names import documentation_of, title_of
from gateway.runtime.service_registry import ServiceRegistry
from gateway.runtime.workers.worker_pool import PoolStats


def gateway_status(registry: ServiceRegistry, workers: PoolStats) -> Status:
    """Return the interfaces' states, the time of Drake's simulation, the queue, lost messages and streams."""
    details: dict[str, dict[str, Any]] = {name: entry.describe() for name, entry in registry.entries.items()}
    interfaces = {
        name: InterfaceState(
            state=described["state"],
            title=title_of(name),
            documentation=documentation_of(name),
            problem=described.get("problem", ""),
            warnings=described.get("warnings", []),
        )
        for name, described in details.items()
    }
    facts: list[Fact] = []
    seconds = details.get("drakeviewer", {}).get("simulation_seconds")
    if seconds is not None:
        facts.append(Fact(name="simulation", value=f"{seconds:.2f} s"))
    indexed = details.get("log", {}).get("indexed", 1.0)
    if indexed < 1.0:
        facts.append(Fact(name="indexed", value=f"{100 * indexed:.0f} %"))
    facts.append(Fact(name="queue", value=workers.waiting, warn=workers.rejected > 0))
    lcm = details.get("treeviewer", {}).get("lcm")
    if isinstance(lcm, dict) and "dropped" in lcm:  # by a full queue, and by the kernel
        lost = lcm["dropped"] + lcm.get("lost_datagrams", 0)
        facts.append(Fact(name="lost LCM", value=lost, warn=lost > 0))
    clients = details.get("stereo", {}).get("clients")
    if clients is not None:
        facts.append(Fact(name="streams", value=clients))
    return Status(interfaces=interfaces, facts=facts)
