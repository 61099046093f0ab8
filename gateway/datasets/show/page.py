"""HTML of the pages: the grid of samples, and one sample."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from html import escape
from typing import Final
from urllib.parse import urlencode

import numpy as np

from gateway.datasets.show.overlay import LAYERS, SHOWN_TYPES, Layer, class_color
from gateway.datasets.show.summary import Histogram, Summary
from scenegate.datasets import Dataset, Sample
from scenegate.datasets.manifest import ImageType

PAGE_SAMPLES: Final = 24
"""Number of samples on a page of the grid."""
THUMBNAIL_WIDTH: Final = 320
LARGE_WIDTH: Final = 960
"""Width of the image of a single sample in pixels."""
BAR_HEIGHT: Final = 60
"""Height of a histogram in pixels."""


@dataclass(frozen=True, slots=True)
class Selection:
    """Layers, image and samples that an address selects."""

    layers: tuple[Layer, ...]
    image: ImageType | None
    """Type of the image below the layers; None: the first one of each sample."""
    class_id: int | None
    """Only samples with a visible object of this class; None: all."""
    page: int
    """Number of the page, from 0."""

    def query(self, **changes: object) -> str:
        """Return the query of an address with these choices and changes."""
        fields = {"layer": [*self.layers, "none"], "image": self.image, "class": self.class_id, "page": self.page}
        chosen = {name: value for name, value in (fields | changes).items() if value is not None}
        return "?" + urlencode(chosen, doseq=True)


def grid_page(dataset: Dataset, summary: Summary, selection: Selection) -> str:
    """Return the page with the selected samples, and the distributions of all objects."""
    indices = summary.sample_indices
    if selection.class_id is not None:
        indices = summary.samples_by_class.get(selection.class_id, ())
    begin = selection.page * PAGE_SAMPLES
    cells = (
        f'<a class="cell" href="sample/{index}{escape(selection.query())}">'
        f"{_image(index, selection, THUMBNAIL_WIDTH)}<span>{escape(dataset[index].id)}</span></a>"
        for index in indices[begin : begin + PAGE_SAMPLES]
    )
    partial = f" ({len(summary.sample_indices)} chosen at random)" if len(summary.sample_indices) < len(dataset) else ""
    objects = sum(summary.objects_by_class.values())
    count = f"{len(indices)} of {len(dataset)} samples{partial}, {objects} objects in all"
    pages = -(-len(indices) // PAGE_SAMPLES)
    links = _page_link(selection, -1, "Previous", pages) + f"<span>{selection.page + 1} / {max(pages, 1)}</span>"
    links += _page_link(selection, 1, "Next", pages)
    body = (
        f"<header><h1>{escape(dataset.folder.absolute().name)}</h1><p>{count}</p>{_form(dataset, selection)}</header>"
        f"<section>{_classes(dataset, summary, selection)}{''.join(map(_histogram, summary.histograms))}</section>"
        f"<main>{''.join(cells) or '<p>No sample has an object of this class.</p>'}</main><nav>{links}</nav>"
    )
    return _document(dataset.folder.absolute().name, body, "")


def sample_page(dataset: Dataset, number: int, selection: Selection) -> str:
    """Return the page of a sample with the records of its objects."""
    sample = dataset[number]
    neighbours = (
        f'<a class="button" href="{k}{escape(selection.query())}" rel="{rel}">{text}</a>'
        for k, rel, text in ((number - 1, "prev", "Previous"), (number + 1, "next", "Next"))
        if 0 <= k < len(dataset)
    )
    body = (
        f"<header><h1>{escape(sample.id)}</h1>{_form(dataset, selection)}</header>"
        f'<nav><a class="button" href="../{escape(selection.query())}">All samples</a>{"".join(neighbours)}</nav>'
        f"<article>{_image(number, selection, LARGE_WIDTH, '../')}{_objects(dataset, sample)}</article>"
    )
    return _document(sample.id, body, "../")


def _document(title: str, body: str, root: str) -> str:
    return (
        '<!doctype html><html lang="en"><meta charset="utf-8"><meta name="viewport" content="width=device-width">'
        f'<meta name="color-scheme" content="light dark"><title>{escape(title)}</title><link rel="icon" href="data:,">'
        f'<link rel="stylesheet" href="{root}static/show.css"><script defer src="{root}static/show.js"></script>'
        f"<body>{body}</body></html>"
    )


def _form(dataset: Dataset, selection: Selection) -> str:
    """Return the choice of layers and of the image; the script sends it on each change."""
    boxes = "".join(
        f'<label><input type="checkbox" name="layer" value="{layer}"{" checked" * (layer in selection.layers)}>'
        f"{layer.capitalize()}</label>"
        for layer in LAYERS
    )
    options = "".join(
        f"<option{' selected' * (name == selection.image)}>{name}</option>"
        for name in SHOWN_TYPES
        if name in dataset.description.settings.types
    )
    hidden = "" if selection.class_id is None else f'<input type="hidden" name="class" value="{selection.class_id}">'
    return (
        '<form><input type="hidden" name="layer" value="none">'
        f'<input type="hidden" name="page" value="{selection.page}">{hidden}{boxes}'
        f'<label>Image <select name="image">{options}</select></label>'
        "<noscript><button>Show</button></noscript></form>"
    )


def _classes(dataset: Dataset, summary: Summary, selection: Selection) -> str:
    """Return the classes as filters, with bars of their numbers of objects."""
    most = max(summary.objects_by_class.values(), default=1)
    rows = [_class_row(selection, None, "All classes", "", 0.0)] if dataset.classes else []
    for class_id, name in dataset.classes.items():
        count = summary.objects_by_class.get(class_id, 0)
        rows.append(_class_row(selection, class_id, name, str(count), count / most))
    return f'<figure class="classes"><figcaption>Classes</figcaption>{"".join(rows)}</figure>' if rows else ""


def _class_row(selection: Selection, class_id: int | None, name: str, count: str, share: float) -> str:
    current = ' aria-current="true"' if class_id == selection.class_id else ""
    color = "none" if class_id is None else "rgb({},{},{})".format(*class_color(class_id))
    bar = f'<svg width="72" height="10"><rect width="{72 * share:.1f}" height="10" fill="{color}"/></svg>'
    query = escape(selection.query(**{"class": class_id, "page": 0}))
    return f'<a href="{query}"{current}>{bar}<span>{escape(name)}</span><span>{count}</span></a>'


def _histogram(histogram: Histogram) -> str:
    most = max(histogram.counts) or 1
    bars = "".join(
        f'<rect x="{12 * k}" y="{BAR_HEIGHT * (1 - count / most):.1f}" width="10" '
        f'height="{BAR_HEIGHT * count / most:.1f}"><title>{count}</title></rect>'
        for k, count in enumerate(histogram.counts)
    )
    width = 12 * len(histogram.counts)
    return (
        f"<figure><figcaption>{histogram.title}</figcaption>"
        f'<svg width="{width}" height="{BAR_HEIGHT}" role="img">{bars}</svg>'
        f"<p><span>{histogram.low:.3g}</span><span>{histogram.high:.3g} {histogram.unit}</span></p></figure>"
    )


def _image(number: int, selection: Selection, width: int, root: str = "") -> str:
    query = escape(selection.query(**{"class": None, "page": None, "width": width}))
    return f'<img src="{root}image/{number}{query}" width="{width}" loading="lazy" alt="">'


def _page_link(selection: Selection, step: int, text: str, pages: int) -> str:
    page = selection.page + step
    return f'<a class="button" href="{escape(selection.query(page=page))}">{text}</a>' if 0 <= page < pages else ""


def _objects(dataset: Dataset, sample: Sample) -> str:
    head = "".join(
        f"<th>{name}" for name in ("#", "Class", "Model", "Distance", "Visible", "Truncated", "Visible box", "Node")
    )
    rows: Iterable[str] = (
        "<tr>"
        + "".join(
            f"<td>{escape(str(value))}"
            for value in (
                record.instance,
                dataset.classes.get(record.class_id, record.class_id),
                record.model,
                f"{np.linalg.norm(np.array(record.X_camera_object)[:3, 3]):.3f} m",
                f"{record.visible_fraction:.1%}, {record.visible_pixels} px",
                f"{record.truncation:.1%}",
                "–" if record.box_visible is None else "{}, {}, {} × {}".format(*record.box_visible),
                "/".join(map(str, record.path)),
            )
        )
        for record in sample.objects
    )
    return f"<table><tr>{head}{''.join(rows)}</table>"
