"""Publishes a little robot over LCM by hand, without any of the gateway's code, moves it, and saves a picture of it.

python tests/compose/publisher.py NETWORK URL PICTURE.png
"""

import json
import math
import struct
import sys
import urllib.parse
import urllib.request
from pathlib import Path
from typing import Any

import lcm

network, url, picture = sys.argv[1:]
CLIENT = "by hand"


def viewer2_comms(data: bytes) -> bytes:
    """The LCM type by hand; ``lcm-gen --python lcmtypes/viewer2_comms_t.lcm`` makes a class that does the same."""
    name = b"treeviewer_json\0"
    return struct.pack(">Qqi16siii", 0xD368E03F33C568BE, 0, len(name), name, 1, 0, len(data)) + data


answers: list[bytes] = []
bus = lcm.LCM(network)
bus.subscribe(f"DIRECTOR_TREE_VIEWER_RESPONSE_<{CLIENT}>", lambda _, message: answers.append(message))


def request(**commands: list[Any]) -> dict[str, Any]:
    """Send a request and return the response."""
    data = json.dumps({"timestamp": 0, "delete": [], "setgeometry": [], "settransform": []} | commands).encode()
    bus.publish(f"DIRECTOR_TREE_VIEWER_REQUEST_<{CLIENT}>", viewer2_comms(data))
    while not answers:
        bus.handle()  # as long as it takes
    message = answers.pop()
    response: dict[str, Any] = json.loads(message[message.index(b'{"') :])
    return response


base = {"type": "cylinder", "radius": 0.3, "length": 0.2, "color": [0.2, 0.3, 0.4, 1]}
arm = {"type": "box", "lengths": [0.1, 0.1, 0.8], "color": [1, 0.6, 0.1, 1]}
print(
    request(
        delete=[{"path": ["robot"]}],
        setgeometry=[
            {"path": ["robot", "base"], "geometry": base},
            {"path": ["robot", "shoulder", "arm"], "geometry": arm},
        ],
        settransform=[{"path": ["robot", "shoulder", "arm"], "transform": {"translation": [0, 0, 0.5]}}],
    )
)
for step in range(50):
    angle = 0.5 * math.sin(step / 8)
    turn = [math.cos(angle / 2), math.sin(angle / 2), 0, 0]
    answer = request(settransform=[{"path": ["robot", "shoulder"], "transform": {"quaternion": turn}}])
    assert answer["status"] == 0, answer

query = urllib.parse.urlencode({"camera": "eye=2,-2,1.2;target=0,0,0.4", "width": 640, "height": 480})
with urllib.request.urlopen(f"{url}/scene/render?{query}") as found, Path(picture).open("wb") as file:
    file.write(found.read())
print(picture)
