"""Record received values to MCAP files."""

from __future__ import annotations

import math
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
from scenegate.recording.sources import (
    QUEUED_ITEMS,
    WAIT_SECONDS,
    Received,
    SourceName,
    camera_sets,
    scene_frames,
    start_receiving,
)
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
REASON_SECONDS: Final = 0.5
"""Maximum time in which a source that has sent nothing may say why."""
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
    """Camera whose left and right images are recorded, without a choice of images; None: none."""
    depth: bool = True
    """Record the camera's disparity, depth and points, too, at the rate of depth."""
    credentials: Credentials = field(default_factory=Credentials)
    max_bytes: int = 0
    """Size of a file after which the next one begins; 0: no limit."""
    keep: int = 0
    """Number of files that are kept; 0: all."""
    seconds: float = 0.0
    """Duration, once each source has sent something and that is written; 0: no limit."""


class SceneWriter:
    """Writes scene, images and samples to MCAP files. Each file, and readers that seek, get the whole scene."""

    def __init__(self, files: McapFiles, profile: Profile) -> None:
        self.files = files
        self._mirror = SceneMirror()
        self._profile = profile
        self.camera = CameraConverter()
        self._whole_scene_ns: int | None = None
        """Log time from which the whole scene is written again; None before the first update, which has it all."""

    @property
    def warnings(self) -> list[str]:
        """Sentences about what of the scene is left out."""
        return [*self._mirror.warnings.values(), *self._profile.clouds.warnings]

    def write(
        self, value: ViewFrame | pb.ImageSet, log_time_ns: int, *, is_first: bool = False, depth_only: bool = False
    ) -> None:
        """Write a received value with its log time, nanoseconds since the epoch. ``is_first``: of a connection.

        ``depth_only``: left and right image of the set are not written. Raises ViewFrameError or BadImageError if the
        value is invalid, OSError if a file cannot be written.
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
            for exposure in self.camera.convert(value, depth_only=depth_only):
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
    options: RecordingOptions, stop: threading.Event, report: Callable[[SceneWriter], None] = lambda writer: None
) -> SceneWriter:
    """Record until ``stop`` is set or the time is over.

    The file is opened when all sources have sent something, and complete also after an error. ``report`` is called with
    the writer after each value, and then at least every ``POLL_SECONDS``. Raises GatewayError or StreamFailure if a
    source cannot be reached at first, or has sent nothing; ViewFrameError or BadImageError if it has sent something
    invalid; ImportError without the packages of the profile; OSError.
    """
    profile = Profile(options.profile)
    received: queue.Queue[Received | Exception] = queue.Queue(QUEUED_ITEMS)
    silent = set(_start_sources(options, received))
    values = _received(received, stop)
    begun = _wait_for_sources(values, silent, time.monotonic() + WAIT_SECONDS + REASON_SECONDS)
    if silent:
        raise GatewayError(f"nothing was received from {_names(silent, options)}, and no file is written")
    # Opened now: a gateway that cannot be reached costs no earlier recording.
    limits = {"max_bytes": options.max_bytes, "keep": options.keep}
    with errors_name(options.path), closing(McapFiles(options.path, profile.mcap_profile, **limits)) as files:
        writer = SceneWriter(files, profile)
        flush_time, end = time.monotonic() + FLUSH_SECONDS, math.inf
        for number, item in enumerate(chain(begun, values)):
            now = time.monotonic()
            if number == len(begun):  # to write the whole scene takes seconds if it is large
                end = now + (options.seconds or math.inf)
            if item is not None:
                is_depth = item.source == "depth"
                if is_depth and isinstance(item.value, pb.ImageSet) and not options.depth:
                    writer.camera.convert(item.value)  # it remembers the baseline
                else:
                    writer.write(item.value, item.time_ns, is_first=item.is_first, depth_only=is_depth)
            if now >= flush_time:
                files.flush()
                flush_time = now + FLUSH_SECONDS
            report(writer)
            if now >= end:
                break
        return writer


def _wait_for_sources(values: Iterator[Received | None], silent: set[SourceName], deadline: float) -> list[Received]:
    """Return what to write when all sources have sent something: the scene's messages, and the first one of depth.

    ``silent`` are the sources that have sent nothing yet, changed. The wait ends at ``deadline`` of the monotonic
    clock.
    """
    begun: list[Received] = []
    for item in values:
        if item is not None:
            if item.source == "scene" or (item.source == "depth" and "depth" in silent):
                begun.append(item)
            silent.discard(item.source)
        if not silent or time.monotonic() >= deadline:
            break
    return begun


def _start_sources(options: RecordingOptions, received: queue.Queue[Received | Exception]) -> Iterator[SourceName]:
    """Start the threads that receive, and yield the names of their sources."""
    if options.scene is not None:
        start_receiving("scene", partial(scene_frames, options.scene, options.credentials), received)
        yield "scene"
    if options.camera is not None:
        pair = replace(options.camera, left=True, right=True, disparity=False)
        # Only sets with disparity have the baseline, which the right image needs: without depth, one is enough.
        depth = replace(
            options.camera, left=options.depth, right=False, disparity=True, count=0 if options.depth else 1
        )
        start_receiving("images", partial(camera_sets, pair), received)
        start_receiving("depth", partial(camera_sets, depth), received)
        yield from ("images", "depth")


def _names(sources: set[SourceName], options: RecordingOptions) -> str:
    """Return the names of sources for an error message, with their addresses."""
    address = options.camera.target if options.camera is not None else ""
    depth = "depth" if options.depth else "disparity, for the baseline"
    names = {"scene": f"{options.scene} (scene)", "images": f"{address} (images)", "depth": f"{address} ({depth})"}
    return ", ".join(names[source] for source in sorted(sources))


def _received(received: queue.Queue[Received | Exception], stop: threading.Event) -> Iterator[Received | None]:
    """Yield what is received until ``stop`` is set, None every ``POLL_SECONDS``. Raises errors of sources."""
    while not stop.is_set():
        try:
            item = received.get(timeout=POLL_SECONDS)
        except queue.Empty:
            yield None
            continue
        if isinstance(item, Exception):
            raise item
        yield item
