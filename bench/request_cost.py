"""Cost of a render request against another build, and against the least that a server can do (``bench/http_floor.py``).

    python -m bench.request_cost [--old FOLDER] [--rounds 7] [--requests 40]

FOLDER is a clone of the other build with its ``.venv``. Depth images of 640 x 480; each request has new poses and a new
connection. The servers take turns. The best of all rounds, since other programs only disturb.
"""

import argparse
import subprocess
import sys
import time
from contextlib import ExitStack
from itertools import islice
from pathlib import Path

from bench import render_requests
from bench.gateways import Gateway, post
from bench.load_clients import run_clients
from bench.table import heading

SCENES = {"001": "600 kB", "003": "2.4 MB"}


def start_floor(stack: ExitStack, port: int, body: bytes) -> tuple[int, int]:
    """Start a floor with the response of a server; return its port and process."""
    answer = post(port, body).body
    head = f"HTTP/1.1 200 OK\r\nContent-Type: image/tiff\r\nContent-Length: {len(answer)}\r\n\r\n"
    command = (sys.executable, str(Path(__file__).with_name("http_floor.py")))
    process = stack.enter_context(subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE))
    stack.callback(process.kill)
    assert process.stdin is not None
    assert process.stdout is not None
    process.stdin.write(head.encode() + answer)
    process.stdin.close()
    return int(process.stdout.readline()), process.pid


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--old", type=Path)
    parser.add_argument("--rounds", type=int, default=7)
    parser.add_argument("--requests", type=int, default=40)
    options = parser.parse_args()
    folder = render_requests.corpus()
    if folder is None:
        raise SystemExit("SCENEGATE_CORPUS names no recorded requests")
    with ExitStack() as stack:
        servers: dict[str, tuple[int, int]] = {}
        for name, build in {"old": options.old, "new": None}.items():
            if name == "new" or build is not None:
                gateway = Gateway("--only", "render", build=build)
                stack.callback(gateway.stop)
                servers[name] = gateway.port, gateway.process.pid
        scenes = {text: render_requests.recorded(folder, number, "depth") for number, text in SCENES.items()}
        servers["floor"] = start_floor(stack, servers["new"][0], scenes["600 kB"].next_body(640, 480))
        time.sleep(20.0)  # kernels are loaded in the background
        print(heading("a request", *servers))
        for text, scene in scenes.items():
            seen: dict[str, dict[str, list[float]]] = {}
            for turn in range(1 + options.rounds):
                for name, (port, pid) in servers.items():
                    bodies = iter([scene.next_body(640, 480) for _ in range(3 * options.requests)])
                    one, four = (run_clients(port, pid, [*islice(bodies, options.requests)], n) for n in (1, 4))
                    least = min(post(port, body).total for body in bodies)
                    if turn:
                        figures = {"server's CPU, ms": one.server_ms, "event loop's CPU, ms": one.loop_ms}
                        figures |= {"four clients, requests/s": four.rate, "round trip, ms": least}
                        for what, value in figures.items():
                            seen.setdefault(what, {}).setdefault(name, []).append(value)
            for what, by_server in seen.items():
                best = max if "requests/s" in what else min
                cells = " | ".join(f"{best(values):.2f}" for values in by_server.values())
                print(f"| {text}: {what} | {cells} |", flush=True)


if __name__ == "__main__":
    main()
