"""The steps of Director's viewerclient.py that can lose commands: publish, then clear the queue of commands.

    python -m tests.adapters.treeviewer.director_client URL ROUNDS [PAUSE]

When the viewer misses paths, the client's handler thread queues their commands for the next ``publish()``. If it does
so while ``publish()`` has sent a message but not yet emptied the queue, nothing is sent again. Each round transforms a
path that the viewer does not have, once. PAUSE seconds pass before the queue is emptied, as on a busy machine.

Prints one line of JSON: for each round, whether the commands were lost, and the seconds from before the message was
sent until the queue was empty.
"""

import json
import sys
import threading
import time
from typing import Any

import lcm

from scenegate.messages import wire
from tests.support.waiting import SECONDS

CLIENT = "<director>"


class DirectorClient:
    """``CoreVisualizer`` of viewerclient.py, reduced to transforms."""

    def __init__(self, url: str, pause: float) -> None:
        self.lcm = lcm.LCM(url)
        self.pause = pause
        self.queue: set[str] = set()
        self.answered = threading.Event()
        self.lcm.subscribe(f"DIRECTOR_TREE_VIEWER_RESPONSE_{CLIENT}", self._handle_response)
        threading.Thread(target=self._handler_loop, daemon=True).start()

    def _handler_loop(self) -> None:
        while True:
            self.lcm.handle()

    def _handle_response(self, channel: str, data: bytes) -> None:
        answer: dict[str, Any] = json.loads(wire.decode(data).data.tobytes())
        if answer["status"] == 1:
            for path in answer["missing_paths"]:
                self.queue.add(path[0])
        self.answered.set()

    def settransform(self, path: str) -> None:
        self.queue.add(path)
        request = {"utime": 0, "delete": [], "setgeometry": [], "settransform": [{"path": [path], "transform": {}}]}
        self.lcm.publish(f"DIRECTOR_TREE_VIEWER_REQUEST_{CLIENT}", wire.encode(json.dumps(request).encode()))
        if self.pause:
            time.sleep(self.pause)  # short: the race that is tested
        self.queue = set()


def main(url: str, rounds: int, pause: float = 0.0) -> None:
    client = DirectorClient(url, pause)
    results = []
    for number in range(rounds):
        client.answered.clear()
        begin = time.monotonic()
        client.settransform(f"path {number}")
        seconds = time.monotonic() - begin
        if not client.answered.wait(SECONDS):
            raise TimeoutError(f"no answer to request {number}")
        results.append((not client.queue, seconds))
        client.queue = set()
    print(json.dumps(results))


if __name__ == "__main__":
    main(sys.argv[1], int(sys.argv[2]), *map(float, sys.argv[3:]))
