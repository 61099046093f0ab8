"""Names, types and queues of the topics, and the interface of their publishers."""

from __future__ import annotations

from typing import Protocol

from scenegate.recording.topics import CLOUD_TOPIC, DISPARITY_TOPIC, IMAGE_TOPICS, SCENE_TOPIC, TF_TOPIC

LEFT, RIGHT, DEPTH = (IMAGE_TOPICS[name] for name in ("left", "right", "depth"))
CLOCK_TOPIC = "/clock"
CLOCK_TYPE = "rosgraph_msgs/msg/Clock"
CLOCK_DEFINITION = f"""\
builtin_interfaces/Time clock
{"=" * 80}
MSG: builtin_interfaces/Time
int32 sec
uint32 nanosec
"""
TYPES = {
    **{topic: "sensor_msgs/msg/Image" for topic, _ in IMAGE_TOPICS.values()},
    **{topic: "sensor_msgs/msg/CameraInfo" for _, topic in IMAGE_TOPICS.values()},
    DISPARITY_TOPIC: "stereo_msgs/msg/DisparityImage",
    CLOUD_TOPIC: "sensor_msgs/msg/PointCloud2",
    SCENE_TOPIC: "visualization_msgs/msg/MarkerArray",
    TF_TOPIC: "tf2_msgs/msg/TFMessage",
}
"""Types of the topics that exist from the start. Those of joints and of the scene's point clouds follow."""
GLOBAL_TOPICS = (TF_TOPIC, CLOCK_TOPIC)
"""Topics that are not in the node's namespace."""


class Topics(Protocol):
    """Publishers of topics. Thread-safe."""

    def publish(self, topic: str, message_type: str, data: bytes) -> None:
        """Publish a message that is serialised already (CDR). The first one of a topic makes its publisher."""

    def subscribers(self, *topics: str) -> int:
        """Return the number of subscribers of topics, those without a publisher included."""


def queue_length(topic: str) -> int:
    """Return the number of messages that wait for a slow subscriber."""
    return 100 if topic == TF_TOPIC else 5
