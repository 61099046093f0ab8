"""Sends the live scene and the stereo camera's images to Foxglove's clients: only what they subscribe to is made."""

from __future__ import annotations

import asyncio
from collections import deque
from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any, Final

import structlog

from gateway.foxglove.channels import Channels
from gateway.recording.snapshot_frames import SnapshotFrames
from gateway.scene.live import LiveTree, Snapshot
from gateway.stereo.service import StereoService
from gateway.stereo.stream.set_kind import SetKind
from gateway.stereo.stream.subscriptions import LimitError, StreamError
from gateway.viewer.sources import StereoRig
from scenegate.camera import image_interface_pb2 as pb
from scenegate.recording.camera_values import CameraConverter
from scenegate.recording.profiles import (
    CLOUD_TOPIC,
    DISPARITY_TOPIC,
    IMAGE_TOPICS,
    SCENE_CLOUDS_TOPIC,
    SCENE_TOPIC,
    TF_TOPIC,
    FoxgloveProfile,
)
from scenegate.recording.scene_mirror import SceneMirror
from scenegate.recording.values import CameraSet, SceneChange
from scenegate.recording.view_frames import ViewFrame

HOST: Final = "127.0.0.1"
"""The protocol has no tokens."""
MAX_UPDATE_RATE: Final = 30.0
"""Maximum number of updates of the scene a second."""
WHOLE_SCENE_SECONDS: Final = 30.0
"""Interval at which the whole scene is sent again: a slow client has missed changes."""

_log = structlog.get_logger("foxglove")


class FoxgloveService:
    """Serves Foxglove's protocol on a port of this machine."""

    def __init__(
        self,
        port: int,
        tree: LiveTree,
        camera: StereoService | None,
        rig: Callable[[Snapshot], StereoRig | None] = lambda snapshot: None,
    ) -> None:
        """
        Args:
            port: 0 for a free one.
            tree: the live tree.
            camera: stereo camera; None: there is none.
            rig: returns pose and intrinsics of the camera in a snapshot.
        """
        self.port = port
        """The actual port while the service is ready."""
        self.ready = False
        self._tree = tree
        self._camera = camera
        self._rig = rig
        self._profile = FoxgloveProfile()
        self._channels = Channels(self._on_subscription, self._parameters)
        self._loop: asyncio.AbstractEventLoop | None = None
        self._scene_changed = asyncio.Event()
        """Set when the tree has changed, or somebody subscribes to the scene or no longer does."""
        self._camera_changed = asyncio.Event()
        """Set when somebody subscribes to images or no longer does."""
        self._new_subscribers: deque[tuple[int, str]] = deque()
        """Clients and topics of the scene that need the whole scene. Threads of the server append them."""

    def status(self) -> Mapping[str, Any]:
        """Return plain values for the health endpoint."""
        return {"port": self.port, "clients": self._channels.clients, "topics": sorted(self._channels.topics)}

    async def run(self) -> None:
        """Serve until cancelled.

        Raises:
            OSError: the port is taken.
        """
        self._loop = asyncio.get_running_loop()
        for topic, schema in self._profile.schemas().items():
            if self._camera is not None or topic in (TF_TOPIC, SCENE_TOPIC):
                self._channels.declare(topic, schema)
        self.port = self._channels.start(HOST, self.port)
        _log.info(f"Foxglove's WebSocket on ws://{HOST}:{self.port}")
        loop = self._loop
        stop_listening = self._tree.listen(lambda _: _notify(loop, self._scene_changed))
        self.ready = True
        try:
            async with asyncio.TaskGroup() as tasks:
                tasks.create_task(self._send_scene())
                if self._camera is not None:
                    tasks.create_task(self._send_images(self._camera))
        finally:
            self.ready = False
            stop_listening()
            await asyncio.to_thread(self._channels.stop)

    def _on_subscription(self, client: int | None, topic: str) -> None:
        """Wake up what sends a topic. Called in threads of the server."""
        assert self._loop is not None
        if topic not in (TF_TOPIC, SCENE_TOPIC) and not topic.startswith(SCENE_CLOUDS_TOPIC):
            _notify(self._loop, self._camera_changed)
            return
        if client is not None:
            self._new_subscribers.append((client, topic))
        _notify(self._loop, self._scene_changed)

    def _parameters(self) -> dict[str, Any]:
        """Return the camera's parameters, ``node.name``."""
        if self._camera is None:
            return {}
        nodes = ("rc_camera", "rc_stereomatching", "rc_iocontrol")
        values = self._camera.parameters.values
        return {f"{node}.{name}": value for node in nodes for name, value in dict(values(node)).items()}

    async def _send_scene(self) -> None:
        """Send changes of the scene while there are subscribers."""
        loop = asyncio.get_running_loop()
        feed: _SceneFeed | None = None
        while True:
            await self._scene_changed.wait()
            self._scene_changed.clear()
            begin = loop.time()
            if not any(_is_of_scene(topic) for topic in self._channels.topics):
                feed = None
                continue
            feed = feed or _SceneFeed(self._channels, self._profile, SnapshotFrames(self._rig))
            subscribers = [self._new_subscribers.popleft() for _ in range(len(self._new_subscribers))]
            await feed.send(self._tree.snapshot, subscribers)
            await asyncio.sleep(max(0.0, begin + 1.0 / MAX_UPDATE_RATE - loop.time()))

    async def _send_images(self, camera: StereoService) -> None:
        """Send images while there are subscribers. The camera makes none otherwise."""
        while True:
            await self._camera_changed.wait()
            self._camera_changed.clear()
            topics = frozenset(topic for topic in self._channels.topics if not _is_of_scene(topic))
            if not topics:
                continue
            sending = asyncio.create_task(self._stream(camera, topics))
            changed = asyncio.create_task(self._camera_changed.wait())
            try:
                await asyncio.wait((sending, changed), return_when=asyncio.FIRST_COMPLETED)
            finally:
                for task in (sending, changed):
                    task.cancel()
                results = await asyncio.gather(sending, changed, return_exceptions=True)
            for result in results:
                if isinstance(result, Exception):
                    raise result

    async def _stream(self, camera: StereoService, topics: frozenset[str]) -> None:
        """Send the images of some topics until cancelled, or until the camera ends."""
        wants_depth = not topics.isdisjoint((*IMAGE_TOPICS["depth"], DISPARITY_TOPIC, CLOUD_TOPIC))
        kind = SetKind(
            left=CLOUD_TOPIC in topics or not topics.isdisjoint(IMAGE_TOPICS["left"]),
            right=not topics.isdisjoint(IMAGE_TOPICS["right"]),
            disparity=wants_depth,
            color=camera.config.color,
        )
        converter = CameraConverter(camera.config.model.baseline, cloud=CLOUD_TOPIC in topics)
        try:
            with camera.hub.subscribe(kind) as subscription:
                while True:
                    data = await subscription.get()
                    await asyncio.to_thread(self._send_set, converter, data, topics)
        except (LimitError, StreamError) as error:
            _log.warning(f"Foxglove gets no images: {error}")

    def _send_set(self, converter: CameraConverter, data: bytes, topics: frozenset[str]) -> None:
        """Send what is subscribed of an image set."""
        for images in converter.convert(pb.ImageSet.FromString(data)):
            for message in self._profile.camera(_subscribed(images, topics)):
                if message.topic in topics:
                    self._channels.send(message, images.time)


