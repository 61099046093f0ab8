"""``scenegate dataset show``: samples of a dataset as one HTML file, which a browser opens from a disk.

Each sample is a thumbnail with the visible masks and boxes of its objects, in colours of their classes. A menu shows
the samples with one class. Nothing is loaded from elsewhere.
"""

import base64
import colorsys
import io
from collections import Counter
from collections.abc import Iterator
from html import escape
from typing import Final

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from scenegate.datasets import NO_LABEL, Dataset, RecordError, Sample
from scenegate.datasets.manifest import ImageType

SHOWN_TYPES: Final[tuple[ImageType, ...]] = (
    "color", "stereo", "albedo", "normal", "depth", "measured", "instance", "class", "label",
)  # fmt: skip
"""Types of images that can be shown; a thumbnail is of the first one that the sample has."""
WIDTH: Final = 320
"""Width of a thumbnail, pixels."""
JPEG_QUALITY: Final = 85
_GOLDEN_ANGLE: Final = 0.381966
"""Turn between the hues of two successive classes, so that any number of them differ."""
_HEAD: Final = """<!doctype html>
<html lang="en"><head><meta charset="utf-8"><meta name="viewport" content="width=device-width">
<meta name="color-scheme" content="light dark"><title>{title}</title>
<meta http-equiv="Content-Security-Policy" content="default-src 'none'; img-src data:; style-src 'unsafe-inline'; \
script-src 'unsafe-inline'">
<style>
body {{ font: 14px system-ui, sans-serif; margin: 0 16px 16px }}
header {{ position: sticky; top: 0; background: Canvas; padding: 12px 0; display: flex; gap: 16px; flex-wrap: wrap; \
align-items: baseline; z-index: 1 }}
h1 {{ font-size: 17px; margin: 0 8px 0 0 }}
main {{ display: grid; grid-template-columns: repeat(auto-fill, minmax(320px, 1fr)); gap: 12px }}
figure {{ margin: 0 }} figure > div {{ position: relative; background: #8884; min-height: 40px }}
figure img, figure svg {{ width: 100%; display: block }} .masks, .boxes {{ position: absolute; inset: 0 }}
.masks {{ opacity: .5; image-rendering: pixelated }}
rect {{ fill: none; stroke-width: 1.5; vector-effect: non-scaling-stroke }}
figcaption {{ overflow-wrap: anywhere; opacity: .8; padding: 2px 0 }}
body:not(:has(#masks:checked)) .masks, body:not(:has(#boxes:checked)) .boxes, .hidden {{ display: none }}
</style></head><body>
"""
_SCRIPT: Final = """<script>
document.querySelector("select").onchange = (event) => {
  const wanted = event.target.value;
  for (const each of document.querySelectorAll("[data-classes]")) {
    each.classList.toggle("hidden", wanted !== "" && !each.dataset.classes.split(" ").includes(wanted));
  }
};
</script></body></html>
"""


def contact_sheet(dataset: Dataset, count: int) -> str:
    """Return an HTML page of ``count`` samples, random but equal for each call. Raises RecordError, ValueError."""
    if not len(dataset):
        raise ValueError(f"{dataset.folder} has no samples")
    # Evenly spaced samples could all be of one camera.
    chosen = np.sort(np.random.default_rng(0).choice(len(dataset), min(count, len(dataset)), replace=False))
    samples = [dataset[int(index)] for index in chosen]
    title = escape(dataset.folder.resolve().name)
    return "".join((_HEAD.format(title=title), _header(title, dataset, samples), *map(_figure, samples), _SCRIPT))


def class_color(class_id: int) -> tuple[int, int, int]:
    """Return the RGB colour in which objects of a class are drawn."""
    red, green, blue = colorsys.hsv_to_rgb(class_id * _GOLDEN_ANGLE % 1.0, 0.65, 0.95)
    return round(255 * red), round(255 * green), round(255 * blue)


