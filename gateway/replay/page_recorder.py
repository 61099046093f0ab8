"""Recordings: the frames that a page needs to show a scene over time, without a gateway. ``page_file`` embeds them.

A recording is a gzip stream of records, each a view frame with a time:
``f64 time | u32 frame bytes | u32 0 | frame, padded with zeros to a multiple of 8 bytes``, little-endian. The time is
in seconds since the epoch. The frames are those of the WebSocket, in the order in which a page receives them:
``light``, ``page``, and for each change of the scene its new ``mesh`` frames and an ``update``. Two further kinds
replace what a page downloads: ``image`` (a PNG or JPEG of a texture) and ``channel`` (a channel of a point cloud). The
last frame, ``end``, has the time until which the scene stays as it is.

An update from revision 0 has the whole scene, as the first one does. Further ones follow the update that leads to the
same revision, so that a page can start there.
"""

import struct
import zlib
from collections.abc import Awaitable, Callable
from dataclasses import replace
from functools import partial
from typing import Any, Final

import numpy as np

from gateway.adapters.viewer.encoder import EMPTY_SNAPSHOT, Encoder, Update, encode_page
from gateway.adapters.viewer.frames import ALIGNMENT, FrameBuilder, encode
from gateway.adapters.viewer.light import encode_light
from gateway.adapters.viewer.messages import RecordedChannel, RecordedImage, RecordingEnd, ViewMessage
from gateway.adapters.viewer.resources import Resources, channel_values
from gateway.scene.page.live_page import LivePage
from gateway.scene.tree.live import Snapshot
from gateway.scene.tree.timeline import FileTooLargeError, Timeline, samples
from renderers.drawlist import ImageError
from renderers.images import browser_file
from renderers.light_rig import STUDIO, Rig

_RECORD: Final = struct.Struct("<dII")
MAX_BYTES: Final = 256 << 20
"""Maximum bytes of the frames of a recording. A page that shows it keeps all of them in memory."""
KEYFRAME_SHARE: Final = 0.5
"""Bytes of keyframes, which are updates with the whole scene, as a fraction of those of the updates between them. To
show another time, a page applies a keyframe and the updates after it."""
COMPRESSION_LEVEL: Final = 6
_GZIP: Final = 16 + zlib.MAX_WBITS


class PageRecorder:
    """Encodes snapshots as a recording. Not thread-safe."""

    def __init__(self, page: LivePage, max_bytes: int = MAX_BYTES, rig: Rig = STUDIO) -> None:
        """Record the view settings of a page, lit by a rig. Nothing is clickable: clicks would have no receiver."""
        recorded = LivePage()
        recorded.view = page.view
        self._page_frames = (encode_light(rig), encode_page(recorded))
        self._max_bytes = max_bytes
        self._resources = Resources()
        self._encoder = Encoder(self._resources)
        self._compressor = zlib.compressobj(COMPRESSION_LEVEL, wbits=_GZIP)
        self._pieces: list[bytes] = []
        self._nbytes = 0
        self._snapshot = EMPTY_SNAPSHOT
        """The last snapshot, with its number in this recording as its revision."""
        self._meshes: set[int] = set()
        """Ids of the meshes that the recording has."""
        self._image_count = 0
        """Number of textures that the recording has; they are numbered from 1."""
        self._keyframe_bytes = 0
        """Bytes of the last update with the whole scene."""
        self._bytes_since_keyframe = 0

    def add(self, time: int, snapshot: Snapshot) -> None:
        """Append the differences to the last snapshot. Raises FileTooLargeError beyond the recording's limit."""
        if self._snapshot is EMPTY_SNAPSHOT:
            for frame in self._page_frames:
                self.add_frame(time, frame)
        old, self._snapshot = self._snapshot, replace(snapshot, revision=self._snapshot.revision + 1)
        update = self._encoder.encode(old, self._snapshot)
        self._add_resources(time, update)
        self.add_frame(time, update.frame)
        if old is EMPTY_SNAPSHOT:
            self._keyframe_bytes = len(update.frame)
            return
        self._bytes_since_keyframe += len(update.frame)
        if KEYFRAME_SHARE * self._bytes_since_keyframe >= self._keyframe_bytes:
            keyframe = self._encoder.encode(EMPTY_SNAPSHOT, self._snapshot).frame
            self.add_frame(time, keyframe)
            self._keyframe_bytes, self._bytes_since_keyframe = len(keyframe), 0

    def add_frame(self, time: int, frame: bytes) -> None:
        """Append a frame, with its time in nanoseconds since the epoch."""
        self._nbytes += len(frame)
        if self._nbytes > self._max_bytes:
            raise FileTooLargeError(
                f"the recording has more than {self._max_bytes} bytes, which is the limit: record a shorter time, or "
                "at a lower rate"
            )
        padding = bytes(-len(frame) % ALIGNMENT)
        for data in (_RECORD.pack(time / 1e9, len(frame), 0), frame, padding):
            self._pieces.append(self._compressor.compress(data))

    def finish(self, end: int) -> bytes:
        """Return the recording, whose last snapshot is valid until ``end``, nanoseconds since the epoch."""
        self.add_frame(end, encode(RecordingEnd()))
        self._pieces.append(self._compressor.flush())
        return b"".join(self._pieces)

    def _add_resources(self, time: int, update: Update) -> None:
        """Append the meshes, textures and channels of clouds of an update that the recording does not have."""
        while (image := self._resources.image(self._image_count + 1)) is not None:
            self._image_count += 1
            try:
                data = browser_file(image)[0]
            except ImageError:  # the page draws such a texture white, as it does when a download fails
                continue
            self._add_data(time, data, partial(RecordedImage, id=self._image_count))
        for mesh_id in sorted(update.meshes - self._meshes):
            self._meshes.add(mesh_id)
            mesh = self._resources.mesh_frame(mesh_id)
            if mesh is not None:
                self.add_frame(time, mesh)
            cloud = self._resources.clouds.get(mesh_id)
            if cloud is None:
                continue
            for name in cloud.channels:
                values = channel_values(cloud, name)
                if values is not None:
                    self._add_data(time, values.tobytes(), partial(RecordedChannel, id=mesh_id, name=name))

    def _add_data(self, time: int, data: bytes, message: Callable[..., ViewMessage]) -> None:
        builder = FrameBuilder()
        span = builder.add_array(np.frombuffer(data, np.uint8))
        self.add_frame(time, builder.finish(message(data=span)))


async def record_section(
    recorder: PageRecorder,
    timeline: Timeline,
    start: int,
    end: int,
    rate: float,
    to_thread: Callable[..., Awaitable[Any]],
    on_progress: Callable[[float], None] = lambda done: None,
) -> bytes:
    """Return the recording of a section of a timeline, at ``rate`` samples a second; one state if it starts at its end.

    Times are nanoseconds since the epoch, ``to_thread`` is as ``asyncio.to_thread``, ``on_progress`` gets the fraction
    that is done. Raises FileTooLargeError if it would be too large, or has too many samples.
    """
    async for sample in samples(timeline, start, end, rate):
        await to_thread(recorder.add, sample.time, sample.snapshot)
        on_progress(sample.done)
    data: bytes = await to_thread(recorder.finish, end)
    return data
