#!/usr/bin/env bash
# Package: protobuf 7.36.2 (upb, its default implementation).
# Wrong belief: message.data of a received image is the bytes object that was parsed, as in the pure Python implementation.
# Behaviour: each time the field is read, all of its bytes are copied into a new object.
# Why it matters: a loop over the rows of an image (message.data[row * step : ...]) copies the whole image for each row,
#   1.2 GB for one of 1280 x 960; a view of the bytes that is kept for each of two uses keeps two copies.
# Seen 2026-11-30: 20 reads of 1 MB that are kept allocate 20 MB, in pure Python nothing.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cd "$folder"
python3 -m venv venv
venv/bin/pip install --quiet --disable-pip-version-check protobuf==7.36.2

cat >reads.py <<'PYTHON'
import tracemalloc

from google.protobuf.internal import api_implementation
from google.protobuf.wrappers_pb2 import BytesValue

message = BytesValue.FromString(BytesValue(value=bytes(1_000_000)).SerializeToString())
tracemalloc.start()
kept = [message.value for _ in range(20)]
allocated = tracemalloc.get_traced_memory()[0]
print(f"{api_implementation.Type()}: {allocated / 1e6:.1f} MB")
if api_implementation.Type() == "upb":
    assert allocated >= 20_000_000
else:
    assert allocated < 100_000
PYTHON
venv/bin/python reads.py | tee upb.txt
PROTOCOL_BUFFERS_PYTHON_IMPLEMENTATION=python venv/bin/python reads.py | tee python.txt
grep -q '^upb' upb.txt
grep -q '^python' python.txt
