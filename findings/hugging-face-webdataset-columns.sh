#!/usr/bin/env bash
# Package: datasets 5.2.0 (Hugging Face).
# Wrong belief: load_dataset("webdataset", …) gives all that is in the shards, or an error.
# Behaviour: the columns are those of the first five samples. What only later samples have (a file, a key of a JSON file)
#   is missing without a warning, and a fraction in a column that began with integers loses its digits: 1.5 is read as 1.
# Why it matters: annotations keyed by object lose objects. Lists of records with the same fields, and floats written as
#   floats, are safe.
# Seen 2026-11-29: the sixth sample is {'score': 1, 'boxes': {'cat': [1, 2]}}, without its further file.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cd "$folder"
python3 -m venv venv
venv/bin/pip install --quiet --disable-pip-version-check datasets==5.2.0

export HF_HOME="$folder" HF_HUB_OFFLINE=1
venv/bin/python - <<'PYTHON'
import io
import json
import tarfile

from datasets import load_dataset

first = {"json": {"score": 1, "boxes": {"cat": [1, 2]}}}
last = {"json": {"score": 1.5, "boxes": {"cat": [1, 2], "dog": [3, 4]}}, "mask.json": {"cat": [5, 6]}}
with tarfile.open("shard.tar", "w") as tar:
    for number, sample in enumerate([first] * 5 + [last]):
        for extension, value in sample.items():
            data = json.dumps(value).encode()
            member = tarfile.TarInfo(f"{number:04d}.{extension}")
            member.size = len(data)
            tar.addfile(member, io.BytesIO(data))
for streaming in (False, True):
    read = list(load_dataset("webdataset", data_files="shard.tar", split="train", streaming=streaming))[-1]
    print(read)
    assert read["json"] == {"score": 1, "boxes": {"cat": [1, 2]}}
    assert "mask.json" not in read
PYTHON