def _header(title: str, dataset: Dataset, samples: list[Sample]) -> str:
    objects = Counter(record.class_id for sample in samples for record in sample.objects)
    options = "".join(
        f'<option value="{class_id}">{escape(name)} ({objects[class_id]} objects)</option>'
        for class_id, name in dataset.classes.items()
    )
    return (
        f"<header><h1>{title}</h1><span>{len(samples)} of {len(dataset)} samples</span>"
        '<label><input type="checkbox" id="masks" checked> masks</label>'
        '<label><input type="checkbox" id="boxes" checked> boxes</label>'
        f'<select aria-label="Class"><option value="">all classes</option>{options}</select></header><main>'
    )


def _figure(sample: Sample) -> str:
    """Return a thumbnail with its overlays; a text in their place if an image cannot be shown."""
    visible = [record for record in sample.objects if record.visible_pixels]
    classes = " ".join(str(class_id) for class_id in sorted({record.class_id for record in visible}))
    try:
        content = "".join(_layers(sample))
    except RecordError as error:
        content = escape(str(error))
    return f'<figure data-classes="{classes}"><div>{content}</div><figcaption>{escape(sample.id)}</figcaption></figure>'


def _layers(sample: Sample) -> Iterator[str]:
    """Yield the image, the masks and the boxes of a sample. Raises RecordError if an image cannot be read or shown."""
    camera = sample.record.camera
    image_type = next((name for name in SHOWN_TYPES if name in sample.record.images), SHOWN_TYPES[0])
    size = WIDTH, max(1, round(WIDTH * camera.height / camera.width))
    image = Image.fromarray(_pixels(sample, image_type)).resize(size, Image.Resampling.BOX)
    yield f'<img loading="lazy" alt="" src="{_data_url(image, "JPEG", quality=JPEG_QUALITY)}">'
    if "instance" in sample.record.images:
        masks = Image.fromarray(_class_masks(sample)).resize(size, Image.Resampling.NEAREST)
        yield f'<img class="masks" alt="" src="{_data_url(masks, "PNG")}">'
    boxes = "".join(
        '<rect x="{}" y="{}" width="{}" height="{}" stroke="rgb{}"><title>{}</title></rect>'.format(
            *record.box_visible, class_color(record.class_id), escape(f"{record.model}: {record.visible_fraction:.0%}")
        )
        for record in sample.objects
        if record.box_visible is not None
    )
    yield f'<svg class="boxes" viewBox="0 0 {camera.width} {camera.height}">{boxes}</svg>'


def _data_url(image: Image.Image, file_format: str, **options: int) -> str:
    data = io.BytesIO()
    image.save(data, file_format, **options)
    return f"data:image/{file_format.lower()};base64,{base64.b64encode(data.getvalue()).decode()}"


def _pixels(sample: Sample, image_type: ImageType) -> NDArray[np.uint8]:
    """Return an image in RGB, (H, W, 3): depth from light, near, to dark, numbers in colours."""
    pixels = sample.image(image_type)
    if image_type in ("depth", "measured"):
        seen = np.isfinite(pixels)
        near, far = (pixels[seen].min(), pixels[seen].max()) if seen.any() else (0.0, 1.0)
        shade = np.where(seen, 230.0 - 200.0 * (np.where(seen, pixels, near) - near) / max(far - near, 1e-6), 0.0)
        return np.repeat(shade.astype(np.uint8)[..., None], 3, axis=2)
    if image_type == "normal":
        return (127.5 + 127.5 * pixels).astype(np.uint8)
    if image_type in ("instance", "class", "label"):
        values, inverse = np.unique(pixels, return_inverse=True)
        colors = [(0, 0, 0) if value in (0, NO_LABEL) else class_color(int(value)) for value in values]
        colored: NDArray[np.uint8] = np.array(colors, np.uint8)[inverse.reshape(pixels.shape)]
        return colored
    return np.asarray(pixels, np.uint8)


def _class_masks(sample: Sample) -> NDArray[np.uint8]:
    """Return the visible pixels of the objects in the colours of their classes, RGBA, (H, W, 4)."""
    colors = np.zeros((1 << 16, 4), np.uint8)  # instances have 16 bits
    for record in sample.objects:
        colors[record.instance] = (*class_color(record.class_id), 255)
    colors[0] = 0
    masks: NDArray[np.uint8] = colors[sample.instance]
    return masks
