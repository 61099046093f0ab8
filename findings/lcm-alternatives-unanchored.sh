#!/usr/bin/env bash
# Package: lcm 1.5.3 from PyPI.
# Wrong belief: a subscription's regular expression matches whole channel names, since LCM surrounds it by ^ and $: with
#   "CAMERA|LIDAR" come the channels CAMERA and LIDAR and no other.
# Behaviour: LCM sets the two signs without a group. The first alternative matches names that begin so, the last one names
#   that end so. With a group, "(CAMERA|LIDAR)", all is as believed. The same in udpm, memq and lcm-logger's --channel.
# Why it matters: a handler gets messages of another type, CAMERA_INFO's, and fails to decode them, or a recording has
#   channels that nobody wanted; channels added later by somebody else set it off.
# Seen 2026-11-30: of CAMERA, LIDAR, CAMERA_INFO, OLD_LIDAR and MY_CAMERA, "CAMERA|LIDAR" gets the first four.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cd "$folder"
python3 -m venv venv
venv/bin/pip install --quiet --disable-pip-version-check lcm==1.5.3

venv/bin/python - <<'PYTHON'
import os
import subprocess
import time

import lcm

URL = f"udpm://239.255.76.67:{20000 + os.getpid() % 20000}?ttl=0"  # of this run alone; needs a route for multicast
CHANNELS = ("CAMERA", "LIDAR", "CAMERA_INFO", "OLD_LIDAR", "MY_CAMERA")


def received(url: str, pattern: str) -> list[str]:
    network, channels = lcm.LCM(url), []
    network.subscribe(pattern, lambda channel, _: channels.append(channel))
    time.sleep(0.2)
    for channel in CHANNELS:
        network.publish(channel, b"")
    while network.handle_timeout(500):
        pass
    print(url.partition(":")[0], pattern, channels)
    return channels


def logged(pattern: str) -> list[str]:
    command = ("venv/bin/lcm-logger", "-f", "-q", "--flush-interval=1", f"--channel={pattern}", f"--lcm-url={URL}", "log")
    logger = subprocess.Popen(command)
    time.sleep(2)
    sender = lcm.LCM(URL)
    for _ in range(2):  # the second one's arrival writes what is older than the interval
        for channel in CHANNELS:
            sender.publish(channel, b"")
        time.sleep(2)
    channels = sorted({event.channel for event in lcm.EventLog("log")})
    subprocess.run(("pkill", "-KILL", "-f", URL.replace("?", ".")), check=False)
    logger.wait(10)
    print("lcm-logger", pattern, channels)
    return channels


for url in (URL, "memq://"):
    assert received(url, "CAMERA|LIDAR") == list(CHANNELS[:4])
    assert received(url, "(CAMERA|LIDAR)") == list(CHANNELS[:2])
assert logged("CAMERA|LIDAR") == sorted(CHANNELS[:4])
PYTHON
