"""A client of Foxglove's WebSocket protocol, ``foxglove.sdk.v1``, apart from foxglove-sdk.

https://github.com/foxglove/ws-protocol/blob/main/docs/spec.md
"""

import json
import struct
from base64 import b64decode
from collections import deque
from collections.abc import Iterable
from typing import Any

from google.protobuf import descriptor_pb2, descriptor_pool, message_factory
from websockets.asyncio.client import ClientConnection
from websockets.typing import Subprotocol

SUBPROTOCOL = Subprotocol("foxglove.sdk.v1")
MESSAGE_DATA = struct.Struct("<BIQ")
"""Opcode 1, subscription id, timestamp in nanoseconds; then the payload."""


class FoxgloveClient:
    """Subscribes to topics, and decodes messages with the schemas that the server advertises."""

    def __init__(self, socket: ClientConnection) -> None:
        self._socket = socket
        self.info: dict[str, Any] = {}
        self.channels: dict[str, dict[str, Any]] = {}
        """Advertised channels by topic."""
        self.parameters: dict[str, Any] = {}
        self._topics: dict[int, str] = {}
        """Topics by subscription id."""
        self._messages: deque[tuple[str, int, Any]] = deque()
        """Topic, time and content of messages that came while something else was awaited.

        foxglove-sdk sends messages and advertisements from queues of their own, in any order.
        """
        self._types: dict[str, Any] = {}

    async def subscribe(self, *topics: str) -> None:
        while not self.channels.keys() >= set(topics):
            await self._receive()
        await self._send_subscriptions(topics)

    async def _send_subscriptions(self, topics: Iterable[str]) -> None:
        subscriptions = []
        for topic in topics:
            number = len(self._topics) + 1
            self._topics[number] = topic
            subscriptions.append({"id": number, "channelId": self.channels[topic]["id"]})
        await self._socket.send(json.dumps({"op": "subscribe", "subscriptions": subscriptions}))

    async def unsubscribe(self, *topics: str) -> None:
        ids = [number for number, topic in self._topics.items() if topic in topics]
        await self._socket.send(json.dumps({"op": "unsubscribe", "subscriptionIds": ids}))

    async def get_parameters(self) -> dict[str, Any]:
        self.parameters = {}
        await self._socket.send(json.dumps({"op": "getParameters", "parameterNames": [], "id": "all"}))
        while not self.parameters:
            await self._receive()
        return self.parameters

    async def set_parameter(self, name: str, value: object) -> None:
        await self._socket.send(json.dumps({"op": "setParameters", "parameters": [{"name": name, "value": value}]}))

    async def until_withdrawn(self, topic: str) -> None:
        while topic in self.channels:
            await self._receive()

    async def next_message(self) -> tuple[str, int, Any]:
        while not self._messages:
            await self._receive()
        return self._messages.popleft()

    async def messages_of(self, *topics: str) -> dict[str, Any]:
        found: dict[str, Any] = {}
        while set(topics) - set(found):
            topic, _, value = await self.next_message()
            found.setdefault(topic, value)
        return found

    async def _receive(self) -> None:
        data = await self._socket.recv()
        if isinstance(data, bytes):
            opcode, number, time = MESSAGE_DATA.unpack_from(data)
            if opcode == 1:
                topic = self._topics[number]
                self._messages.append((topic, time, self._type_of(topic).FromString(data[MESSAGE_DATA.size :])))
            return
        message = json.loads(data)
        if message["op"] == "serverInfo":
            self.info = message
        elif message["op"] == "advertise":
            self.channels.update({channel["topic"]: channel for channel in message["channels"]})
        elif message["op"] == "unadvertise":
            self.channels = {
                topic: each for topic, each in self.channels.items() if each["id"] not in message["channelIds"]
            }
        elif message["op"] == "status":
            # foxglove-sdk advertises a new channel shortly before it takes subscriptions to it.
            assert message["message"].startswith("Unknown channel ID"), message
            number = int(message["message"].rpartition(" ")[2])
            await self._send_subscriptions(topic for topic, each in self.channels.items() if each["id"] == number)
        elif message["op"] == "parameterValues":
            self.parameters = {each["name"]: each.get("value") for each in message["parameters"]}

    def _type_of(self, topic: str) -> Any:
        if topic not in self._types:
            channel = self.channels[topic]
            assert (channel["encoding"], channel["schemaEncoding"]) == ("protobuf", "protobuf")
            pool = descriptor_pool.DescriptorPool()
            for each in descriptor_pb2.FileDescriptorSet.FromString(b64decode(channel["schema"])).file:
                pool.Add(each)
            self._types[topic] = message_factory.GetMessageClass(pool.FindMessageTypeByName(channel["schemaName"]))
        return self._types[topic]
