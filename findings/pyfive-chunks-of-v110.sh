#!/usr/bin/env bash
# Package: pyfive 1.3.0; files of h5py 3.16.0.
# Wrong belief: h5py's libver only says how old a library may be; what reads HDF5 files with chunks reads these.
# Behaviour: chunked data sets are read up to libver="v108". From "v110" on, whose chunks have other indices, they raise
#   RuntimeError, with "latest" AssertionError; data sets without chunks are read.
# Why it matters: compressed data sets are chunked, so a file for readers without libhdf5 (browsers, cloud) needs
#   libver="v108" or earlier.
# Seen 2026-11-29: earliest and v108 read; v110, v112, v114 RuntimeError, layout class 4; latest AssertionError.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cd "$folder"
python3 -m venv venv
venv/bin/pip install --quiet --disable-pip-version-check h5py==3.16.0 numpy==2.4.6 pyfive==1.3.0

venv/bin/python - <<'PYTHON'
import h5py
import numpy as np
import pyfive

values = np.arange(12).reshape(3, 4)
for libver in ("earliest", "v108", "v110", "v112", "v114", "latest"):
    with h5py.File(f"{libver}.h5", "w", libver=libver) as file:
        file["plain"] = values
        file.create_dataset("compressed", data=values, chunks=values.shape, compression="gzip")
    with h5py.File(f"{libver}.h5") as file:
        assert (file["compressed"][:] == values).all()
    file = pyfive.File(f"{libver}.h5")
    assert (file["plain"][:] == values).all()
    try:
        result = "read" if (file["compressed"][:] == values).all() else "wrong"
    except (RuntimeError, AssertionError) as error:
        result = repr(error)
    print(libver, result)
    assert (result == "read") == (libver in ("earliest", "v108"))
PYTHON
