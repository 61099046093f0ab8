"""A thread for each of camera, scene and IMU publishes what it receives.

The camera's images are requested while somebody subscribes to them. A connection that is lost is made again.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterable, Mapping
from dataclasses import replace
from typing import Any

from mcap_ros2.writer import serialize_dynamic

from scenegate.camera import BadImageError, Credentials, ImuFailure, StreamOptions
from scenegate.recording.camera_values import CameraConverter
from scenegate.recording.joints import JointReader
from scenegate.recording.mcap_file import EncodedMessage
from scenegate.recording.profiles import CLOUD_TOPIC, DISPARITY_TOPIC, IMU_TOPIC, SCENE_TOPIC, Ros2Profile
from scenegate.recording.scene_mirror import SceneMirror
from scenegate.recording.sources import RecordingError, camera_sets, imu_samples, scene_frames
from scenegate.recording.view_frames import ViewFrame, ViewFrameError
from scenegate_ros2.topics import CLOCK_DEFINITION, CLOCK_TOPIC, CLOCK_TYPE, DEPTH, LEFT, RIGHT, Topics

PARAMETERS = {
    "camera": "127.0.0.1:50051",
    "url": "http://127.0.0.1:8000",
    "token": "",
    "pipeline": 0,
    "color": False,
    "scene": True,
    "reliability": "reliable",
    "tf_rate": 10.0,
    "publish_clock": False,
}
"""Parameters of the node and their defaults; docs/ros2.md explains them."""
RETRY_SECONDS = 1.0
"""Time after which a lost connection is made again."""
SETTLED_SECONDS = 0.5
"""Time after which a transform that does not change is repeated."""
POLL_SECONDS = 0.2
"""Time between two looks at the number of subscribers."""


def check(values: Mapping[str, Any]) -> None:
    """Check parameters.

    Raises:
        ValueError: one is out of range.
    """
    if values["reliability"] not in ("reliable", "best_effort"):
        raise ValueError(f"reliability is {values['reliability']!r}; it must be reliable or best_effort")
    if not 0.0 < values["tf_rate"] <= 1000.0:
        raise ValueError(f"tf_rate is {values['tf_rate']} Hz; it must be above 0 and at most 1000")


class Feeds:
    """Publishes a stereo camera and the live scene of a gateway."""

    def __init__(self, values: Mapping[str, Any], topics: Topics, warn: Callable[[str], object]) -> None:
        """
        Args:
            values: ``PARAMETERS``, checked.
            topics: publishers.
            warn: logs a sentence about a lost connection.
        """
        self._values = values
        self._topics = topics
        self._warn = warn
        self._profile = Ros2Profile()
        self._credentials = Credentials(values["token"] or None)
        self._converter = CameraConverter()
        self._encode_clock = serialize_dynamic(CLOCK_TYPE, CLOCK_DEFINITION)[CLOCK_TYPE]
        self._simulated_time: int | None = None
        """Newest time on ``/clock``, nanoseconds."""
        self._mirror = SceneMirror()
        self._scene_lock = threading.Lock()
        self._changed: dict[str, float] = {}
        """Monotonic time of the newest change of each transform, by its child frame, seconds."""
        self._marker_subscribers = 0
        self._stopping = threading.Event()

    def start(self) -> None:
        """Start the threads. The caller calls ``repeat_scene`` at ``tf_rate``."""
        feeds = {
            "camera": (self._publish_camera, self._values["camera"]),
            "scene": (self._publish_scene, self._values["url"] if self._values["scene"] else ""),
            "imu": (self._publish_imu, self._values["url"]),
        }
        for name, (publish, address) in feeds.items():
            if address:
                threading.Thread(target=self._repeat, args=(publish,), name=name, daemon=True).start()

    def stop(self) -> None:
        """Tell the threads to end; they do so with the next message that they receive."""
        self._stopping.set()

    def _repeat(self, publish: Callable[[], None]) -> None:
        """Call a function until the node stops. What it raises is logged once, until it has worked again."""
        reported = ""
        while not self._stopping.is_set():
            try:
                publish()
                reported = ""
            except (RecordingError, ImuFailure, ViewFrameError, BadImageError, OSError) as error:
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
        left, right = count(*LEFT) > 0 or self._values["publish_clock"], count(*RIGHT) > 0
        depth = count(*DEPTH, DISPARITY_TOPIC, CLOUD_TOPIC) > 0
        if not (left or right or depth):
            return None
        return StreamOptions(
            self._values["camera"],
            left=left or depth,  # for the colours of the points
            right=right,
            disparity=depth,
            color=self._values["color"],
            credentials=self._credentials,
        )

    def _publish_camera(self) -> None:
        """Publish the images that are wanted now; return when others are, or none."""
        options = self._wanted_images()
        if options is None:
            self._stopping.wait(POLL_SECONDS)
            return
        if options.right and not options.disparity:  # only a set with disparity tells the baseline
            for image_set in camera_sets(replace(options, left=False, right=False, disparity=True, count=1)):
                self._converter.convert(image_set)
                break
        for image_set in camera_sets(options):
            for images in self._converter.convert(image_set):
                self._advance_clock(images.time)
                self._send(self._profile.camera(images))
            if self._stopping.is_set() or self._wanted_images() != options:
                return

    def _advance_clock(self, timestamp: int) -> None:
        if self._values["publish_clock"] and timestamp > (self._simulated_time or 0):
            self._simulated_time = timestamp
            clock = {"sec": timestamp // 10**9, "nanosec": timestamp % 10**9}
            self._topics.publish(CLOCK_TOPIC, CLOCK_TYPE, self._encode_clock({"clock": clock}))

    def _publish_scene(self) -> None:
        """Publish changes of the scene until the connection ends."""
        joints = JointReader()
        with self._scene_lock:
            self._mirror = SceneMirror()
        for data in scene_frames(self._values["url"], self._credentials):
            if self._stopping.is_set():
                return
            frame, now = ViewFrame(data), self._now()
            with self._scene_lock:
                change = self._mirror.apply(frame)
            values = joints.read(frame, now) if now is not None else None
            if values is not None:
                self._send(self._profile.joints(values))
            if change is None or now is None:
                continue
            for each in change.transforms:
                self._changed[each.child] = time.monotonic()
            if self._values["publish_clock"]:
                change = replace(change, time=now)
            if not self._topics.subscribers(SCENE_TOPIC):
                change = replace(change, entities=())
            self._send(self._profile.scene(change))

    def repeat_scene(self) -> None:
        """Publish transforms that have not changed for a while, and all markers if somebody is new to them.

        A transform is valid until its newest time only, and who listens later needs it, too.
        """
        now, earlier = self._now(), self._marker_subscribers
        if now is None or not self._values["scene"]:
            return
        with self._scene_lock:
            whole = self._mirror.whole(now)
        settled = time.monotonic() - SETTLED_SECONDS
        transforms = [each for each in whole.transforms if self._changed.get(each.child, settled) <= settled]
        self._marker_subscribers = self._topics.subscribers(SCENE_TOPIC)
        is_new = self._marker_subscribers > earlier
        geometry = {} if is_new else {"entities": (), "clouds": ()}
        self._send(self._profile.scene(replace(whole, transforms=transforms, **geometry)))

    def _now(self) -> int | None:
        """Return the time of what is true now, nanoseconds; None if ``/clock`` has not begun."""
        return self._simulated_time if self._values["publish_clock"] else time.time_ns()

    def _publish_imu(self) -> None:
        """Publish samples of the IMU while somebody subscribes to them."""
        if not self._topics.subscribers(IMU_TOPIC):
            self._stopping.wait(POLL_SECONDS)
            return
        for sample in imu_samples(self._values["url"], self._credentials, self._values["pipeline"]):
            self._send(self._profile.imu(sample))
            if self._stopping.is_set() or not self._topics.subscribers(IMU_TOPIC):
                return
