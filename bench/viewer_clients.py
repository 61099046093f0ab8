"""Many viewers without a screen: ``python viewer_clients.py URL COUNT ours|viser|meshcat [SUBPROTOCOL]``.

They take in what comes, answer ours with credit as the page does, and look at nothing. For every line on the input the
process prints how many updates each has got so far.
"""

import asyncio
import json
import sys
import threading
from collections.abc import Callable

import websockets

_NODES = 1000
_MARKERS = {"ours": b'"kind":"update"', "viser": b"SetPositionMessage", "meshcat": b"set_transform"}
"""An update of ours moves all nodes. The others' messages are counted by nodes and divided, since viser, when it does
not keep up, sends some nodes more often than others."""


_VISER_HEAD = 16
"""Two sizes of 8 bytes; then Zstandard."""


def reader(kind: str) -> Callable[[bytes], bytes]:
    """Return a function that decodes a message of this kind of server."""
    if kind != "viser":
        return lambda data: data
    import zstandard  # viser depends on it

    return lambda data: zstandard.ZstdDecompressor().decompressobj().decompress(data[_VISER_HEAD:])


async def client(url: str, kind: str, subprotocol: str | None, counts: list[float], number: int) -> None:
    protocols = [websockets.Subprotocol(subprotocol)] if subprotocol else None
    marker, read = _MARKERS[kind], reader(kind)
    async with websockets.connect(url, max_size=None, compression=None, subprotocols=protocols) as socket:
        async for message in socket:
            data = message if isinstance(message, bytes) else message.encode()
            if kind == "ours":
                if marker in data[:64]:
                    counts[number] += 1
                    await socket.send("k")
            else:
                counts[number] += read(data).count(marker) / _NODES


async def main(url: str, count: int, kind: str, subprotocol: str | None) -> None:
    counts = [0.0] * count

    def answer() -> None:
        for _ in sys.stdin:
            print(json.dumps(counts), flush=True)

    threading.Thread(target=answer, daemon=True).start()
    await asyncio.gather(*(client(url, kind, subprotocol, counts, number) for number in range(count)))


if __name__ == "__main__":
    address, many, which, *rest = sys.argv[1:]
    asyncio.run(main(address, int(many), which, rest[0] if rest and rest[0] else None))
