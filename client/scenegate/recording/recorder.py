"""Record received values to MCAP files."""

import queue
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import closing
from dataclasses import dataclass, field, replace
from functools import partial
from itertools import chain
from pathlib import Path
from typing import Final

from scenegate.camera import image_interface_pb2 as pb
from scenegate.camera.stream import StreamOptions
from scenegate.credentials import Credentials
from scenegate.gateway_http import GatewayError
from scenegate.recording.camera_values import CameraConverter
from scenegate.recording.mcap_file import McapFiles
from scenegate.recording.scene_mirror import SceneMirror
from scenegate.recording.sources import QUEUED_ITEMS, Received, camera_sets, scene_frames, start_receiving
from scenegate.recording.topics import Messages, Profile, ProfileName
from scenegate.recording.values import SceneChange
from scenegate.recording.view_frames import ViewFrame
from scenegate.regular_files import errors_name

FLUSH_SECONDS: Final = 1.0
"""Interval at which messages are written to the disk: a killed process loses this much."""
WHOLE_SCENE_SECONDS: Final = 10.0
"""Minimum time between two records of the whole scene. Readers that start in the middle of a file need one."""
WHOLE_SCENE_BYTES: Final = 1_000_000
"""Maximum bytes a second of records of the whole scene, beyond the first one."""
POLL_SECONDS: Final = 0.1
"""Maximum time until a stop is noticed."""


@dataclass(frozen=True, slots=True)
class RecordingOptions:
    """Sources and files of a recording."""

    path: Path
    """First MCAP file."""
    profile: ProfileName = "foxglove"
    scene: str | None = None
    """Address of the gateway whose live scene is recorded, ``http://HOST:PORT``; None: none."""
    camera: StreamOptions | None = None
    """Camera whose images are recorded; None: none."""
    credentials: Credentials = field(default_factory=Credentials)
    max_bytes: int = 0
    """Size of a file after which the next one begins; 0: no limit."""
    keep: int = 0
    """Number of files that are kept; 0: all."""


class SceneWriter:
    """Writes scene, images and samples to MCAP files. Each file, and readers that seek, get the whole scene."""

    def __init__(self, files: McapFiles, profile: Profile) -> None:
        self.files = files
        self._mirror = SceneMirror()
        self._profile = profile
        self._camera = CameraConverter()
        self._whole_scene_ns: int | None = None
        """Log time from which the whole scene is written again; None before the first update, which has it all."""

    @property
    def warnings(self) -> list[str]:
        """Sentences about what of the scene is left out."""
        return [*self._mirror.warnings.values(), *self._profile.clouds.warnings]

    def write(self, value: ViewFrame | pb.ImageSet, log_time_ns: int, *, is_first: bool = False) -> None:
        """Write a received frame of the view or image set, nanoseconds since the epoch.

        ``is_first``: it is the first of a connection. Raises ViewFrameError, BadImageError or OSError.
        """
        if is_first and isinstance(value, ViewFrame):
            self._mirror.reconnect()
        is_new_file = self.files.is_full
        if is_new_file:
            self.files.next_file()
        change = self._mirror.apply(value, log_time_ns) if isinstance(value, ViewFrame) else None
        if self._is_whole_due(change, log_time_ns, is_new_file):
            self._write_whole(log_time_ns, change)
        elif change is not None:
            size = self._write_all(self._profile.scene(change), log_time_ns, change.time_ns)
            is_update = isinstance(value, ViewFrame) and value.header["kind"] == "update"
            if self._whole_scene_ns is None and is_update:  # the first one has the whole scene
                self._plan_whole(log_time_ns, size)
        if isinstance(value, pb.ImageSet):
            for exposure in self._camera.convert(value):
                self._write_all(self._profile.camera(exposure), log_time_ns, exposure.time_ns)

    def _is_whole_due(self, change: SceneChange | None, log_time_ns: int, is_new_file: bool) -> bool:
        """Return True if the whole scene must be written in place of a change."""
        if self._whole_scene_ns is None:
            return False
        return is_new_file or (change is not None and log_time_ns >= self._whole_scene_ns)

    def _write_whole(self, log_time_ns: int, change: SceneChange | None) -> None:
        """Write the whole scene, with what the newest change has removed."""
        whole = self._mirror.whole()
        if change is not None:
            entities = {each.frame: each for each in (*whole.entities, *change.entities)}
            clouds = {each.frame: each for each in (*whole.clouds, *change.clouds)}
            whole = replace(whole, entities=list(entities.values()), clouds=list(clouds.values()))
        self._plan_whole(log_time_ns, self._write_all(self._profile.scene(whole), log_time_ns, whole.time_ns))

    def _plan_whole(self, log_time_ns: int, size: int) -> None:
        """Set the time of the next record of the whole scene, whose messages have so many bytes."""
        seconds = max(WHOLE_SCENE_SECONDS, size / WHOLE_SCENE_BYTES)
        self._whole_scene_ns = log_time_ns + int(seconds * 1e9)

    def _write_all(self, messages: Messages, log_time_ns: int, publish_time_ns: int) -> int:
        """Write messages; return their size in bytes."""
        size = 0
        for message in messages:
            self.files.write(message, log_time_ns, publish_time_ns)
            size += len(message.data)
        return size


def record(
    options: RecordingOptions,
    stop: threading.Event,
    report: Callable[[SceneWriter], None] = lambda writer: None,
) -> SceneWriter:
    """Record until ``stop`` is set. The file is opened when the first value arrives, and complete also after an error.

    ``report`` is called with the writer after each value, and at least every ``POLL_SECONDS``. Raises GatewayError or
    StreamFailure if a source cannot be reached at first, or nothing was received; ViewFrameError or BadImageError;
    ImportError without the profile's packages; OSError for a file.
    """
    profile = Profile(options.profile)
    received: queue.Queue[Received | Exception] = queue.Queue(QUEUED_ITEMS)
    if options.scene is not None:
        start_receiving("scene", partial(scene_frames, options.scene, options.credentials), received)
    if options.camera is not None:
        start_receiving("camera", partial(camera_sets, options.camera), received)
    values = _received(received, stop)
    first = next(filter(None, values), None)
    if first is None:
        raise GatewayError("nothing was received, and no file is written")
    # Opened now: a gateway that cannot be reached costs no earlier recording.
    limits = {"max_bytes": options.max_bytes, "keep": options.keep}
    with errors_name(options.path), closing(McapFiles(options.path, profile.mcap_profile, **limits)) as files:
        writer = SceneWriter(files, profile)
        flush_time = time.monotonic() + FLUSH_SECONDS
        for item in chain((first,), values):
            if item is not None:
                writer.write(item.value, item.time_ns, is_first=item.is_first)
            if time.monotonic() >= flush_time:
                files.flush()
                flush_time = time.monotonic() + FLUSH_SECONDS
            report(writer)
        return writer


def _received(received: queue.Queue[Received | Exception], stop: threading.Event) -> Iterator[Received | None]:
    """Yield what is received until ``stop`` is set, and None whenever ``POLL_SECONDS`` have passed without.

    Raises the exception of a source that cannot be reached.
    """
    while not stop.is_set():
        try:
            item = received.get(timeout=POLL_SECONDS)
        except queue.Empty:
            yield None
            continue
        if isinstance(item, Exception):
            raise item
        yield item
