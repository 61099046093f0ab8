"""Publishers of messages that are serialised already, made when they are needed."""

from __future__ import annotations

from rclpy.node import Node
from rclpy.publisher import Publisher
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from rosidl_runtime_py.utilities import get_message

from scenegate.recording.profiles import CLOUD_TOPIC, DISPARITY_TOPIC, IMAGE_TOPICS, IMU_TOPIC, SCENE_TOPIC, TF_TOPIC

LEFT, RIGHT, DEPTH = (IMAGE_TOPICS[name] for name in ("left", "right", "depth"))
CLOCK_TOPIC = "/clock"
TYPES = {
    **{topic: "sensor_msgs/msg/Image" for topic, _ in IMAGE_TOPICS.values()},
    **{topic: "sensor_msgs/msg/CameraInfo" for _, topic in IMAGE_TOPICS.values()},
    DISPARITY_TOPIC: "stereo_msgs/msg/DisparityImage",
    CLOUD_TOPIC: "sensor_msgs/msg/PointCloud2",
    IMU_TOPIC: "sensor_msgs/msg/Imu",
    SCENE_TOPIC: "visualization_msgs/msg/MarkerArray",
    TF_TOPIC: "tf2_msgs/msg/TFMessage",
}
"""Types of the topics that exist from the start. Those of joints and of the scene's point clouds follow."""
_DEPTHS = {TF_TOPIC: 100, IMU_TOPIC: 100}
"""Messages that wait for a slow subscriber; of other topics five."""


class Topics:
    """The publishers of a node."""

    def __init__(self, node: Node, reliability: str) -> None:
        """
        Args:
            reliability: ``reliable``, which every subscriber accepts (REP 2003), or ``best_effort``.
        """
        self._node = node
        self._reliability = ReliabilityPolicy[reliability.upper()]
        self._publishers: dict[str, Publisher] = {}
        for topic, message_type in TYPES.items():
            self.publisher(topic, message_type)

    def publisher(self, topic: str, message_type: str) -> Publisher:
        """Return the publisher of a topic. All but ``/tf`` and ``/clock`` are in the node's namespace."""
        publisher = self._publishers.get(topic)
        if publisher is None:
            is_global = topic in (TF_TOPIC, CLOCK_TOPIC)
            qos = QoSProfile(
                depth=_DEPTHS.get(topic, 5),
                reliability=ReliabilityPolicy.RELIABLE if is_global else self._reliability,
                durability=DurabilityPolicy.VOLATILE,
            )
            name = topic if is_global else topic.removeprefix("/")
            publisher = self._node.create_publisher(get_message(message_type), name, qos)
            self._publishers[topic] = publisher
        return publisher

    def subscribers(self, *topics: str) -> int:
        """Return the number of subscribers of topics."""
        return sum(self._publishers[topic].get_subscription_count() for topic in topics)
