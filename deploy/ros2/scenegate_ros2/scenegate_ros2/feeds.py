"""A thread for each of camera and scene publishes what it receives.

The camera's images are requested while they have subscribers. A connection that is lost is made again.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterable
from dataclasses import replace

from mcap_ros2.writer import serialize_dynamic

from scenegate.camera import BadImageError, StreamFailure, StreamOptions
from scenegate.recording.camera_values import CameraConverter
from scenegate.recording.mcap_file import EncodedMessage
from scenegate.recording.scene_mirror import SceneMirror
from scenegate.recording.sources import camera_sets, scene_frames
from scenegate.recording.topics import CLOUD_TOPIC, DISPARITY_TOPIC, JOINTS_TOPIC, SCENE_TOPIC, TF_TOPIC, Profile
from scenegate.recording.view_frames import ViewFrameError
from scenegate_ros2.parameters import NodeParameters
from scenegate_ros2.topics import CLOCK_DEFINITION, CLOCK_TOPIC, CLOCK_TYPE, DEPTH, LEFT, RIGHT, Topics

RETRY_SECONDS = 1.0
"""Time after which a lost connection is made again."""
SETTLED_SECONDS = 0.5
"""Time after which a transform that does not change is repeated."""
POLL_SECONDS = 0.2
"""Interval at which the number of subscribers is checked."""


class Feeds:
    """Publishes a stereo camera and the live scene of a gateway."""

    def __init__(
        self,
        parameters: NodeParameters,
        topics: Topics,
        warn: Callable[[str], object],
        simulated_time: Callable[[], int] | None = None,
    ) -> None:
        """
        Args:
            parameters: addresses and choices.
            topics: publishers.
            warn: logs a sentence about a lost connection.
            simulated_time: returns the time of another node's ``/clock``, nanoseconds, 0 before it begins; None: the
                scene has the gateway's times.

        Raises:
            ValueError, OSError: see ``NodeParameters.credentials``.
        """
        self._parameters = parameters
        self._topics = topics
        self._warn = warn
        self._profile = Profile("ros2", warn)
        self._credentials = parameters.credentials()
        self._converter = CameraConverter()
        self._encode_clock = serialize_dynamic(CLOCK_TYPE, CLOCK_DEFINITION)[CLOCK_TYPE]
        self._clock_ns = 0
        """Newest time that this node has published on ``/clock``."""
        self._simulated_time = (lambda: self._clock_ns) if parameters.publish_clock else simulated_time
        self._mirror = SceneMirror()
        self._scene_lock = threading.Lock()
        self._changed: dict[str, float] = {}
        """Monotonic time of recent changes of transforms, by child frame, seconds. ``_scene_lock`` guards it."""
        self._subscribers: dict[str, int] = {}
        """Number of subscribers of the topics of the scene's geometry when it was last repeated."""
        self._stopping = threading.Event()

    def start(self) -> None:
        """Start the threads. The caller calls ``repeat_scene`` at ``tf_rate``."""
        feeds = {
            "camera": (self._publish_camera, self._parameters.camera),
            "scene": (self._publish_scene, self._parameters.url if self._parameters.scene else ""),
        }
        for name, (publish, address) in feeds.items():
            if address:
                threading.Thread(target=self._repeat, args=(publish,), name=name, daemon=True).start()

    def stop(self) -> None:
        """Stop the threads; each ends with the next message that it receives."""
        self._stopping.set()

    def _repeat(self, publish: Callable[[], None]) -> None:
        """Call a function until the node stops. What it raises is logged once, until it has worked again."""
        reported = ""
        while not self._stopping.is_set():
            try:
                publish()
                reported = ""
            except (StreamFailure, ViewFrameError, BadImageError, OSError) as error:
                if str(error) != reported:
                    reported = str(error)
                    self._warn(reported)
                self._stopping.wait(RETRY_SECONDS)

    def _send(self, messages: Iterable[EncodedMessage]) -> None:
        for message in messages:
            if self._stopping.is_set():
                return
            self._topics.publish(message.topic, message.schema.name, message.data)

    def _wanted_images(self) -> StreamOptions | None:
        """Return the options of the stream that the subscribers need; None without subscribers.

        With ``publish_clock``, the left image is always received: its timestamps are the clock.
        """
        count = self._topics.subscribers
        left, right = count(*LEFT) > 0 or self._parameters.publish_clock, count(*RIGHT) > 0
        depth = count(*DEPTH, DISPARITY_TOPIC, CLOUD_TOPIC) > 0
        if not (left or right or depth):
            return None
        return StreamOptions(
            self._parameters.camera,
            left=left or depth,  # for the colours of the points
            right=right,
            disparity=depth,
            color=self._parameters.color,
            credentials=self._credentials,
        )

    def _publish_camera(self) -> None:
        """Publish the images that are wanted now; return when others are, or none."""
        options = self._wanted_images()
        if options is None:
            self._stopping.wait(POLL_SECONDS)
            return
        if options.right and not options.disparity:  # only a set with disparity has the baseline
            for image_set in camera_sets(replace(options, left=False, right=False, disparity=True, count=1)):
                self._converter.convert(image_set)
                break
        for image_set in camera_sets(options):
            for images in self._converter.convert(image_set):
                self._advance_clock(images.time_ns)
                self._send(self._profile.camera(images))
            if self._stopping.is_set() or self._wanted_images() != options:
                return

    def _advance_clock(self, time_ns: int) -> None:
        if self._parameters.publish_clock and time_ns > self._clock_ns:
            self._clock_ns = time_ns
            clock = {"sec": time_ns // 10**9, "nanosec": time_ns % 10**9}
            self._topics.publish(CLOCK_TOPIC, CLOCK_TYPE, self._encode_clock({"clock": clock}))

    def _publish_scene(self) -> None:
        """Publish changes of the scene until the connection ends."""
        with self._scene_lock:
            self._mirror.reconnect()
        for frame in scene_frames(self._parameters.url, self._credentials):
            if self._stopping.is_set():
                return
            now_ns = self._now_ns()
            with self._scene_lock:
                change = self._mirror.apply(frame, now_ns)
                if change is not None:
                    self._changed.update(dict.fromkeys((each.child for each in change.transforms), time.monotonic()))
            if change is None or not now_ns:
                continue
            if self._simulated_time is not None:
                change = replace(change, time_ns=now_ns)
            self._send(self._profile.scene(change, lambda topic: topic != SCENE_TOPIC or self._is_read(SCENE_TOPIC)))

    def _is_read(self, topic: str) -> bool:
        return self._topics.subscribers(topic) > 0

    def repeat_scene(self) -> None:
        """Publish what late subscribers need: transforms that have not changed for a while, joints, and geometry.

        A transform is valid until its newest time only. Geometry is published if its topic has more subscribers.
        """
        now_ns = self._now_ns()
        if not now_ns or not self._parameters.scene:
            return
        settled = time.monotonic() - SETTLED_SECONDS
        with self._scene_lock:
            whole = self._mirror.whole()
            self._changed = {child: changed for child, changed in self._changed.items() if changed > settled}
            transforms = [each for each in whole.transforms if each.child not in self._changed]
        clouds = filter(None, (self._profile.clouds.topic(cloud.frame) for cloud in whole.clouds))
        earlier = self._subscribers
        self._subscribers = {topic: self._topics.subscribers(topic) for topic in (SCENE_TOPIC, *clouds)}
        new = {topic for topic, count in self._subscribers.items() if count > earlier.get(topic, 0)}
        repeated = {TF_TOPIC, JOINTS_TOPIC, *new}
        self._send(self._profile.scene(replace(whole, time_ns=now_ns, transforms=transforms), repeated.__contains__))

    def _now_ns(self) -> int:
        """Return the current time, nanoseconds since the epoch; 0 if the simulated clock has not begun."""
        return time.time_ns() if self._simulated_time is None else self._simulated_time()
