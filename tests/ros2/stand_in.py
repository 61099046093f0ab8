"""The few classes and functions of rclpy that the node uses. Messages are read with rosbags' definitions.

As in ROS 2, a message arrives with its topic's subscribers only, and serialised messages are accepted as bytes.
"""

from __future__ import annotations

import enum
import re
import sys
import threading
import types
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, ClassVar

import pytest

from tests.support.waiting import SECONDS

rosbags_typesys = pytest.importorskip("rosbags.typesys", reason="needs the package rosbags")
PACKAGE = Path(__file__).parents[2] / "deploy" / "ros2" / "scenegate_ros2"
STORE = rosbags_typesys.get_typestore(rosbags_typesys.Stores.ROS2_JAZZY)
NAME = re.compile(r"/?[A-Za-z_]\w*(/[A-Za-z_]\w*)*", re.ASCII)


class ReliabilityPolicy(enum.Enum):
    RELIABLE = 1
    BEST_EFFORT = 2


class DurabilityPolicy(enum.Enum):
    TRANSIENT_LOCAL = 1
    VOLATILE = 2


@dataclass
class QoSProfile:
    depth: int
    reliability: ReliabilityPolicy = ReliabilityPolicy.RELIABLE
    durability: DurabilityPolicy = DurabilityPolicy.VOLATILE


@dataclass
class Publisher:
    message_type: Any
    topic: str
    qos: QoSProfile
    subscribers: int = 0
    received: list[Any] = field(default_factory=list)
    arrived: threading.Condition = field(default_factory=threading.Condition)

    def publish(self, message: Any) -> None:
        assert isinstance(message, bytes)
        message = STORE.deserialize_cdr(message, self.message_type.type)
        with self.arrived:
            if self.subscribers:
                self.received.append(message)
                self.arrived.notify_all()

    def get_subscription_count(self) -> int:
        return self.subscribers

    @contextmanager
    def subscriber(self) -> Iterator[Publisher]:
        """Subscribe for a while."""
        self.subscribers += 1
        try:
            yield self
        finally:
            self.subscribers -= 1

    def wait_for(self, wanted: Callable[[Any], bool] = lambda message: True, count: int = 1) -> list[Any]:
        """Return the first messages that fulfil a condition."""
        with self.arrived:
            assert self.arrived.wait_for(lambda: sum(map(wanted, self.received)) >= count, SECONDS), self.topic
            return [message for message in self.received if wanted(message)][:count]


class Logger:
    def __init__(self) -> None:
        self.warnings: list[str] = []

    def warning(self, text: str) -> None:
        self.warnings.append(text)


class Node:
    given: ClassVar[dict[str, Any]] = {}
    """Parameters, as ROS 2 takes them from the launch file."""
    clock_ns: ClassVar[int] = 0

    def __init__(self, name: str) -> None:
        assert NAME.fullmatch(name)
        self.topics: dict[str, Publisher] = {}
        self.logger = Logger()
        self._parameters: dict[str, Any] = {"use_sim_time": self.given.get("use_sim_time", False)}
        self._ended = threading.Event()

    def declare_parameter(self, name: str, default: Any) -> None:
        value = self.given.get(name, default)
        assert type(value) is type(default), f"ROS 2 refuses another type for {name}"
        self._parameters[name] = value

    def get_parameter(self, name: str) -> Any:
        return types.SimpleNamespace(value=self._parameters[name])

    def create_publisher(self, message_type: Any, topic: str, qos: QoSProfile) -> Publisher:
        assert NAME.fullmatch(topic), topic
        assert "__" not in topic
        self.topics[topic] = publisher = Publisher(message_type, topic, qos)
        return publisher

    def create_timer(self, seconds: float, callback: Callable[[], None]) -> None:
        def run() -> None:
            while not self._ended.wait(seconds):
                callback()

        threading.Thread(target=run, daemon=True).start()

    def get_clock(self) -> Any:
        """A simulated clock, which shows ``clock_ns``."""
        return types.SimpleNamespace(now=lambda: types.SimpleNamespace(nanoseconds=self.clock_ns))

    def get_logger(self) -> Logger:
        return self.logger

    def destroy_node(self) -> None:
        self._ended.set()


def get_message(name: str) -> Any:
    """Return the type of a message; fails if there is no such type."""
    return types.SimpleNamespace(type=STORE.types[name].__msgtype__)


def _module(name: str, **contents: Any) -> types.ModuleType:
    module = types.ModuleType(name)
    vars(module).update(contents)
    return module


def install(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let ``import rclpy`` find the stand-in, and ``import scenegate_ros2`` the package."""
    shutdown = type("ExternalShutdownException", (Exception,), {})
    modules = [
        _module("rclpy", init=lambda: None, spin=lambda node: None, try_shutdown=lambda: None),
        _module("rclpy.executors", ExternalShutdownException=shutdown),
        _module("rclpy.node", Node=Node),
        _module("rclpy.publisher", Publisher=Publisher),
        _module(
            "rclpy.qos", QoSProfile=QoSProfile, ReliabilityPolicy=ReliabilityPolicy, DurabilityPolicy=DurabilityPolicy
        ),
        _module("rosidl_runtime_py"),
        _module("rosidl_runtime_py.utilities", get_message=get_message),
    ]
    for module in modules:
        monkeypatch.setitem(sys.modules, module.__name__, module)
    monkeypatch.syspath_prepend(str(PACKAGE))
    for name in [name for name in sys.modules if name.startswith("scenegate_ros2")]:
        monkeypatch.delitem(sys.modules, name)
