"""Write the scene of an LCM log to an MCAP file, as ``scenegate record --mcap`` writes it while the log is played."""

from collections.abc import Callable, Sequence
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path

from gateway.adapters.viewer.encoder import SnapshotFrames
from gateway.replay.log_replay import is_shown
from gateway.replay.log_timeline import LogTimeline
from scenegate.recording.mcap_file import McapFiles
from scenegate.recording.recorder import SceneWriter
from scenegate.recording.topics import Profile, ProfileName
from scenegate.recording.view_frames import ViewFrame
from scenegate.regular_files import errors_name


@dataclass(frozen=True, slots=True)
class Converted:
    """A log that was converted."""

    read: int
    """Number of messages of channels that change the scene."""
    written: int
    """Number of messages in the file."""
    bytes: int
    """Size of the file."""
    warnings: Sequence[str]
    """Sentences about messages and nodes that are not recorded completely."""


async def convert_log(
    timeline: LogTimeline, out: Path, profile: ProfileName, report: Callable[[int, int], None] = lambda *_: None
) -> Converted:
    """Write the scene of an opened log to an MCAP file, which is replaced, with the times of the log.

    ``report`` is called after each message with the bytes of the log that were read, and the number of messages. Raises
    ImportError without the profile's packages, or OSError.
    """
    converter = Profile(profile)
    frames = SnapshotFrames()
    read = 0
    with timeline.replay() as replay, errors_name(out), closing(McapFiles(out, converter.mcap_profile)) as mcap:
        writer = SceneWriter(mcap, converter)
        while (event := replay.next_event) is not None:
            replay.step()
            read += is_shown(event.channel)
            for frame in await frames.advance(replay.snapshot):
                writer.write(ViewFrame(frame), replay.clock.time_ns)
            report(replay.position, read)
    return Converted(read, mcap.messages, mcap.bytes, [*replay.incomplete.listed(), *writer.warnings])
