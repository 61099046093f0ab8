"""Publishes a little robot and a cloud into the live scene, moves it, and saves a picture of it.

    python examples/publish_tree.py [tcpq://127.0.0.1:7700] [http://127.0.0.1:8000] [PICTURE.png]

``udpm://239.255.76.67:7667?ttl=0`` (LCM's default network) works as well as TCPQ. The client speaks the protocol of
Director's remote tree viewer; ``scenegate-client`` is enough.
"""

import math
import sys
import urllib.parse
import urllib.request
from pathlib import Path

import numpy as np

from scenegate import Box, Cylinder, PointCloud, Transform, TreeViewer

network = sys.argv[1] if len(sys.argv) > 1 else "tcpq://127.0.0.1:7700"
url = sys.argv[2] if len(sys.argv) > 2 else "http://127.0.0.1:8000"
picture = sys.argv[3] if len(sys.argv) > 3 else "robot.png"

with TreeViewer(network) as viewer:
    robot = viewer["robot"]
    robot.delete()
    robot["base"].set(Cylinder(radius=0.3, length=0.2, color="#334d66"))
    robot["shoulder/arm"].set(Box((0.1, 0.1, 0.8), color="orange"), transform=(0, 0, 0.5))

    points = np.random.default_rng(1).normal(scale=0.2, size=(20_000, 3)).astype(np.float32)
    rgb = np.clip(128 + 300 * points, 0, 255).astype(np.uint8)
    with viewer.batch() as batch:  # everything of it becomes visible at once
        batch["cloud"].set(PointCloud(points, colors=rgb))
        batch["cloud"].transform((0.8, 0.8, 0.3))

    for step in range(50):
        angle = 0.5 * math.sin(step / 8)
        robot["shoulder"].transform(Transform(quaternion=(math.cos(angle / 2), math.sin(angle / 2), 0, 0)))

gateway = urllib.request.build_opener(urllib.request.ProxyHandler({}))  # no proxy, whatever http_proxy says
query = urllib.parse.urlencode({"camera": "eye=2,-2,1.2;target=0,0,0.4", "width": 640, "height": 480})
with gateway.open(f"{url}/scene/render?{query}") as found, Path(picture).open("wb") as file:
    file.write(found.read())
print(picture)
