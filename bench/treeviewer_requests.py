"""Tree viewer requests, as clients send them, for ``bench.treeviewer`` and similar benches."""

import json
import math
import random
from collections.abc import Callable
from typing import Any

from scenegate.messages import wire

BOXES = 1000
VERTICES = POINTS = 100_000


def transforms(count: int) -> bytes:
    """Poses as a client's JSON writer prints them: 17 digits."""
    chance = random.Random(count)
    commands = [
        {
            "path": ["swarm", f"obj{i}"],
            "transform": {
                "translation": [chance.random() for _ in range(3)],
                "quaternion": [chance.random() for _ in range(4)],
            },
        }
        for i in range(count)
    ]
    return request(settransform=commands)


def boxes() -> bytes:
    look = {
        "color": [0.9, 0.7, 0.8, 1.0],
        "transform": {"translation": [0.0, 0.0, 0.0], "quaternion": [1.0, 0.0, 0.0, 0.0]},
    }
    commands = [
        {"path": ["swarm", f"obj{i}"], "geometries": [{"type": "box", "lengths": [0.1, 0.1, 0.1], **look}]}
        for i in range(BOXES)
    ]
    return request(setgeometry=commands)


def mesh() -> bytes:
    side = math.isqrt(VERTICES)
    vertices = [[x / side, y / side, 0.1 * math.sin(9.1 * x / side)] for y in range(side) for x in range(side)]
    faces = [
        corner
        for y in range(side - 1)
        for x in range(side - 1)
        for a in (y * side + x,)
        for corner in ([a, a + 1, a + side], [a + 1, a + side + 1, a + side])
    ]
    return request(
        setgeometry=[{"path": ["mesh"], "geometry": {"type": "mesh_data", "vertices": vertices, "faces": faces}}]
    )


def cloud() -> bytes:
    chance = random.Random(1)
    points, rgb = ([[chance.random() for _ in range(3)] for _ in range(POINTS)] for _ in range(2))
    geometry = {"type": "pointcloud", "points": points, "channels": {"rgb": rgb}}
    return request(setgeometry=[{"path": ["cloud"], "geometry": geometry}])


def request(**lists: Any) -> bytes:
    body = {"utime": 1700000000000000, "delete": [], "setgeometry": [], "settransform": [], **lists}
    return wire.encode(json.dumps(body).encode(), body["utime"])


JOBS: dict[str, Callable[[], bytes]] = {
    "create 1000 boxes": boxes,
    "1 transform": lambda: transforms(1),
    "100 transforms": lambda: transforms(100),
    "1000 transforms": lambda: transforms(1000),
    "mesh 100k": mesh,
    "cloud 100k": cloud,
}
