"""Sends the live scene and the stereo camera's images to Foxglove's clients: only what they subscribe to is made."""

import asyncio
from collections.abc import Callable, Coroutine, Iterable, Mapping
from contextlib import AbstractContextManager, suppress
from typing import Any, Final, NamedTuple, Protocol

import structlog

from gateway.adapters.foxglove.channels import Channels
from gateway.adapters.foxglove.front import Front, inner_host
from gateway.scene.tree.live import LiveTree, Snapshot
from scenegate.camera import image_interface_pb2 as pb
from scenegate.recording.camera_values import CameraConverter
from scenegate.recording.foxglove_messages import deletion_of_all, encode, schemas
from scenegate.recording.scene_mirror import SceneMirror
from scenegate.recording.topics import (
    CLOUD_TOPIC,
    DISPARITY_TOPIC,
    IMAGE_TOPICS,
    SCENE_CLOUDS_TOPIC,
    SCENE_TOPIC,
    TF_TOPIC,
    Profile,
)
from scenegate.recording.view_frames import ViewFrame


class SceneFrames(Protocol):
    """Changes of the scene as frames of the browser view."""

    async def advance(self, snapshot: Snapshot) -> list[bytes]:
        """Return the frames that lead from the last snapshot to this one."""


NewSceneFrames = Callable[[], SceneFrames]
"""Returns frames whose last snapshot is the empty scene."""


class ImageSets(Protocol):
    """A subscription to image sets."""

    async def get(self) -> bytes:
        """Wait for the next set of the gRPC interface; return it encoded. Raises RuntimeError, with the reason, at the
        end.
        """


class CameraSource(Protocol):
    """The stereo camera."""

    @property
    def baseline(self) -> float:
        """Distance between the cameras, in metres."""

    def parameters(self) -> Mapping[str, Any]:
        """Return the camera's parameters, ``node.name``."""

    def subscribe(self, left: bool, right: bool, disparity: bool) -> AbstractContextManager[ImageSets]:
        """Return a subscription for the duration of the block. Raises RuntimeError, with the reason, without sets."""


HOST: Final = "127.0.0.1"
"""The protocol has no tokens."""
MAX_UPDATE_RATE: Final = 30.0
"""Maximum number of updates of the scene a second."""
WHOLE_SCENE_SECONDS: Final = 30.0
"""Interval at which the whole scene is sent again: a slow client has missed changes."""

_log = structlog.get_logger("foxglove")


class _WantedImages(NamedTuple):
    """Images that subscribers need."""

    left: bool
    right: bool
    disparity: bool
    points: bool
    """True for a point cloud of left image and disparity."""


class FoxgloveService:
    """Serves Foxglove's protocol on a port of this machine."""

    def __init__(
        self,
        port: int,
        tree: LiveTree,
        scene_frames: NewSceneFrames,
        camera: CameraSource | None,
        front: Front | None = None,
    ) -> None:
        """Create a service; ``run`` starts it. Port 0: a free one. ``front``: lets clients in; None: the app alone."""
        self.port = port
        """The actual port while the service is ready."""
        self.ready = False
        self._tree = tree
        self._scene_frames = scene_frames
        self._camera = camera
        self._profile = Profile("foxglove", _log.warning)
        self.front = front or Front((), ())
        self._channels = Channels(self._on_subscription, camera.parameters if camera else dict)
        self._loop: asyncio.AbstractEventLoop | None = None
        self._scene_changed = asyncio.Event()
        """Set when the tree has changed, or a subscription to the scene begins or ends."""
        self._camera_changed = asyncio.Event()
        """Set when a subscription to images begins or ends."""

    def status(self) -> Mapping[str, Any]:
        """Return plain values for the health endpoint."""
        return {"port": self.port, "clients": self._channels.clients, "topics": sorted(self._channels.topics)}

    async def run(self) -> None:
        """Serve until cancelled. Raises OSError if the port is taken."""
        self._loop = asyncio.get_running_loop()
        for topic, schema in schemas().items():
            if self._camera is not None or topic in (TF_TOPIC, SCENE_TOPIC):
                self._channels.advertise(topic, schema)
        host = inner_host()
        inner_port = self._channels.start(host, 0)
        loop = self._loop
        stop_listening = self._tree.listen(lambda: _notify(loop, self._scene_changed))
        try:
            server = await self.front.start(HOST, self.port, (host, inner_port))
            self.port = server.sockets[0].getsockname()[1]
            _log.info(f"Foxglove's WebSocket on ws://{HOST}:{self.port}")
            self.ready = True
            async with server, asyncio.TaskGroup() as tasks:
                tasks.create_task(self._send_scene())
                if self._camera is not None:
                    tasks.create_task(self._send_images(self._camera))
        finally:
            self.ready = False
            stop_listening()
            self.front.stop()
            await asyncio.to_thread(self._channels.stop)

    def _on_subscription(self, topic: str) -> None:
        """Wake up the task that sends a topic. Called in threads of the server."""
        assert self._loop is not None
        _notify(self._loop, self._scene_changed if _is_of_scene(topic) else self._camera_changed)

    async def _send_scene(self) -> None:
        """Send changes of the scene, and all of it from time to time, while there are subscribers."""
        loop = asyncio.get_running_loop()
        feed: _SceneFeed | None = None
        while True:
            with suppress(TimeoutError):
                async with asyncio.timeout(None if feed is None else WHOLE_SCENE_SECONDS):
                    await self._scene_changed.wait()
            self._scene_changed.clear()
            begin = loop.time()
            new_subscribers = self._channels.take_new_subscribers()
            if not any(_is_of_scene(topic) for topic in self._channels.topics):
                feed = None
                continue
            feed = feed or _SceneFeed(self._channels, self._profile, self._scene_frames())
            await feed.send(self._tree.snapshot, new_subscribers)
            await asyncio.sleep(max(0.0, begin + 1.0 / MAX_UPDATE_RATE - loop.time()))

    async def _send_images(self, camera: CameraSource) -> None:
        """Send images while there are subscribers. The camera makes none otherwise."""
        while True:
            self._camera_changed.clear()
            wanted = self._wanted_images()
            if wanted is None or not await self._stream(camera, wanted):
                await self._camera_changed.wait()

    def _wanted_images(self) -> _WantedImages | None:
        """Return the images that subscribers need; None without subscribers."""
        topics = {topic for topic in self._channels.topics if not _is_of_scene(topic)}
        if not topics:
            return None
        return _WantedImages(
            left=CLOUD_TOPIC in topics or not topics.isdisjoint(IMAGE_TOPICS["left"]),
            right=not topics.isdisjoint(IMAGE_TOPICS["right"]),
            disparity=not topics.isdisjoint((*IMAGE_TOPICS["depth"], DISPARITY_TOPIC, CLOUD_TOPIC)),
            points=CLOUD_TOPIC in topics,
        )

    async def _stream(self, camera: CameraSource, wanted: _WantedImages) -> bool:
        """Send image sets; return True as soon as subscribers need others, and False if the camera gives none."""
        converter = CameraConverter(camera.baseline, cloud=wanted.points)
        try:
            with camera.subscribe(wanted.left, wanted.right, wanted.disparity) as sets:
                while self._wanted_images() == wanted:
                    self._camera_changed.clear()
                    data = await _unless(self._camera_changed, sets.get())
                    if data is not None:
                        await asyncio.to_thread(self._send_set, converter, data)
        except RuntimeError as error:
            _log.warning(f"Foxglove gets no images: {error}")
            return False
        return True

    def _send_set(self, converter: CameraConverter, data: bytes) -> None:
        for images in converter.convert(pb.ImageSet.FromString(data)):
            for message in self._profile.camera(images, self._channels.topics.__contains__):
                self._channels.send(message, images.time_ns)


