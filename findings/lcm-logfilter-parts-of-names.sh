#!/usr/bin/env bash
# Package: lcm 1.5.3.
# Wrong belief: lcm-logfilter's -c takes the channels that a subscription to the same expression gets.
# Behaviour: it takes each channel of which a part matches; LCM.subscribe and lcm-logplayer's -e match the whole name.
# Why it matters: `lcm-logfilter -i -c CAMERA run.log small.log`, to leave the images out, also leaves out CAMERA_INFO and
#   LEFT_CAMERA_POSE; -c POSE keeps POSE_GROUND_TRUTH beside POSE. Whole names are '^POSE$'.
# Seen 2026-11-30: of the channels POSE, POSE_TRUTH and OTHER_POSE, -c POSE copies all, a subscription to POSE gets one.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cd "$folder"
python3 -m venv venv
venv/bin/pip install --quiet --disable-pip-version-check lcm==1.5.3

cat >write.py <<'PYTHON'
from lcm import EventLog

log = EventLog("run.lcmlog", "w", overwrite=True)
for number, channel in enumerate(("POSE", "POSE_TRUTH", "OTHER_POSE")):
    log.write_event(1_700_000_000_000_000 + number, channel, b"data")
log.close()
PYTHON
cat >read.py <<'PYTHON'
from lcm import LCM, EventLog

filtered = sorted(event.channel for event in EventLog("filtered.lcmlog"))
played = []
log = LCM("file://run.lcmlog?speed=0")
log.subscribe("POSE", lambda channel, data: played.append(channel))
for _ in range(3):
    log.handle_timeout(100)
print("lcm-logfilter -c POSE:", filtered, "subscribe('POSE'):", played)
assert filtered == ["OTHER_POSE", "POSE", "POSE_TRUTH"]
assert played == ["POSE"]
PYTHON
venv/bin/python write.py
venv/bin/lcm-logfilter -c POSE run.lcmlog filtered.lcmlog
venv/bin/python read.py
