"""The tree viewer against its peers: the same jobs, from the client's call to the viewer's answer.

    python -m bench.treeviewer [--peers PYTHON] [--seconds S] [--latency]

Ours runs as the service that the gateway runs, in a process of its own, over UDP multicast and over the TCPQ hub. The
floor is the least that any viewer of this protocol could do: a loop of liblcm, the fastest JSON reader at hand (orjson
if it is installed) and a dict, over UDP. An echo by liblcm shows how long a small message takes while another client's
big one arrives, without any viewer. PYTHON is an interpreter with meshcat, viser or pydrake; see
``bench/treeviewer_peers.py`` for what is measured there. Every figure is a median (p99 after the slash) in ms. S bounds
each job; the whole takes about 30 S. With ``--latency`` only the small message beside big ones is measured. Binary
messages are ``bench.treeviewer_binary``'s.
"""

import argparse
import contextlib
import json
import random
import subprocess
import time

from bench.table import Row, show
from bench.treeviewer_clients import Client, Figures, measure, percentile, process, started
from bench.treeviewer_requests import JOBS, transforms
from bench.treeviewer_servers import json_reader
from gateway.adapters.treeviewer import responses
from gateway.adapters.treeviewer.protocol import TreeViewerProtocol
from gateway.scene.tree.live import LiveTree

FLOOD = 3000


def others(url: str, kind: str, seconds: float) -> tuple[list[float], list[float]]:
    """Milliseconds of single transforms while another client sends big messages; and of those."""
    place = ("--url", url, "--seconds", str(seconds))
    with contextlib.ExitStack() as stack:
        both = [
            stack.enter_context(process("-m", "bench.treeviewer_clients", part, *place, stdin=subprocess.PIPE))
            for part in ("small", kind)
        ]
        for child in both:
            started(child)
        for child in both:
            assert child.stdin is not None
            child.stdin.write("\n")
            child.stdin.flush()
        found = [json.loads(child.stdout.readline() or "[]") for child in both if child.stdout is not None]
        return found[0], found[1]


def peers_of(python: str, seconds: float) -> list[Figures]:
    with process("-m", "bench.treeviewer_peers", str(seconds), python=python) as child:
        assert child.stdout is not None
        found = [json.loads(line) for line in child.stdout if line.startswith("{")]
    return [Figures(entry["name"], entry["jobs"]) for entry in found]


def in_process(messages: dict[str, bytes], seconds: float) -> Figures:
    """Ours without a transport, for the peers that are measured in process."""
    protocol, figures = TreeViewerProtocol(LiveTree()), Figures("ours, in process")
    for job, message in messages.items():
        responses.encode(protocol.handle(message))
        times: list[float] = []
        end = time.monotonic() + seconds
        while time.monotonic() < end and len(times) < 5000:
            begin = time.perf_counter()
            responses.encode(protocol.handle(message))
            times.append(1000.0 * (time.perf_counter() - begin))
        figures.jobs[job] = times
    return figures


SMALL_BESIDE_BIG = "1 transform while another client sends a {kind} of 11 MB after the other, {transport}"


def latency(urls: dict[str, str], seconds: float) -> list[str]:
    """Sentences about a small message's delay beside big ones; ``urls`` by name of what serves there."""
    lines = []
    for transport, url in urls.items():
        for kind in ("mesh", "cloud"):
            times, big = others(url, kind, 2 * seconds)
            what = SMALL_BESIDE_BIG.format(kind=kind, transport=transport)
            lines.append(
                f"{what}: p50 {percentile(times, 0.5):.2f}, p99 {percentile(times, 0.99):.2f}, max {max(times):.1f} ms "
                f"({len(big)} of them, median {percentile(big, 0.5):.0f} ms)"
            )
    return lines


def compare(peers: str | None, seconds: float, only_latency: bool) -> None:
    number = random.randrange(20000, 50000)
    udp, floor_udp, echo_udp = (f"udpm://239.255.76.67:{number + k}?ttl=0" for k in (0, 1, 2))
    tcpq = f"tcpq://127.0.0.1:{number}"
    messages = {job: make() for job, make in JOBS.items()}
    lines: list[str] = []
    table: list[Figures] = []
    with (
        process("-m", "bench.treeviewer_servers", "serve", "--url", udp, "--port", str(number)) as ours,
        process("-m", "bench.treeviewer_servers", "floor", "--url", floor_udp) as plain,
        process("-m", "bench.treeviewer_servers", "echo", "--url", echo_udp) as bare,
    ):
        for server in (ours, plain, bare):
            started(server)
        if not only_latency:
            floor_name = f"floor ({json_reader()}), udp"
            table = measure({"ours, udp": udp, "ours, tcpq": tcpq, floor_name: floor_udp}, messages, seconds)
            for url, transport in ((udp, "udp"), (tcpq, "tcpq")):
                for count in (1, 100):
                    answered, took = Client(url, "flood").flood(transforms(count), FLOOD)
                    lines.append(
                        f"flood {transport}, {count} transforms each: {answered} of {FLOOD} answered, "
                        f"{answered * count / took:,.0f} transforms/s"
                    )
        lines += latency({"udp": udp, "tcpq": tcpq, "udp, a bare echo by liblcm": echo_udp}, seconds)
    if only_latency:
        print(*lines, sep="\n")
        return
    table.append(in_process(messages, seconds))
    found = peers_of(peers, seconds) if peers else []
    report(table, found, lines)


def report(table: list[Figures], peers: list[Figures], lines: list[str]) -> None:
    print(f"{'ms, median/p99':<20}" + "".join(f"{figures.name:>21}" for figures in (*table, *peers)))
    for job in JOBS:
        print(f"{job:<20}" + "".join(f"{figures.cell(job):>21}" for figures in (*table, *peers)))
    print(*lines, sep="\n")
    ours, _, plain, inside = table
    rows = []
    for job in JOBS:
        for peer in (plain, *(peer for peer in peers if peer.jobs.get(job))):
            # viser's server is in the client's process
            same = inside if peer.name == "viser" else ours
            ours_ms, peer_ms = same.median(job), peer.median(job)
            what, theirs = f"tree viewer, {same.name}: {job}", f"{peer.name} {peer_ms:.3g} ms"
            rows.append(Row(what, f"{ours_ms:.3g} ms", theirs, f"{peer_ms / ours_ms:.2f}×"))
    show(rows)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--peers", help="an interpreter with meshcat, viser or pydrake")
    parser.add_argument("--seconds", type=float, default=3.0)
    parser.add_argument("--latency", action="store_true", help="only the delay of small messages beside big ones")
    given = parser.parse_args()
    compare(given.peers, given.seconds, given.latency)


if __name__ == "__main__":
    main()
