#!/usr/bin/env bash
# Package: netCDF4 1.7.5.1.post1, also as an engine of xarray 2026.9.0, beside h5netcdf 1.8.2, on HDF5 files of h5py 3.16.0.
# Wrong belief: an HDF5 file gives the same arrays by both of xarray's engines, and netCDF4 hides values only where an attribute says so.
# Behaviour: netCDF4 reads booleans as int8, h5netcdf as bool; `netCDF4.Dataset` itself also masks 65535 of uint16 and 4294967295 of
#   uint32, NetCDF's defaults for what was never written, in files that never were NetCDF (xarray does not).
# Why it matters: `depth[mask]` is rows 0 and 1 in place of the pixels of an object, `~mask` is true everywhere, both without an
#   error; saturated pixels and labels of "none" are missing from sums and means.
# Seen 2026-12-01: of a 4 x 4 image with a mask of two pixels, (4, 4, 4) values in place of 2; the mean of 1 and 65535 is 1.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cd "$folder"
python3 -m venv venv
venv/bin/pip install --quiet --disable-pip-version-check netCDF4==1.7.5.1.post1 h5netcdf==1.8.2 h5py==3.16.0 xarray==2026.9.0 numpy==2.4.6 \
  certifi==2026.10.19.post1 cftime==1.6.6.1 packaging==26.4 pandas==3.1.1 python-dateutil==4.0.0 six==1.17.0 tzdata==2026.6
venv/bin/python - <<'PYTHON'
import h5py
import netCDF4
import numpy as np
import xarray

depth = np.arange(16.0).reshape(4, 4)
mask = np.zeros((4, 4), bool)
mask[1, 1:3] = True
with h5py.File("sample.h5", "w") as file:
    file["depth"], file["mask"] = depth, mask
    file["level"] = np.array([1, 65535], np.uint16)

for engine, options, dtype in (("h5netcdf", {"phony_dims": "sort"}, bool), ("netcdf4", {}, np.int8)):
    with xarray.open_dataset("sample.h5", engine=engine, **options) as sample:
        read, image = sample["mask"].values, sample["depth"].values
        assert sample["level"].values.tolist() == [1, 65535]
    print(engine, read.dtype, "depth[mask]:", image[read].shape, "~mask:", int((~read).astype(bool).sum()), "of 16")
    assert read.dtype == dtype and np.array_equal(read, mask)
    assert image[read].shape == ((2,) if dtype is bool else (4, 4, 4))
with netCDF4.Dataset("sample.h5") as file:
    level = file["level"][:]
    print("netCDF4", file["mask"].dtype, level, level.mean())
    assert file["level"].ncattrs() == [] and level.mask.tolist() == [False, True] and level.mean() == 1
PYTHON
