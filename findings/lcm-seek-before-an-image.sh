#!/usr/bin/env bash
# Package: lcm 1.5.3 (liblcm and its Python module).
# Wrong belief: EventLog.seek_to_timestamp finds a time in any log that can be read.
# Behaviour: its binary search fails where it lands in the last message, as no other begins after it. In Python, the error is a
#   SystemError about the module itself; afterwards, the log is at its end.
# Why it matters: logs of cameras end with an image or a cloud often enough. If it is larger than all before it, no time is found;
#   in longer logs, those near the end are not, while the same log with one more small message has them all.
# Seen 2026-11-30: 100 messages of 200 bytes and one image of 1.2 MB.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cd "$folder"
python3 -m venv venv
venv/bin/pip install --quiet --disable-pip-version-check lcm==1.5.3

cat >seek.py <<'PYTHON'
from lcm import EventLog

START = 1_700_000_000_000_000
POSE, IMAGE = bytes(200), bytes(1280 * 960)
MIDDLE = START + 50 * 10_000


def found(events):
    log = EventLog("run.lcmlog", "w", overwrite=True)
    for number, data in enumerate(events):
        log.write_event(START + number * 10_000, "CHANNEL", data)
    log.close()
    log = EventLog("run.lcmlog")
    assert [event.timestamp for event in log][50] == MIDDLE, "all can be read in turn"
    try:
        log.seek_to_timestamp(MIDDLE)
    except SystemError as error:
        print(error)
        return None
    return log.read_next_event().timestamp


assert found([POSE] * 100) == MIDDLE
assert found([POSE] * 100 + [IMAGE, POSE]) == MIDDLE
assert found([POSE] * 100 + [IMAGE]) is None
PYTHON
venv/bin/python seek.py
