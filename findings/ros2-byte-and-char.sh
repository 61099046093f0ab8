#!/usr/bin/env bash
# Package: mcap-ros2-support 0.6.0 and rosbags 0.11.9 (Python), beside @foxglove/rosmsg 5.0.5 (npm, the reader of Foxglove).
# Wrong belief: readers of ROS 2's messages agree on the primitive types.
# Behaviour: of `byte` and `char` rosidl makes octet and uint8, both from 0 to 255, and so does Foxglove. rosbags takes `byte` for int8,
#   as it is in ROS 1, and mcap-ros2-support takes `char` for int8; each is right where the other one is wrong.
# Why it matters: identifiers (rmw_dds_common/Gid in Humble), masks and states are negative from 128 on, in one program only.
# Seen 2026-12-01: one message with 200 in three fields: -56 as `byte` in rosbags, -56 as `char` in mcap-ros2-support.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cd "$folder"
python3 -m venv venv
venv/bin/pip install --quiet --disable-pip-version-check mcap-ros2-support==0.6.0 rosbags==0.11.9 mcap==1.6.0 numpy==2.4.6 \
  apsw==3.54.1.0 backports.zstd==1.8.0 lz4==4.4.5 ruamel.yaml==0.19.1 typing_extensions==4.16.0 zstandard==0.25.0
npm install --silent --no-audit --no-fund @foxglove/rosmsg@5.0.5 @foxglove/rosmsg2-serialization@3.1.0 > /dev/null
printf 'uint8 a\nbyte b\nchar c\n' > State.msg
printf '\0\1\0\0\310\310\310' > state.cdr # 4 bytes of CDR's header, and 200 three times

venv/bin/python - <<'PYTHON'
from pathlib import Path

from mcap.records import Schema
from mcap_ros2.decoder import DecoderFactory
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

definition, data, name = Path("State.msg").read_text(), Path("state.cdr").read_bytes(), "test_msgs/msg/State"
store = get_typestore(Stores.ROS2_HUMBLE)
store.register(get_types_from_msg(definition, name))
decode = DecoderFactory().decoder_for("cdr", Schema(id=1, name=name, encoding="ros2msg", data=definition.encode()))
seen = {}
for package, message in (("rosbags", store.deserialize_cdr(data, name)), ("mcap-ros2-support", decode(data))):
    seen[package] = [message.a, message.b, message.c]
print(seen)
assert seen == {"rosbags": [200, -56, 200], "mcap-ros2-support": [200, 200, -56]}
PYTHON
cat > foxglove.mjs <<'JAVASCRIPT'
import assert from 'node:assert'
import fs from 'node:fs'
import rosmsg from '@foxglove/rosmsg'
import serialization from '@foxglove/rosmsg2-serialization'

const definitions = rosmsg.parse(fs.readFileSync('State.msg', 'utf8'), { ros2: true })
const message = new serialization.MessageReader(definitions).readMessage(fs.readFileSync('state.cdr'))
console.log(message)
assert.deepStrictEqual([message.a, message.b, message.c], [200, 200, 200])
JAVASCRIPT
node foxglove.mjs
