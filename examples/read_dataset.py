"""Reads a dataset as a training job does, and puts one sample's depth back into the world as labelled points.

    scenegate render scenes/ -o out/ --type color,depth,label --orbit 12
    python examples/read_dataset.py [out] [POINTS.npz]

``scenegate-client[images]`` is enough.
"""

import sys

import numpy as np

from scenegate.datasets import NO_LABEL, Dataset

folder = sys.argv[1] if len(sys.argv) > 1 else "out"
file = sys.argv[2] if len(sys.argv) > 2 else "points.npz"

dataset = Dataset(folder)
print(f"{len(dataset)} samples of {len(dataset.scenes)} scenes")

# A loader for training: samples can be picked by index, so any framework can shuffle and batch them.
rng = np.random.default_rng(0)
for index in rng.permutation(len(dataset))[:4]:
    sample = dataset[int(index)]
    foreground = (sample.label != NO_LABEL).mean()
    print(f"{sample.id}: {sample.color.shape}, {foreground:.0%} foreground, focal length {sample.K[0, 0]:.1f} pixels")

sample = dataset[0]
depth = sample.depth
seen = np.isfinite(depth)
in_camera = (sample.rays * depth[..., None])[seen]
X = sample.X_world_camera
points = in_camera @ X[:3, :3].T + X[:3, 3]
names = dataset.labels(sample.record.scene)
for label in np.unique(sample.label[seen]):
    here = points[sample.label[seen] == label]
    print(f"label {label}, {names.get(int(label), '?')}: {len(here)} points around {here.mean(axis=0).round(3)}")
np.savez(file, points=points, colors=sample.color[seen], labels=sample.label[seen])
print(file)