class _SceneFeed:
    """The scene as clients have it."""

    def __init__(self, channels: Channels, profile: FoxgloveProfile, frames: SnapshotFrames) -> None:
        self._channels = channels
        self._profile = profile
        self._frames = frames
        self._mirror = SceneMirror()
        self._whole_time: float | None = None
        """Time from which the whole scene is sent again, on the loop's clock; None before the first time."""

    async def send(self, snapshot: Snapshot, subscribers: list[tuple[int, str]]) -> None:
        """Send what has changed to all clients, and the whole scene to new subscribers of a topic."""
        frames = await self._frames.advance(snapshot)
        now = asyncio.get_running_loop().time()
        repeat = self._whole_time is not None and now >= self._whole_time
        if repeat or self._whole_time is None:
            self._whole_time = now + WHOLE_SCENE_SECONDS
        await asyncio.to_thread(self._send, frames, subscribers, repeat, snapshot.timestamp)

    def _send(self, frames: list[bytes], subscribers: list[tuple[int, str]], repeat: bool, time: int) -> None:
        for frame in frames:
            change = self._mirror.apply(ViewFrame(frame))
            if change is not None:
                self._send_change(change, self._channels.topics)
        if not (repeat or subscribers):
            return
        whole = self._mirror.whole(time)
        if repeat:
            self._send_change(whole, self._channels.topics)
        for client, topic in subscribers:
            self._send_change(whole, frozenset((topic,)), client)

    def _send_change(self, change: SceneChange, topics: frozenset[str], client: int | None = None) -> None:
        """Send the messages of some topics."""
        for cloud in change.clouds:
            self._channels.declare(self._profile.cloud_topic(cloud), self._profile.cloud_schema())
        wanted = replace(
            change,
            transforms=change.transforms if TF_TOPIC in topics else (),
            entities=change.entities if SCENE_TOPIC in topics else (),
            clouds=[cloud for cloud in change.clouds if self._profile.cloud_topic(cloud) in topics],
        )
        for message in self._profile.scene(wanted):
            self._channels.send(message, change.time, client)


def _is_of_scene(topic: str) -> bool:
    return topic in (TF_TOPIC, SCENE_TOPIC) or topic.startswith(SCENE_CLOUDS_TOPIC)


def _subscribed(images: CameraSet, topics: frozenset[str]) -> CameraSet:
    """Return a set without what is not subscribed."""
    return replace(
        images,
        images={name: image for name, image in images.images.items() if not topics.isdisjoint(IMAGE_TOPICS[name])},
        disparity=images.disparity if DISPARITY_TOPIC in topics else None,
        cloud=images.cloud if CLOUD_TOPIC in topics else None,
    )


def _notify(loop: asyncio.AbstractEventLoop, event: asyncio.Event) -> None:
    """Set an event from any thread."""
    try:
        loop.call_soon_threadsafe(event.set)
    except RuntimeError:
        pass  # the loop is closed
