"""Image sets a second of ``serve --demo`` to each of N clients that parse them: ``python -m bench.stream``.

A set has left, right, disparity, error and confidence images of the moving demo scene at 1280x960. Clients are
processes of their own with grpcio and protobuf, as a user's are. A row names mode, realism, quality and clients.
"""

import argparse
import json
import subprocess
import sys
import time
import urllib.request
from itertools import product
from typing import Any

from bench.gateways import gateway
from bench.table import Row, show
from bench.viewer import cpu_of

FIELDS = ("left", "right", "disparity", "disparity_error", "confidence")
SECONDS_TO_SETTLE = 2.0
MIN_SETS = 3
"""Minimum number of sets whose rate is measured."""


def client(port: int, seconds: float) -> None:
    """Receive and parse sets; print their number per second."""
    import grpc

    from scenegate.camera import image_interface_pb2 as pb

    channel = grpc.insecure_channel(f"127.0.0.1:{port}", [("grpc.max_receive_message_length", -1)])
    call = channel.unary_stream(
        "/ImageInterface/StreamImageSets", pb.ImageSetRequest.SerializeToString, pb.ImageSet.FromString
    )
    wanted: dict[str, Any] = {f"{name}_enabled": True for name in FIELDS}
    sets = call(pb.ImageSetRequest(**wanted))
    settled = time.monotonic() + SECONDS_TO_SETTLE
    times = []
    for each in sets:
        assert all(each.HasField(name) for name in FIELDS)
        if (now := time.monotonic()) >= settled:
            times.append(now)
            if now > settled + seconds and len(times) > MIN_SETS:
                break
    print((len(times) - 1) / (times[-1] - times[0]), flush=True)


def _set_quality(http_port: int, quality: str) -> None:
    url = f"http://127.0.0.1:{http_port}/api/v2/pipelines/0/nodes/rc_stereomatching/parameters/quality"
    body = json.dumps({"value": quality}).encode()
    request = urllib.request.Request(url, body, {"Content-Type": "application/json"}, method="PUT")
    with urllib.request.urlopen(request, timeout=10) as response:
        response.read()


def measure(mode: str, realism: str, quality: str, clients: int, seconds: float) -> Row:
    """Return the row of one combination."""
    flags = ("--grpc-port", "0", "--stereo-rate", "max", "--depth-mode", mode, "--stereo-realism", realism)
    with gateway("--demo", *flags) as running:
        _set_quality(running.port, quality)
        port = running.interface("stereo")["port"]
        command = [sys.executable, "-m", "bench.stream", "--client", str(port), "--seconds", str(seconds)]
        cpu, began = cpu_of(running.process.pid), time.monotonic()
        children = [subprocess.Popen(command, stdout=subprocess.PIPE, text=True) for _ in range(clients)]
        rates = sorted(float(child.communicate()[0]) for child in children)
        load = (cpu_of(running.process.pid) - cpu) / (time.monotonic() - began)
    what = f"demo at {quality}, `{mode}`, realism {realism}, {clients} client{'s' * (clients > 1)}: sets a second each"
    return Row(what, f"{rates[0]:.1f} – {rates[-1]:.1f}", "", "", f"server {load:.2f} cores")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seconds", type=float, default=5.0)
    parser.add_argument("--modes", nargs="+", default=["ground_truth", "matched"])
    parser.add_argument("--realism", nargs="+", default=["off", "all"])
    parser.add_argument("--qualities", nargs="+", default=["Low", "Medium", "High", "Full"])
    parser.add_argument("--clients", type=int, nargs="+", default=[1, 4])
    parser.add_argument("--client", type=int, metavar="PORT", help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.client:
        client(options.client, options.seconds)
        return
    combinations = product(options.modes, options.realism, options.qualities, options.clients)
    show(measure(*each, options.seconds) for each in combinations)


if __name__ == "__main__":
    main()
