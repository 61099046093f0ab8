"""Drives a little rover around the table of the demo scene, over LCM, until it is stopped.

    python examples/animate_robot.py [udpm://239.255.76.67:7667?ttl=1] [SECONDS]

Geometry is sent once, poses 30 times a second. A viewer that starts later, or once more, answers that the paths are
missing, and gets the geometry again: any publisher can do the same.
"""

import json
import math
import struct
import sys
import time

import lcm

network = sys.argv[1] if len(sys.argv) > 1 else "tcpq://127.0.0.1:7700"
seconds = float(sys.argv[2]) if len(sys.argv) > 2 else math.inf
CLIENT, RATE = "rover", 30.0
MISSING_PATHS = 1


def box(size: list[float], at: list[float], color: list[float]) -> dict:
    return {"type": "box", "lengths": size, "color": color, "transform": {"translation": at}}


def wheel(x: float, y: float) -> dict:
    lies = {"translation": [x, y, 0.07], "quaternion": [math.sqrt(0.5), math.sqrt(0.5), 0, 0]}
    return {"type": "cylinder", "radius": 0.07, "length": 0.04, "color": [0.1, 0.1, 0.12, 1], "transform": lies}


BODY = [box([0.34, 0.22, 0.1], [0, 0, 0.13], [0.93, 0.62, 0.15, 1])]
BODY += [wheel(x, y) for x in (-0.12, 0.12) for y in (-0.13, 0.13)]
BODY += [box([0.03, 0.03, 0.5], [-0.08, 0, 0.42], [0.6, 0.63, 0.68, 1])]
HEAD = [box([0.07, 0.16, 0.07], [0, 0, 0], [0.15, 0.35, 0.7, 1])]
GEOMETRY = [{"path": ["rover"], "geometries": BODY}, {"path": ["rover", "head"], "geometries": HEAD}]


def poses(t: float) -> list[dict]:
    """Around the table in 20 s; the head looks about."""
    turn, look = 0.1 * math.pi * t, 0.8 * math.sin(1.3 * t)
    place = [1.25 * math.cos(turn), 1.25 * math.sin(turn), 0.0]
    return [
        {"path": ["rover"], "transform": {"translation": place, "quaternion": about_z(turn + 0.5 * math.pi)}},
        {"path": ["rover", "head"], "transform": {"translation": [-0.08, 0, 0.7], "quaternion": about_z(look)}},
    ]


def about_z(angle: float) -> list[float]:
    return [math.cos(angle / 2), 0.0, 0.0, math.sin(angle / 2)]


def send(**commands: list) -> None:
    data = json.dumps({"timestamp": 0, "delete": [], "setgeometry": [], "settransform": []} | commands).encode()
    name = b"treeviewer_json\0"  # viewer2_comms_t by hand; lcm-gen makes a class that does the same
    head = struct.pack(">Qqi16siii", 0xD368E03F33C568BE, 0, len(name), name, 1, 0, len(data))
    bus.publish(f"DIRECTOR_TREE_VIEWER_REQUEST_<{CLIENT}>", head + data)


statuses: list[int] = [MISSING_PATHS]
bus = lcm.LCM(network)
bus.subscribe(
    f"DIRECTOR_TREE_VIEWER_RESPONSE_<{CLIENT}>",
    lambda _, message: statuses.append(json.loads(message[message.index(b"{") :])["status"]),
)
start = time.monotonic()
while (t := time.monotonic() - start) < seconds:
    send(setgeometry=GEOMETRY if MISSING_PATHS in statuses else [], settransform=poses(t))
    statuses.clear()
    while bus.handle_timeout(max(1, round(1000 * (start + t + 1 / RATE - time.monotonic())))):
        pass
send(delete=[{"path": ["rover"]}])
