"""Write MCAP files: chunked, indexed, a new one when one is full, and readable after the process was killed."""

from collections import deque
from dataclasses import dataclass
from pathlib import Path
from typing import BinaryIO, Final

from mcap.writer import Writer

CHUNK_BYTES: Final = 1 << 20
"""Bytes of messages after which a chunk is compressed and written."""


@dataclass(frozen=True, slots=True)
class Schema:
    """Type of a channel's messages."""

    name: str
    encoding: str
    """``protobuf``, ``ros2msg`` or ``jsonschema``."""
    data: bytes
    message_encoding: str
    """``protobuf``, ``cdr`` or ``json``."""


@dataclass(frozen=True, slots=True)
class EncodedMessage:
    """A message as it is written."""

    topic: str
    schema: Schema
    data: bytes


class McapFiles:
    """Writes messages to a file, and to further ones when that is full."""

    def __init__(self, path: Path, profile: str, *, max_bytes: int = 0, keep: int = 0) -> None:
        """Replace a file; the next one is ``NAME_1.mcap``. ``profile``: ``ros2``, or empty. Raises OSError.

        ``max_bytes``: size after which a new file begins; 0: never. ``keep``: number of newest files that are kept; 0:
        all.
        """
        self._path = path
        self._profile = profile
        self._max_bytes = max_bytes
        self._keep = keep
        self.paths: deque[Path] = deque()
        """Files that were written and are kept, oldest first."""
        self.messages = 0
        """Number of messages written."""
        self.bytes = 0
        """Bytes of all finished files."""
        self._count = 0
        self._open()

    @property
    def is_full(self) -> bool:
        """True if a new file should begin."""
        return 0 < self._max_bytes <= self._file.tell()

    @property
    def size(self) -> int:
        """Bytes written to all files."""
        return self.bytes + self._file.tell()

    def write(self, message: EncodedMessage, log_time_ns: int, publish_time_ns: int) -> None:
        """Write a message with the times of recording and of the message, nanoseconds since the epoch."""
        channel = self._channels.get(message.topic)
        if channel is None:
            schema = message.schema
            schema_id = self._schemas.get(schema.name)
            if schema_id is None:
                schema_id = self._writer.register_schema(schema.name, schema.encoding, schema.data)
                self._schemas[schema.name] = schema_id
            channel = self._writer.register_channel(message.topic, schema.message_encoding, schema_id)
            self._channels[message.topic] = channel
        self._sequences[channel] = sequence = self._sequences.get(channel, -1) + 1
        self._writer.add_message(channel, log_time_ns, message.data, publish_time_ns, sequence)
        self.messages += 1

    def flush(self) -> None:
        """Write the begun chunk, so that a killed process loses nothing before this call."""
        self._writer.flush()

    def next_file(self) -> None:
        """Finish the file and begin the next one. Raises OSError for either, or the oldest file."""
        self.close()
        self._open()
        while self._keep and len(self.paths) > self._keep:
            self.paths.popleft().unlink(missing_ok=True)

    def close(self) -> None:
        """Finish the file: write its index."""
        self._writer.finish()
        self.bytes += self._file.tell()
        self._file.close()

    def _open(self) -> None:
        path = self._path if not self._count else self._path.with_stem(f"{self._path.stem}_{self._count}")
        self._count += 1
        self._file: BinaryIO = path.open("wb")
        self.paths.append(path)
        self._writer = Writer(self._file, chunk_size=CHUNK_BYTES)
        self._writer.start(self._profile, "scenegate")
        self._schemas: dict[str, int] = {}
        self._channels: dict[str, int] = {}
        self._sequences: dict[int, int] = {}
