"""A machine on a LAN and another one, as two network namespaces: ``unshare -Urn python -m tests.runtime.lcm.lan``.

The first one receives with ttl=0. Prints what it has received, and its counters, as JSON.
"""

import asyncio
import json
import logging
import os
import socket
import struct
import subprocess
import sys
import time
from pathlib import Path

from gateway.runtime.lcm.config import LcmConfig
from scenegate.lcm import udpm
from scenegate.lcm.udpm_transport import UdpmTransport
from tests.support.waiting import until

GROUP, PORT = "239.255.76.67", 7667
OURS, THEIRS = "10.9.0.1", "10.9.0.2"


def main() -> None:
    """Connect the namespaces, and run both sides."""
    other = subprocess.Popen(["unshare", "-n", "cat"], stdin=subprocess.PIPE)
    own = Path("/proc/self/ns/net").readlink()
    while not (theirs := Path(f"/proc/{other.pid}/ns/net")).exists() or theirs.readlink() == own:
        time.sleep(0.01)  # until the process is in its namespace
    here = f"ip link set lo up; ip link add va type veth peer name vb netns {other.pid}; {address('va', OURS)}"
    there = f"ip link set lo up; {address('vb', THEIRS)}"
    subprocess.run(["sh", "-ec", here], check=True)
    subprocess.run(["nsenter", "-t", str(other.pid), "-n", "sh", "-ec", there], check=True)
    print(json.dumps(asyncio.run(receive(other.pid))))
    other.communicate(b"")


def address(device: str, ip: str) -> str:
    return f"ip addr add {ip}/24 dev {device}; ip link set {device} up; ip route add 224.0.0.0/4 dev {device}"


async def receive(other: int) -> dict[str, object]:
    received: list[tuple[str, bool]] = []
    logs: list[str] = []
    handler = logging.Handler()
    handler.emit = lambda record: logs.append(record.getMessage())  # type: ignore[method-assign]  # in a child
    logging.getLogger("scenegate.lcm").addHandler(handler)
    try:
        transport = UdpmTransport(f"udpm://{GROUP}:{PORT}?ttl=0", ("",), LcmConfig(), 1 << 20)
        transport.start(lambda message: received.append((message.channel, message.is_local)), lambda: None)
        sending = ["nsenter", "-t", str(other), "-n", sys.executable, "-m", "tests.runtime.lcm.lan", "send"]
        await asyncio.to_thread(subprocess.run, sending, check=True)
        transport.publish("own", b"x")
        await until(lambda: received)
        await until(lambda: transport.foreign == 2)
        await transport.close()
    finally:
        logging.getLogger("scenegate.lcm").removeHandler(handler)
    return {"received": received, "foreign": transport.foreign, "logs": logs}


def send() -> None:
    """Send datagrams of this machine, and frames that claim to come from the other one."""
    sock = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    for source in (OURS, "127.0.0.1", "0.0.0.0", THEIRS):  # the kernel drops the first three
        send_frame(source, datagram(source))
    sock.sendto(datagram("other"), (GROUP, PORT))


def datagram(channel: str) -> bytes:
    return b"".join(b"".join(pieces) for pieces in udpm.datagrams(channel, b"x", 1))


def send_frame(source: str, payload: bytes) -> None:
    """Send an Ethernet frame with a UDP datagram from ``source``."""
    addresses = map(socket.inet_aton, (source, GROUP))
    head = struct.pack(">BBHHHBBH4s4s", 0x45, 0, 28 + len(payload), 1, 0, 1, 17, 0, *addresses)
    total = sum(struct.unpack(">10H", head))
    total = (total & 0xFFFF) + (total >> 16)
    head = head[:10] + struct.pack(">H", ~total & 0xFFFF) + head[12:]
    frame = b"\x01\x00\x5e\x7f\x4c\x43" + b"\x02" + os.urandom(5) + b"\x08\x00" + head
    raw = socket.socket(socket.AF_PACKET, socket.SOCK_RAW)
    raw.bind(("vb", 0))
    raw.send(frame + struct.pack(">HHHH", 7667, PORT, 8 + len(payload), 0) + payload)


if __name__ == "__main__":
    send() if "send" in sys.argv else main()
