"""The node on rclpy."""

from __future__ import annotations

import threading

import rclpy
from rclpy.executors import ExternalShutdownException
from rclpy.node import Node
from rclpy.publisher import Publisher
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from rosidl_runtime_py.utilities import get_message

from scenegate_ros2.feeds import Feeds
from scenegate_ros2.parameters import NodeParameters
from scenegate_ros2.topics import CLOCK_TOPIC, CLOCK_TYPE, GLOBAL_TOPICS, TYPES, queue_length


class NodeTopics:
    """The publishers of a node."""

    def __init__(self, node: Node, reliability: str) -> None:
        """
        Args:
            reliability: ``reliable``, which every subscriber accepts (REP 2003), or ``best_effort``.
        """
        self._node = node
        self._reliability = ReliabilityPolicy[reliability.upper()]
        self._lock = threading.Lock()
        self._publishers: dict[str, Publisher] = {}
        """Publishers by topic. ``_lock`` guards it."""
        for topic, message_type in TYPES.items():
            self.publisher(topic, message_type)

    def publisher(self, topic: str, message_type: str) -> Publisher:
        """Return the publisher of a topic."""
        with self._lock:
            if topic not in self._publishers:
                is_global = topic in GLOBAL_TOPICS
                qos = QoSProfile(
                    depth=queue_length(topic),
                    reliability=ReliabilityPolicy.RELIABLE if is_global else self._reliability,
                    durability=DurabilityPolicy.VOLATILE,
                )
                name = topic if is_global else topic[1:]
                self._publishers[topic] = self._node.create_publisher(get_message(message_type), name, qos)
            return self._publishers[topic]

    def publish(self, topic: str, message_type: str, data: bytes) -> None:
        """See ``Topics``."""
        self.publisher(topic, message_type).publish(data)

    def subscribers(self, *topics: str) -> int:
        """See ``Topics``."""
        with self._lock:
            publishers = [self._publishers[topic] for topic in topics if topic in self._publishers]
        return sum(publisher.get_subscription_count() for publisher in publishers)


class ScenegateNode(Node):
    """Publishes a stereo camera and the live scene of a gateway."""

    def __init__(self) -> None:
        super().__init__("scenegate")
        for name, default in vars(NodeParameters()).items():
            self.declare_parameter(name, default)
        parameters = NodeParameters(**{name: self.get_parameter(name).value for name in vars(NodeParameters())})
        topics = NodeTopics(self, parameters.reliability)
        if parameters.publish_clock:
            topics.publisher(CLOCK_TOPIC, CLOCK_TYPE)
        uses_sim_time = self.get_parameter("use_sim_time").value  # which rclpy declares
        clock = (lambda: self.get_clock().now().nanoseconds) if uses_sim_time else None
        self.feeds = Feeds(parameters, topics, self.get_logger().warning, clock)
        self.create_timer(1.0 / parameters.tf_rate, self.feeds.repeat_scene)


def main() -> None:
    """Run the node until it is interrupted."""
    rclpy.init()
    node = ScenegateNode()
    node.feeds.start()
    try:
        rclpy.spin(node)
    except (KeyboardInterrupt, ExternalShutdownException):
        pass
    finally:
        node.feeds.stop()
        node.destroy_node()
        rclpy.try_shutdown()
