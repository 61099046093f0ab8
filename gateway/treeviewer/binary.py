"""Requests in MessagePack (``treeviewer_msgpack``): the JSON format's commands, with long arrays as bytes.

See docs/tree-viewer-binary.md. A big message is cut into its commands without making objects of them; each is then read
by itself, so that the interpreter is never held for long.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any, Final

import msgspec
import numpy as np

from gateway.treeviewer import fast_schema, msgpack_kernels
from gateway.treeviewer.arrays import EXTENSION, unpack
from gateway.treeviewer.config import Limits
from gateway.treeviewer.geometry import Context, MeshLoader
from gateway.treeviewer.requests import UNREADABLE, Failure, Request, RequestError, RequestReader

LEAST_CUT: Final = 64 * 1024
"""Bytes; smaller requests are read in one go within a millisecond."""
READ_AT_ONCE: Final = 256
"""Commands read before the interpreter is free for a moment: 0.3 ms."""
FAULTS: Final = {
    msgpack_kernels.TRUNCATED: "it ends too early",
    msgpack_kernels.MALFORMED: "byte c1 is never used",
    msgpack_kernels.LONGER: "bytes follow its end",
}


class Foreign:
    """An extension that means nothing here."""


def _is_map(first: int) -> bool:
    """Whether a value that begins with this byte is a map, or nil, which is as good as an empty one."""
    return 0x80 <= first <= 0x8F or first in (0xC0, 0xDE, 0xDF)


def _extension(code: int, payload: memoryview) -> object:
    return unpack(payload) if code == EXTENSION else Foreign()


class BinaryReader(RequestReader):
    """Reads requests under given limits. Has no state of its own and may be used by several threads."""

    _whole = "a MessagePack map"

    def __init__(self, limits: Limits | None = None, meshes: MeshLoader | None = None) -> None:
        super().__init__(limits, meshes)
        message, geometry, transform = fast_schema.message_types(self._limits)
        self._message: msgspec.msgpack.Decoder[Any] = msgspec.msgpack.Decoder(message)
        self._geometry: msgspec.msgpack.Decoder[Any] = msgspec.msgpack.Decoder(geometry)
        self._transform: msgspec.msgpack.Decoder[Any] = msgspec.msgpack.Decoder(transform)
        self._any = msgspec.msgpack.Decoder(ext_hook=_extension)
        self._members = msgspec.msgpack.Decoder(dict[str | int, msgspec.Raw] | None)
        self._list = msgspec.msgpack.Decoder(list[msgspec.Raw])

    def read(self, data: memoryview, *, extract: bool | None = None) -> Request:
        """The commands of a request. ``extract`` means nothing here.

        Raises:
            RequestError: the data is not a MessagePack map, or too much of it.
        """
        try:
            if len(data) < LEAST_CUT:
                usual = self._usual(data, self._message)
                if usual is not None:
                    return usual
                return self._lenient(self._any.decode(data), Context(self._limits, meshes=self._meshes))
            self._bound(data)
            return self._in_pieces(data)
        except UNREADABLE as error:
            raise RequestError(f"the request is not valid MessagePack ({error})") from None

    def _bound(self, data: memoryview) -> None:
        """Refuses what would become too many objects, before any is made."""
        most = self._limits.binary_objects
        found = msgpack_kernels.objects(np.frombuffer(data, np.uint8), most)
        if found in FAULTS:
            raise RequestError(f"the request is not valid MessagePack ({FAULTS[found]})")
        if found > most:
            raise RequestError(f"the request has more than {most} objects besides its arrays, the limit")

    def _in_pieces(self, data: memoryview) -> Request:
        if not _is_map(data[0]):
            raise RequestError(f"the request must be {self._whole}, its first byte is {data[0]:02x}")
        members = self._members.decode(data) or {}
        request, context = Request(), Context(self._limits, meshes=self._meshes)
        if "delete" in members:
            self._deletes(self._any.decode(members["delete"]), request, context)
        # Director's older keys override the new ones, as in JSON
        geometries = members.get("load", members.get("setgeometry"))
        transforms = members.get("draw", members.get("settransform"))
        if geometries is not None:
            self._each(geometries, request, context, self._geometry_at, self._geometries)
        if transforms is not None:
            self._each(transforms, request, context, self._transform_at, self._transforms)
        return request

    def _each(
        self,
        commands: msgspec.Raw,
        request: Request,
        context: Context,
        quick: Callable[[msgspec.Raw, int, Request], None],
        lenient: Callable[[Any, Request, Context], None],
    ) -> None:
        try:
            listed = self._list.decode(commands)
        except UNREADABLE:  # not a list: null, {} or one bare command
            lenient(self._any.decode(commands), request, context)
            return
        for index, command in enumerate(listed):
            try:
                quick(command, index, request)
            except UNREADABLE:
                context.first = index
                lenient([self._any.decode(command)], request, context)
            if index % READ_AT_ONCE == READ_AT_ONCE - 1:
                time.sleep(0)  # the interpreter is free for a moment
        context.first = 0

    def _geometry_at(self, raw: msgspec.Raw, index: int, request: Request) -> None:
        command = self._geometry.decode(raw)
        parts = fast_schema.parts_of(command)
        if parts is None:
            request.fail(Failure("setgeometry", index, command.path, "geometries is missing"), self._limits)
        else:
            request.geometries.append((command.path, parts))

    def _transform_at(self, raw: msgspec.Raw, index: int, request: Request) -> None:
        request.transforms += fast_schema.transforms_of([self._transform.decode(raw)])
