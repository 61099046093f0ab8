"""Trains a small detector on a dataset in BOP's format, and draws its boxes on images that it has not seen.

    scenegate render scenes/ -o out --type color,depth,instance,amodal --width 320 --height 240 --orbit 8 --format bop
    python examples/train_detector.py out/bop [boxes.jpg] [STEPS]

Needs torch, numpy and pillow; nothing of Scenegate. 500 steps take two minutes on one core.

A detector of centres (Zhou, Wang, Krähenbühl: Objects as Points, 2019): for each pixel of a map of a quarter of the
size, it predicts for each model whether an object has its centre there, and the size of the object's box.
"""

import json
import sys
import time
from pathlib import Path

import numpy as np
import torch
from PIL import Image, ImageDraw
from torch import nn
from torch.nn import functional
from torch.utils.data import DataLoader, Dataset, RandomSampler, Subset

STRIDE = 4
BATCH = 8
MIN_VISIBLE = 0.25  # share of an object that has to be visible
COLORS = ((230, 70, 60), (60, 120, 230), (240, 180, 40), (60, 170, 90), (160, 80, 200), (90, 200, 210))


class BopBoxes(Dataset):
    """Images of a BOP dataset with the visible boxes of their objects."""

    def __init__(self, folder):
        self.names = {
            int(key): item["model"]
            for key, item in json.loads((folder / "dataset_info.json").read_text())["objects"].items()
        }
        self.images = []
        for scene in sorted((folder / "train_pbr").iterdir()):
            poses = json.loads((scene / "scene_gt.json").read_text())
            infos = json.loads((scene / "scene_gt_info.json").read_text())
            for number in poses:
                boxes = [
                    (pose["obj_id"], *info["bbox_visib"])
                    for pose, info in zip(poses[number], infos[number], strict=True)
                    if info["visib_fract"] >= MIN_VISIBLE
                ]
                (file,) = (scene / "rgb").glob(f"{int(number):06d}.*")
                self.images.append((file, np.array(boxes, np.float32).reshape(-1, 5)))

    def __len__(self):
        return len(self.images)

    def __getitem__(self, index):
        file, boxes = self.images[index]
        pixels = np.asarray(Image.open(file).convert("RGB"), np.float32) / 255.0
        height, width = (size // STRIDE for size in pixels.shape[:2])
        centers = np.zeros((len(self.names), height, width), np.float32)
        sizes, weights = np.zeros((2, height, width), np.float32), np.zeros((1, height, width), np.float32)
        rows, columns = np.mgrid[:height, :width]
        for object_id, x, y, w, h in boxes:
            u, v = (x + w / 2) / STRIDE, (y + h / 2) / STRIDE
            spread = max(w, h) / STRIDE / 6
            bump = np.exp(-((columns + 0.5 - u) ** 2 + (rows + 0.5 - v) ** 2) / (2 * spread**2 + 0.1))
            row, column = min(int(v), height - 1), min(int(u), width - 1)
            bump[row, column] = 1.0
            centers[int(object_id) - 1] = np.maximum(centers[int(object_id) - 1], bump)
            sizes[:, row, column], weights[:, row, column] = (w, h), 1.0
        image = torch.from_numpy(pixels.transpose(2, 0, 1).copy())
        return image, torch.from_numpy(centers), torch.from_numpy(sizes), torch.from_numpy(weights)


class Detector(nn.Module):
    """From (B, 3, H, W) to logits of centres, (B, N, H/4, W/4), and sizes in pixels, (B, 2, H/4, W/4)."""

    def __init__(self, count):
        super().__init__()

        def block(inputs, outputs, stride=1, dilation=1):
            convolution = nn.Conv2d(inputs, outputs, 3, stride, dilation, dilation, bias=False)
            return nn.Sequential(convolution, nn.BatchNorm2d(outputs), nn.ReLU())

        self.body = nn.Sequential(
            block(3, 16, 2), block(16, 32, 2), block(32, 48), block(48, 48, 1, 2), block(48, 48, 1, 4), block(48, 48)
        )
        self.centers = nn.Conv2d(48, count, 1)
        self.sizes = nn.Conv2d(48, 2, 1)
        nn.init.constant_(self.centers.bias, -4.0)

    def forward(self, images):
        features = self.body(images)
        return self.centers(features), 10.0 * functional.softplus(self.sizes(features))


def loss_of(logits, sizes, centers, true_sizes, weights):
    """Focal loss of the centres, and the mean error of the sizes."""
    p = torch.sigmoid(logits).clamp(1e-4, 1 - 1e-4)
    hit = centers == 1.0
    focal = torch.where(hit, (1 - p) ** 2 * p.log(), (1 - centers) ** 4 * p**2 * (1 - p).log())
    count = weights.sum().clamp(min=1)
    return -focal.sum() / count + 0.05 * (weights * (sizes - true_sizes).abs()).sum() / count


@torch.no_grad()
def detect(model, image, threshold=0.35):
    """Return (object id, x, y, width, height, score) of the objects in an image, (3, H, W)."""
    logits, sizes = model(image[None])
    scores = torch.sigmoid(logits)[0]
    peaks = scores * (scores == functional.max_pool2d(scores[None], 5, 1, 2)[0])
    found = []
    for channel, row, column in (peaks > threshold).nonzero().tolist():
        w, h = sizes[0, :, row, column].tolist()
        x, y = (column + 0.5) * STRIDE - w / 2, (row + 0.5) * STRIDE - h / 2
        found.append((channel + 1, x, y, w, h, peaks[channel, row, column].item()))
    return found


def overlap(a, b):
    """Intersection over union of two boxes (x, y, width, height)."""
    width = max(0.0, min(a[0] + a[2], b[0] + b[2]) - max(a[0], b[0]))
    height = max(0.0, min(a[1] + a[3], b[1] + b[3]) - max(a[1], b[1]))
    return width * height / (a[2] * a[3] + b[2] * b[3] - width * height + 1e-9)


def draw(dataset, model, indices, file):
    """Write a picture of images with the boxes that are found."""
    pictures = []
    for index in indices:
        picture = Image.open(dataset.images[index][0]).convert("RGB").resize((480, 360))
        canvas = ImageDraw.Draw(picture)
        scale = 480 / dataset[index][0].shape[2]
        for object_id, *box, score in detect(model, dataset[index][0]):
            x, y, w, h = (value * scale for value in box)
            color = COLORS[object_id % len(COLORS)]
            canvas.rectangle((x, y, x + w, y + h), outline=color, width=3)
            text = f"{dataset.names[object_id]} {score:.0%}"
            canvas.rectangle((x, y - 13, x + canvas.textlength(text) + 6, y), color)
            canvas.text((x + 3, y - 12), text, "black")
        pictures.append(picture)
    sheet = Image.new("RGB", (3 * 488 - 8, 368 * -(-len(pictures) // 3) - 8), "white")
    for k, picture in enumerate(pictures):
        sheet.paste(picture, (k % 3 * 488, k // 3 * 368))
    sheet.save(file, quality=85)


def main():
    dataset = BopBoxes(Path(sys.argv[1]))
    file = sys.argv[2] if len(sys.argv) > 2 else "boxes.jpg"
    steps = int(sys.argv[3]) if len(sys.argv) > 3 else 500
    kept = max(1, len(dataset) // 8)  # the last scenes are not trained on
    train, unseen = Subset(dataset, range(len(dataset) - kept)), range(len(dataset) - kept, len(dataset))
    torch.manual_seed(0)
    model = Detector(len(dataset.names))
    optimizer = torch.optim.AdamW(model.parameters())
    schedule = torch.optim.lr_scheduler.OneCycleLR(optimizer, 4e-3, total_steps=steps)
    chosen = RandomSampler(train, num_samples=steps * BATCH)
    begin = time.monotonic()
    for step, (images, *truth) in enumerate(DataLoader(train, BATCH, sampler=chosen)):
        loss = loss_of(*model(images), *truth)
        optimizer.zero_grad()
        loss.backward()
        optimizer.step()
        schedule.step()
        if step % 50 == 0:
            print(f"{time.monotonic() - begin:4.0f} s, step {step}: loss {loss.item():.2f}", flush=True)
    model.eval()
    right = wrong = total = 0
    for index in unseen:
        true = [tuple(box) for box in dataset.images[index][1].tolist()]
        total += len(true)
        for object_id, *box, _ in detect(model, dataset[index][0]):
            match = next((t for t in true if t[0] == object_id and overlap(t[1:], box) >= 0.5), None)
            right, wrong = right + (match is not None), wrong + (match is None)
            if match is not None:
                true.remove(match)
    print(f"{len(train)} images trained on; in {kept} others {right} of {total} objects found, {wrong} boxes are wrong")
    draw(dataset, model, [*unseen][:: max(1, kept // 6)][:6], file)
    print(file)


if __name__ == "__main__":
    main()
