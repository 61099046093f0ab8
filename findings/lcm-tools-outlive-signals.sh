#!/usr/bin/env bash
# Package: lcm 1.5.3 from PyPI: lcm-logger, lcm-logplayer and its other commands.
# Wrong belief: SIGTERM and SIGINT end lcm-logger, which writes what it has received, as LCM's own program does.
# Behaviour: the command is a Python program that starts LCM's. SIGTERM ends it alone: the logger goes on writing, the
#   player goes on publishing. SIGINT lets it kill the logger after a quarter of a second, with what is not flushed yet.
# Why it matters: kill, subprocess.terminate() and supervisord signal the command alone: a replay goes on driving the robot
#   although it was stopped, and a log gets the messages of the next experiment. Ctrl+C in a terminal and the command
#   timeout signal both, and are safe.
# Seen 2026-11-30: after SIGTERM of the command, the log gets 5 more messages; after SIGINT, 2 s behind a burst of 20, it
#   has 1 of them. LCM's program, signalled itself, writes all 20.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cd "$folder"
python3 -m venv venv
venv/bin/pip install --quiet --disable-pip-version-check lcm==1.5.3

venv/bin/python - <<'PYTHON'
import os
import signal
import subprocess
import time
from pathlib import Path

import lcm

URL = f"udpm://239.255.76.67:{20000 + os.getpid() % 20000}?ttl=0"  # of this run alone; needs a route for multicast
COMMAND = "venv/bin/lcm-logger"
(PROGRAM,) = Path("venv").glob("lib/python*/site-packages/bin/lcm-logger")
sender = lcm.LCM(URL)


def children(pid: int) -> list[int]:
    return [int(each) for each in Path(f"/proc/{pid}/task/{pid}/children").read_text().split()]


def logger(program: Path | str) -> subprocess.Popen:
    process = subprocess.Popen([program, "-f", "-q", f"--lcm-url={URL}", "log.lcmlog"])
    time.sleep(2)
    return process


def publish(count: int) -> None:
    for _ in range(count):
        sender.publish("SAMPLES", bytes(100))
    time.sleep(2)


def logged() -> int:
    return sum(1 for _ in lcm.EventLog("log.lcmlog"))


process = logger(COMMAND)
(child,) = children(process.pid)
process.terminate()
print("exit code of the command after SIGTERM:", process.wait(10))
for _ in range(5):
    publish(1)
after_sigterm = logged()
print("messages logged after its end:", after_sigterm)
os.kill(child, signal.SIGINT)

counts = {}
for program in (COMMAND, PROGRAM):
    time.sleep(1)
    process = logger(program)
    publish(20)
    process.send_signal(signal.SIGINT)
    process.wait(10)
    counts[program] = logged()
    print(f"{program}: {counts[program]} of 20 after SIGINT")
assert after_sigterm >= 4
assert counts[COMMAND] < 20 == counts[PROGRAM]
PYTHON