class _SceneFeed:
    """The scene as clients have it."""

    def __init__(self, channels: Channels, profile: Profile, frames: SceneFrames) -> None:
        self._channels = channels
        self._profile = profile
        self._frames = frames
        self._mirror = SceneMirror()
        self._repetition: float | None = None
        """Time from which the whole scene is sent again, on the loop's clock; None before the first time."""

    async def send(self, snapshot: Snapshot, new_subscribers: Mapping[str, Iterable[int]]) -> None:
        """Send changes to all clients, and the whole scene to new subscribers (ids of clients by topic)."""
        frames = await self._frames.advance(snapshot)
        now = asyncio.get_running_loop().time()
        repeat = self._repetition is not None and now >= self._repetition
        if repeat or self._repetition is None:
            self._repetition = now + WHOLE_SCENE_SECONDS
        await asyncio.to_thread(self._send, frames, new_subscribers, repeat, snapshot.timestamp)

    def _send(
        self, frames: list[bytes], new_subscribers: Mapping[str, Iterable[int]], repeat: bool, time_ns: int
    ) -> None:
        subscribed = self._channels.topics
        for frame in frames:
            change = self._mirror.apply(ViewFrame(frame), time_ns)
            if change is not None:
                for cloud in change.clouds:
                    if (topic := self._profile.clouds.topic(cloud.frame)) is not None:
                        self._channels.advertise(topic, schemas()[CLOUD_TOPIC])
                for message in self._profile.scene(change, subscribed.__contains__):
                    self._channels.send(message, change.time_ns)
                for cloud in change.clouds:  # subscribers have got an empty cloud in place of a removed one
                    if not len(cloud.points) and (topic := self._profile.clouds.release(cloud.frame)) is not None:
                        self._channels.withdraw(topic)
        if repeat and SCENE_TOPIC in subscribed:  # a message of its own: early versions of the app delete at its end
            self._channels.send(encode(SCENE_TOPIC, deletion_of_all(time_ns)), time_ns)
        receivers = subscribed if repeat else new_subscribers
        if receivers:
            for message in self._profile.scene(self._mirror.whole(), receivers.__contains__):
                self._channels.send(message, time_ns, None if repeat else new_subscribers[message.topic])


def _is_of_scene(topic: str) -> bool:
    return topic in (TF_TOPIC, SCENE_TOPIC) or topic.startswith(SCENE_CLOUDS_TOPIC)


async def _unless(event: asyncio.Event, getting: Coroutine[Any, Any, bytes]) -> bytes | None:
    """Return the result of a coroutine; None, and cancel it, if an event is set before."""
    tasks = result, _ = asyncio.create_task(getting), asyncio.create_task(event.wait())
    try:
        await asyncio.wait(tasks, return_when=asyncio.FIRST_COMPLETED)
        return result.result() if result.done() else None
    finally:
        for task in tasks:
            task.cancel()


def _notify(loop: asyncio.AbstractEventLoop, event: asyncio.Event) -> None:
    """Set an event from any thread."""
    with suppress(RuntimeError):  # the loop is closed
        loop.call_soon_threadsafe(event.set)
