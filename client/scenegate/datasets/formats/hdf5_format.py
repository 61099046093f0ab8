"""HDF5: one file, ``samples.hdf5``, with a group for each sample, and arrays in it.

    with h5py.File("samples.hdf5") as file:
        sample = file["scene.glb/orbit-000"]
        sample["color"][:], sample["K"][:], sample["objects/X_camera_object"][:]

Arrays are those of ``Sample.arrays``.
"""

import errno
import os
import shutil
from collections.abc import Iterator
from pathlib import Path
from typing import Final

import h5py
import msgspec

from scenegate.datasets.dataset import Dataset, Sample

COMPRESSION: Final = 4
"""Level of deflate: higher ones take twice the time for a few percent."""
_MAX_METADATA_BYTES: Final = 1 << 20
"""Size of what HDF5 writes between two samples besides their arrays; some 30 KB were measured."""


def write(dataset: Dataset, folder: Path, samples: Iterator[Sample]) -> None:
    """Write the samples of a dataset into a folder."""
    with h5py.File(folder / "samples.hdf5", "w", libver="v108") as file:
        file.attrs["classes"] = msgspec.json.encode(dataset.description.classes).decode()
        file.attrs["conventions"] = msgspec.json.encode(dataset.description.conventions).decode()
        for sample in samples:
            arrays = sample.arrays()
            file.flush()
            _check_space(folder, sum(values.nbytes for values in arrays.values()))
            group = _group(file, sample.id)
            if "objects/instance" in arrays:
                _group(group, "objects")
            for name, values in arrays.items():
                if values.dtype.kind == "U":
                    group.create_dataset(name, data=values.tolist(), dtype=h5py.string_dtype())
                elif values.ndim < 2 or not values.size:
                    group[name] = values
                else:  # an array is one chunk: it is read as a whole
                    group.create_dataset(name, data=values, chunks=values.shape, compression=COMPRESSION, shuffle=True)


def _check_space(folder: Path, needed: int) -> None:
    """Raise OSError before the disk is full: HDF5 may end the process if it cannot write."""
    if shutil.disk_usage(folder).free < needed + _MAX_METADATA_BYTES:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))


def _group(parent: h5py.Group, path: str) -> h5py.Group:
    """Return a group. HDF5 gives groups that it creates on the way to another one a time; none of these has one."""
    for name in path.split("/"):
        parent = parent.require_group(name)
    return parent
