"""The same without ROS 2: publishes to nodes on rmw_zenoh with the package zenoh-ros2-sdk.

python -m scenegate_ros2.zenoh_node [--router 127.0.0.1:7447] [--camera …] [--url …]
"""

from __future__ import annotations

import argparse
import logging
import threading

from rosbags.typesys import Stores, get_typestore
from zenoh_ros2_sdk import ROS2Publisher

from scenegate.recording.ros2_messages import definition
from scenegate_ros2.feeds import Feeds
from scenegate_ros2.parameters import NodeParameters
from scenegate_ros2.topics import CLOCK_DEFINITION, CLOCK_TYPE, TYPES

_log = logging.getLogger("scenegate_ros2")


class ZenohTopics:
    """Publishers on Zenoh. Which have subscribers is known, but not how many."""

    def __init__(self, router: str) -> None:
        """
        Args:
            router: address of the Zenoh router, ``HOST:PORT``.
        """
        self._host, _, port = router.rpartition(":")
        self._port = int(port)
        self._store = get_typestore(Stores.ROS2_JAZZY)
        self._lock = threading.Lock()
        self._publishers: dict[str, ROS2Publisher] = {}
        for topic, message_type in TYPES.items():
            self._publisher(topic, message_type)

    def publish(self, topic: str, message_type: str, data: bytes) -> None:
        """See ``Topics``."""
        message = self._store.deserialize_cdr(data, message_type)  # the package takes fields only
        self._publisher(topic, message_type).publish(**vars(message))

    def subscribers(self, *topics: str) -> int:
        """Return the number of topics with subscribers."""
        with self._lock:
            publishers = [self._publishers[topic] for topic in topics if topic in self._publishers]
        return sum(bool(publisher.pub.matching_status.matching) for publisher in publishers)

    def _publisher(self, topic: str, message_type: str) -> ROS2Publisher:
        with self._lock:
            if topic not in self._publishers:
                # With definition and hash, the package downloads nothing.
                text = CLOCK_DEFINITION if message_type == CLOCK_TYPE else definition(message_type)
                self._publishers[topic] = ROS2Publisher(
                    topic,
                    message_type,
                    msg_definition=text,
                    type_hash=self._store.hash_rihs01(message_type),
                    node_name="scenegate",
                    router_ip=self._host,
                    router_port=self._port,
                )
            return self._publishers[topic]


def main() -> None:
    """Publish until interrupted."""
    parser = argparse.ArgumentParser(description="Publishes a Scenegate gateway to ROS 2 nodes on rmw_zenoh.")
    parser.add_argument("--router", default="127.0.0.1:7447", help="Zenoh router, HOST:PORT")
    for name, default in vars(NodeParameters()).items():
        flag = "--" + name.replace("_", "-")
        if isinstance(default, bool):
            parser.add_argument(flag, action=argparse.BooleanOptionalAction, default=default)
        else:
            parser.add_argument(flag, type=type(default), default=default)
    values = vars(parser.parse_args())
    try:
        router = values.pop("router")
        parameters = NodeParameters(**values)
        topics = ZenohTopics(router)
    except ValueError as error:
        parser.error(str(error))
    feeds = Feeds(parameters, topics, _log.warning)
    feeds.start()
    try:
        while not threading.Event().wait(1.0 / parameters.tf_rate):
            feeds.repeat_scene()
    except KeyboardInterrupt:
        feeds.stop()


if __name__ == "__main__":
    main()
