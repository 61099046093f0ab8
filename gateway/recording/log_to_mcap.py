"""Write the live scene of an LCM log to MCAP files: what ``scenegate record --mcap`` writes while the log is played."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import closing
from pathlib import Path

from gateway.assets.mesh_files import MeshFiles
from gateway.drakeviewer.messages import MessageError
from gateway.drakeviewer.viewer import DrakeViewer
from gateway.scene.live import LiveTree
from gateway.treeviewer.protocol import TreeViewerProtocol
from gateway.viewer.encoder import EMPTY_SNAPSHOT, Encoder
from gateway.viewer.resources import Resources
from scenegate.lcm.event_log import Event, read_events
from scenegate.messages import wire
from scenegate.recording.mcap_file import McapFiles
from scenegate.recording.profiles import ProfileName, make_profile
from scenegate.recording.recorder import SceneWriter
from scenegate.regular_files import open_regular


class LogScene:
    """The live scene of a log, whose changes are frames of the view."""

    def __init__(self, files: MeshFiles) -> None:
        self.time = 0
        """Time of the newest message, nanoseconds since the epoch."""
        self._live = LiveTree(lambda: self.time)
        self._tree = TreeViewerProtocol(self._live, meshes=files)
        self._drake = DrakeViewer(self._live, files)
        self._resources = Resources()
        self._encoder = Encoder(self._resources)
        self._encoded = EMPTY_SNAPSHOT
        self._sent_meshes: set[int] = set()

    def show(self, event: Event) -> bool:
        """Execute a message; return False if it is of a channel that is not shown, or invalid."""
        self.time = event.time_us * 1000
        try:
            if event.channel.startswith(wire.REQUEST):
                self._tree.handle(event.data)
            elif self._drake.is_shown(event.channel):
                self._drake.handle(event.channel, event.data)
            else:
                return False
        except (wire.WireError, MessageError):  # as the server, which counts it
            return False
        return True

    async def frames(self) -> list[bytes]:
        """Return the frames with the changes since the last call; none if nothing has changed."""
        if self._live.snapshot.revision == self._encoded.revision:
            return []
        epoch = self._encoder.epoch
        self._encoder.advance(self._live.snapshot)
        base = self._encoded if self._encoder.epoch == epoch else EMPTY_SNAPSHOT
        update, self._encoded = await self._encoder.update(base)
        self._sent_meshes -= self._resources.take_removed_meshes()
        new = sorted(update.meshes - self._sent_meshes)
        self._sent_meshes.update(new)
        return [*(frame for mesh in new if (frame := self._resources.mesh_frame(mesh)) is not None), update.frame]


async def convert_log(
    log: Path, out: Path, profile: ProfileName, files: MeshFiles, report: Callable[[int, int], None] = lambda *_: None
) -> tuple[SceneWriter, int]:
    """Write the scene of a log to an MCAP file, with the times of the log.

    Args:
        log: LCM log with messages of tree viewer clients or of Drake.
        out: file to write, which is replaced.
        files: reads the mesh files that messages name.
        report: called after each message with the bytes of the log that were read, and the number of messages.

    Returns:
        The writer, and the number of messages that were shown.

    Raises:
        EventLogError: the file is not an LCM log.
        ImportError: packages of the profile are not installed.
        OSError: a file cannot be read or written.
    """
    converter = make_profile(profile)
    scene, shown = LogScene(files), 0
    with open_regular(log) as file, closing(McapFiles(out, converter.name)) as mcap:
        writer = SceneWriter(mcap, converter)
        for number, event in enumerate(read_events(file), 1):
            shown += scene.show(event)
            for frame in await scene.frames():
                writer.write(frame, scene.time)
            report(file.tell(), number)
    return writer, shown
