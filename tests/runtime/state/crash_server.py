"""The tree viewer with a persistent state, for the crash test.

Every line on stdin forks a new server process, which saves the imports. It prints its process id and port.
"""

import asyncio
import os
import signal
import sys
from pathlib import Path

from gateway.adapters.treeviewer.config import TreeViewerConfig
from gateway.adapters.treeviewer.protocol import TreeViewerProtocol
from gateway.adapters.treeviewer.service import TreeViewerService
from gateway.runtime.lcm.config import LcmConfig
from gateway.runtime.state import database
from gateway.runtime.state.service import PersistentState
from gateway.runtime.state.tree_store import TreeStore
from gateway.scene.tree.live import LiveTree
from tests.adapters.treeviewer.conversation import message


async def serve(path: Path) -> None:
    live = LiveTree()
    database.CHECKPOINT_BYTES = 1 << 18  # type: ignore[misc]  # so that crashes also happen during checkpoints
    state = PersistentState(path)
    state.add(TreeStore(live))
    state.start()
    service = TreeViewerService(TreeViewerConfig(lcm=LcmConfig(url="off", tcpq_port=0)), live, store=state)
    running = asyncio.create_task(service.run())
    await service.wait_ready()
    print("server", os.getpid(), service.tcpq_port, flush=True)
    await running


def main(path: Path) -> None:
    signal.signal(signal.SIGCHLD, signal.SIG_IGN)  # no zombies
    TreeViewerProtocol(LiveTree()).handle(message({}))  # initialises what is created on first use
    for _ in sys.stdin:
        if os.fork() == 0:
            asyncio.run(serve(path))


if __name__ == "__main__":
    main(Path(sys.argv[1]))
