"""The tree viewer with a state and nothing else, for the crash test.

Every line on stdin starts one more life of it in a process of its own, by fork, because the imports take longest; its
process id and port are printed.
"""

from __future__ import annotations

import asyncio
import os
import signal
import sys
from pathlib import Path

from gateway.lcm.config import LcmConfig
from gateway.scene.live import LiveTree
from gateway.state.config import StateConfig
from gateway.state.service import State
from gateway.treeviewer.config import TreeViewerConfig
from gateway.treeviewer.protocol import TreeViewerProtocol
from gateway.treeviewer.service import TreeViewerService
from tests.treeviewer.conversation import message


async def serve(path: Path) -> None:
    live = LiveTree()
    # Small, so that the crashes meet checkpoints, too.
    state = State(StateConfig(path, checkpoint_bytes=1 << 18, most_log_bytes=1 << 20))
    state.restore_tree(live)
    state.start()
    service = TreeViewerService(TreeViewerConfig(lcm=LcmConfig(url="off", tcpq_port=0)), live, durable=state.journal)
    running = asyncio.create_task(service.run())
    await service.wait_ready()
    print("life", os.getpid(), service.tcpq_port, flush=True)
    await running


def main(path: Path) -> None:
    signal.signal(signal.SIGCHLD, signal.SIG_IGN)  # nobody waits for the dead
    TreeViewerProtocol(LiveTree()).handle(message({}))  # whatever is made on first use
    for _ in sys.stdin:
        if os.fork() == 0:
            asyncio.run(serve(path))


if __name__ == "__main__":
    main(Path(sys.argv[1]))
