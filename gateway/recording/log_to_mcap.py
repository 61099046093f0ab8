"""Write the scene of an LCM log to an MCAP file, as ``scenegate record --mcap`` writes it while the log is played."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path

from gateway.assets.mesh_files import MeshFiles
from gateway.lcmlog.replay import LogReplay
from gateway.recording.snapshot_frames import SnapshotFrames
from scenegate.recording.mcap_file import McapFiles
from scenegate.recording.profiles import ProfileName, make_profile
from scenegate.recording.recorder import SceneWriter


@dataclass(frozen=True, slots=True)
class Converted:
    """A log that was converted."""

    read: int
    """Number of messages that change the scene."""
    warnings: dict[str, int]
    """Reasons why messages or nodes are not recorded completely, with the number of times."""
    written: int
    """Number of messages in the file."""
    bytes: int
    """Size of the file."""


async def convert_log(
    log: Path, out: Path, profile: ProfileName, files: MeshFiles, report: Callable[[int, int], None] = lambda *_: None
) -> Converted:
    """Write the scene of a log to an MCAP file, with the times of the log.

    Args:
        log: LCM log with messages of tree viewer clients or of Drake.
        out: file to write, which is replaced.
        files: reads the mesh files that messages name.
        report: called after each message with the bytes of the log that were read, and the number of messages.

    Raises:
        EventLogError: the file is not an LCM log.
        ImportError: packages of the profile are not installed.
        OSError: a file cannot be read or written.
    """
    converter = make_profile(profile)
    frames = SnapshotFrames()
    warnings: dict[str, int] = {}
    read = 0
    with LogReplay(log, files) as replay, closing(McapFiles(out, converter.name)) as mcap:
        writer = SceneWriter(mcap, converter)
        while replay.next_event is not None:
            for warning in replay.step():
                warnings[warning] = warnings.get(warning, 0) + 1
            read += 1
            for frame in await frames.advance(replay.snapshot):
                writer.write(frame, replay.clock.time_ns)
            report(replay.position, read)
    warnings.update(dict.fromkeys(writer.mirror.warnings.values(), 1))
    return Converted(read, warnings, mcap.messages, mcap.bytes)
