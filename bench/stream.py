"""The stereo camera's stream: our fan-out against per-client protobuf and raw TCP, and the live camera, in one run.

    python -m bench.stream [--seconds 3] [--payloads ABCD] [--clients 1 4 16] [--rounds 3] [--live]

For each payload and number of clients: sets per second over all clients, MB/s, the server's CPU seconds per second and
its CPU ms per set (of one client), the clients' CPU, the event loop's stall at a 1 ms ticker (p99, max, ms), and the
ratio of our MB/s to the others'. Clients are Python processes (with ``--native PROGRAM`` of bench/stream_client.cc,
C++ ones) that take the bytes and do not parse them. ``shared`` joins every set anew, as the camera does; ``again``
sends the same set again and again, which is all that raw TCP does. ``--native-server PROGRAM`` of
bench/stream_server.cc adds the least that gRPC costs: a C++ server that hands the library one shared slice. On a busy
machine the second figure of each ratio counts: bytes per CPU second of server and clients together.

``--rounds N`` repeats each comparison and prints the medians of the ratios: on a busy machine single rounds say little.

``--live`` renders: left, right, disparity, error and confidence of a scene with noise (``--scene table``, or ``demo``:
the moving one of ``serve --demo``); the age is from timestamp to client. ``--slow`` adds a client that reads twice a
second. ``--realism off all lens-blur,vignetting`` makes one run for each. ``--minutes N`` runs the live camera so long
and prints its memory every tenth of it and its slope. ``--steps`` prints how much CPU time each turn of the loop took
in our code and in the stream's writers (gRPC's own sending included).
"""

from __future__ import annotations

import argparse
import json
import os
import socket
import subprocess
import sys
import tempfile
import time
from statistics import median
from typing import Any

import numpy as np

from bench.stream_servers import payload
from gateway.adapters.stereo.stream import image_messages as messages
from gateway.runtime.workers.process_tuning import tune

ROW = "{:<30}{:>8}{:>9}{:>8}{:>9}{:>9}{:>9}{:>11}{:>11}{:>8}{:>8}"
HEAD = ROW.format(
    "", "clients", "sets/s", "MB/s", "CPU srv", "ms/set", "CPU cli", "stall p99", "stall max", "age ms", "RSS MB"
)  # fmt: skip
LIVE = {"left_enabled", "right_enabled", "disparity_enabled", "disparity_error_enabled", "confidence_enabled"}


def client(kind: str, port: int, seconds: float, pause: float) -> None:
    """One client: prints its figures."""
    tune()  # the same malloc for both sides
    ages: list[float] = []
    count = size = 0
    begin = cpu = 0.0
    if kind == "tcp":
        source = _tcp_sets(port)
    else:
        source = _grpc_sets(port)
    for data in source:
        now = time.monotonic()
        if count == 0:
            print("started", flush=True)
            begin, cpu = now, time.process_time()
        count += 1
        size += len(data)
        ages.append(time.time() - _stamp(data))
        if now - begin > seconds:
            break
        if pause:
            time.sleep(pause)
    spent = time.monotonic() - begin
    ages.sort()
    print(
        json.dumps(
            {
                "sets": (count - 1) / spent,
                "mb": size * (count - 1) / count / spent / 1e6,
                "cpu": (time.process_time() - cpu) / spent,
                "age": ages[len(ages) // 2] * 1000,
                "slow": bool(pause),
            }
        ),
        flush=True,
    )
    os._exit(0)


def _grpc_sets(port: int) -> Any:
    import grpc

    from scenegate.camera import image_interface_pb2 as pb

    wanted: dict[str, Any] = dict.fromkeys(LIVE, True)
    options = [("grpc.max_receive_message_length", -1)]
    channel = grpc.insecure_channel(f"127.0.0.1:{port}", options)
    request = pb.ImageSetRequest(**wanted)
    return channel.unary_stream("/ImageInterface/StreamImageSets", pb.ImageSetRequest.SerializeToString)(request)


def _tcp_sets(port: int) -> Any:
    connection = socket.create_connection(("127.0.0.1", port))
    buffer = bytearray(64 << 20)
    view = memoryview(buffer)
    while True:
        _fill(connection, view[:8])
        size = int.from_bytes(buffer[:8], "little")
        _fill(connection, view[:size])
        yield view[:size]


def _fill(connection: socket.socket, view: memoryview) -> None:
    while view:
        view = view[connection.recv_into(view) :]


def _stamp(data: Any) -> float:
    """The set's timestamp: the first field, so the rest need not be parsed."""
    from scenegate.camera import image_interface_pb2 as pb

    try:
        stamp = pb.ImageSet.FromString(bytes(data[: 2 + data[1]])).timestamp
    except ValueError:  # another order of fields: protobuf's own
        return time.time()
    return float(stamp.sec + stamp.nsec * 1e-9)


def run(
    label: str,
    kind: str,
    arguments: list[str],
    clients: int,
    seconds: float,
    slow: int = 0,
    steps: bool = False,
    native: str = "",
) -> dict[str, float]:
    """One cell of the table."""
    command = [sys.executable, "-m", "bench.stream_servers", *(["--steps"] if steps else []), kind, *arguments]
    if kind == "c++":
        command = arguments
    with subprocess.Popen(
        command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True
    ) as server:
        assert server.stdout is not None
        assert server.stdin is not None
        line = server.stdout.readline()
        while line and not line.strip().isdigit():  # log lines
            line = server.stdout.readline()
        port = line.strip()
        base = [sys.executable, "-m", "bench.stream", "--client", kind, port, str(seconds)]
        if native:
            base = [native, f"tcp:{port}" if kind == "tcp" else f"127.0.0.1:{port}", str(seconds)]
        children = [
            subprocess.Popen([*base, "0.5" if i < slow else "0"], stdout=subprocess.PIPE, text=True)
            for i in range(clients + slow)
        ]
        for child in children:
            assert child.stdout is not None
            child.stdout.readline()
        server.stdin.write("go\n")
        server.stdin.flush()
        answers = [json.loads(child.communicate()[0]) for child in children]
        server.stdin.close()
        lines = [l for l in server.stdout if l.startswith("{")]
        figures = json.loads(lines[-1])
        server.kill()
    fast = [a for a in answers if not a["slow"]]
    total = {"sets": sum(a["sets"] for a in fast), "mb": sum(a["mb"] for a in fast), **figures}
    total["cost"] = (figures["cpu"] + sum(a["cpu"] for a in answers)) / total["mb"]
    stalls = [f"{figures[name]:.1f}" if name in figures else "" for name in ("stall_p99", "stall_max")]
    print(
        ROW.format(
            label, f"{clients}+{slow}" if slow else clients, f"{total['sets']:.1f}", f"{total['mb']:.0f}",
            f"{figures['cpu']:.2f}", f"{figures['cpu'] * 1000 * len(fast) / total['sets']:.1f}",
            f"{sum(a['cpu'] for a in answers):.2f}", *stalls,
            f"{sum(a['age'] for a in fast) / len(fast):.1f}" if kind == "live" else "",
            f"{figures['rss']:.0f}",
        ),
        flush=True,
    )  # fmt: skip
    if seconds >= 60:
        memory = figures["memory"]
        settled = memory[len(memory) // 3 :]
        slope = float(np.polyfit(np.arange(len(settled)) * 2.0 / 60.0, settled, 1)[0])
        print("   resident MB over time:", *(f"{m:.0f}" for m in memory[:: max(len(memory) // 10, 1)]))
        print(f"   slope over the last two thirds: {slope:+.2f} MB per minute")
    for name in ("ours", "writer"):
        if f"{name}_max" in figures:
            print(f"   {name}: p99 {figures[f'{name}_p99'] * 1e3:.2f} ms, max {figures[f'{name}_max'] * 1e3:.2f} ms")
    return total


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seconds", type=float, default=3.0)
    parser.add_argument("--payloads", default="ABCD")
    parser.add_argument("--rounds", type=int, default=1, help="repeat each comparison so often, one after the other")
    parser.add_argument("--clients", type=int, nargs="+", default=[1, 4, 16])
    parser.add_argument("--live", action="store_true")
    parser.add_argument("--look", default="gltf")
    parser.add_argument("--quality", default="High")
    parser.add_argument("--realism", default=["off"], nargs="+", help="one run for each, as of --stereo-realism")
    parser.add_argument("--scene", default="table", choices=("table", "demo"))
    parser.add_argument("--slow", type=int, default=0)
    parser.add_argument("--steps", action="store_true")
    parser.add_argument("--native", default="", help="the program made of bench/stream_client.cc")
    parser.add_argument("--native-server", default="", help="the program made of bench/stream_server.cc")
    parser.add_argument("--minutes", type=float, default=0.0)
    parser.add_argument("--client", nargs=4, help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.client:
        client(options.client[0], int(options.client[1]), float(options.client[2]), float(options.client[3]))
    print(HEAD)
    if options.live or options.minutes:
        seconds = options.minutes * 60 or options.seconds
        name = "live" if options.scene == "table" else options.scene
        for rate in ("max",) if options.minutes else ("max", "device"):
            for n, realism in [(n, realism) for n in options.clients for realism in options.realism]:
                arguments = [rate, options.look, options.quality, options.scene, realism]
                label = f"{name} {options.quality} {options.look} {rate}"
                run(
                    label if realism == "off" else f"{label} {realism}",
                    "live",
                    arguments,
                    n,
                    seconds,
                    options.slow,
                    options.steps,
                )
        return
    kinds = ["tcp", "c++", "proto", "again", "shared"] if options.native_server else ["tcp", "proto", "again", "shared"]
    for name in options.payloads:
        with tempfile.NamedTemporaryFile() as file:
            file.write(messages.join(payload(name)))
            file.flush()
            for n in options.clients:
                rounds = [
                    {
                        kind: run(
                            f"{name} {kind}",
                            kind,
                            [options.native_server, file.name] if kind == "c++" else [name],
                            n,
                            options.seconds,
                            native=options.native,
                        )
                        for kind in kinds
                    }
                    for _ in range(options.rounds)
                ]
                _compare(rounds, kinds)


def _compare(rounds: list[dict[str, dict[str, float]]], kinds: list[str]) -> None:
    """Prints the medians of the ratios: bytes per second, and bytes per CPU second of server and clients."""
    for kind in ("shared", "again", "c++"):
        for other in ("tcp", "c++", "proto"):
            if not {kind, other} <= {*kinds} or kind == other or (kind, other) == ("c++", "proto"):
                continue
            speed = median(r[kind]["mb"] / r[other]["mb"] for r in rounds)
            cost = median(r[other]["cost"] / r[kind]["cost"] for r in rounds)
            print(f"   {kind:>6} / {other:<5} {speed:.2f}, per CPU second {cost:.2f} (medians of {len(rounds)})")


if __name__ == "__main__":
    main()
