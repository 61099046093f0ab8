"""The page of a dataset: samples, filters, images; nothing else is served."""

from __future__ import annotations

import io
import re
import subprocess
import sys
from collections.abc import AsyncIterator
from pathlib import Path
from typing import Any

import httpx2
import msgspec
import numpy as np
import pytest
from numpy.typing import NDArray
from PIL import Image

from gateway.datasets.show.app import create_app
from gateway.datasets.show.overlay import CELL_WIDTH, LAYERS, Layer, class_color, contact_sheet, draw_sample
from gateway.datasets.show.page import Selection, grid_page
from gateway.datasets.show.summary import summarize
from scenegate.datasets import Dataset, RecordError, Sample
from tests.datasets.analytic import WIDTH, write_dataset
from tests.support.browser import chromium, new_page, wait_in_page
from tests.support.command import scenegate
from tests.support.waiting import SECONDS


@pytest.fixture(scope="module")
def dataset(tmp_path_factory: pytest.TempPathFactory) -> Dataset:
    return Dataset(write_dataset(tmp_path_factory.mktemp("show") / "out"))


@pytest.fixture
async def client(dataset: Dataset) -> AsyncIterator[httpx2.AsyncClient]:
    transport = httpx2.ASGITransport(create_app(dataset))
    async with httpx2.AsyncClient(transport=transport, base_url="http://127.0.0.1") as client:
        yield client


async def test_the_grid_has_samples_classes_and_distributions(client: httpx2.AsyncClient) -> None:
    page = (await client.get("/")).text
    for text in ("pile/view-0", "pile/view-1", "single/view-0", "brick", "plate", "3 of 3 samples", "Visible fraction"):
        assert text in page
    assert page.count("<img ") == 3


async def test_a_class_selects_samples(client: httpx2.AsyncClient) -> None:
    page = (await client.get("/?class=2")).text
    assert "2 of 3 samples" in page
    assert "single/view-0" not in page
    assert "No sample has" in (await client.get("/?class=77")).text


async def test_layers_are_kept_from_page_to_page(client: httpx2.AsyncClient) -> None:
    page = (await client.get("/?layer=none&layer=boxes&image=depth")).text
    assert page.count(" checked") == 1
    assert "layer=boxes&amp;layer=none&amp;image=depth" in page
    assert "layer=masks" not in page


async def test_a_sample_has_its_objects(client: httpx2.AsyncClient) -> None:
    page = (await client.get("/sample/1")).text
    assert "36.2%, 50 px" in page
    assert "58, 15, 6 × 10" in page
    assert "boxes/1" in page
    assert (await client.get("/sample/3")).status_code == 404
    assert (await client.get("/sample/-1")).status_code == 422


async def test_images(client: httpx2.AsyncClient) -> None:
    response = await client.get("/image/0?width=128&layer=masks")
    assert Image.open(io.BytesIO(response.content)).size == (128, 96)
    again = await client.get("/image/0?width=128&layer=masks", headers={"If-None-Match": response.headers["etag"]})
    assert again.status_code == 304
    plain = await client.get("/image/0?width=128&layer=none")
    assert plain.content != response.content
    for query in ("width=100000", "width=1", "width=128&image=../secret", "width=128&layer=x"):
        assert (await client.get(f"/image/0?{query}")).status_code == 422
    assert (await client.get("/image/99?width=128")).status_code == 404


async def test_images_that_cannot_be_drawn(client: httpx2.AsyncClient) -> None:
    for name in ("flow", "amodal", "normal"):
        response = await client.get(f"/image/0?width=128&image={name}")
        assert response.status_code == 404
        assert response.text == f"pile/view-0 has no {name} image that can be drawn"


async def test_other_hosts_and_other_files_are_refused(client: httpx2.AsyncClient) -> None:
    assert (await client.get("/", headers={"Host": "evil.example"})).status_code == 421
    for path in ("/static/../app.py", "/static/%2e%2e%2fapp.py", "/dataset.json", "/scenes/pile/scene.json"):
        assert (await client.get(path)).status_code == 404
    assert "default-src 'none'" in (await client.get("/")).headers["content-security-policy"]


async def test_an_image_outside_of_the_dataset_is_not_shown(tmp_path: Path) -> None:
    folder = write_dataset(tmp_path / "out")
    Image.new("RGB", (64, 48)).save(tmp_path / "secret.png")
    manifest = folder / "manifest.jsonl"
    manifest.write_text(manifest.read_text().replace("scenes/pile/view-0.color.png", "../secret.png"))
    transport = httpx2.ASGITransport(create_app(Dataset(folder)))
    async with httpx2.AsyncClient(transport=transport, base_url="http://127.0.0.1") as client:
        response = await client.get("/image/0?width=128")
    assert response.status_code == 500
    assert "lies outside of the dataset" in response.text


async def test_names_are_escaped(tmp_path: Path) -> None:
    folder = write_dataset(tmp_path / "out")
    for file in (folder / "manifest.jsonl", folder / "dataset.json"):
        file.write_text(file.read_text().replace("block", "<b>x").replace("brick", "<i>y"))
    transport = httpx2.ASGITransport(create_app(Dataset(folder)))
    async with httpx2.AsyncClient(transport=transport, base_url="http://127.0.0.1") as client:
        for path in ("/", "/sample/0"):
            page = (await client.get(path)).text
            assert "&lt;i&gt;y" in page
            assert "<i>" not in page
            assert "<b>" not in page


def drawn(sample: Sample, width: int, *layers: Layer) -> NDArray[np.int64]:
    return np.asarray(draw_sample(sample, {}, layers, width)).astype(np.int64)


def test_masks_have_the_colours_of_their_classes(dataset: Dataset) -> None:
    sample = dataset[1]
    plain, masks = drawn(sample, WIDTH), drawn(sample, WIDTH, "masks")
    for record in sample.objects:
        inside = np.pad(sample.instance == record.instance, 2)
        shifted = [np.roll(inside, (x, y), (0, 1)) for x in (-2, 0, 2) for y in (-2, 0, 2)]
        inside = np.logical_and.reduce(shifted)[2:-2, 2:-2]  # without the white edge
        assert inside.any()
        mixed = 0.55 * plain[inside] + 0.45 * np.array(class_color(record.class_id))
        assert np.abs(masks[inside] - mixed).max() <= 2
    assert (masks[:5] == plain[:5]).all()


def test_boxes_and_axes_are_at_their_places(dataset: Dataset) -> None:
    sample = dataset[0]
    scale = 8
    plain, boxes = drawn(sample, WIDTH * scale), drawn(sample, WIDTH * scale, "boxes")
    x, y, width, height = sample.objects[1].box_visible or (0, 0, 0, 0)
    color = np.array(class_color(2))
    bottom = boxes[(y + height) * scale, (x + 2) * scale : (x + width - 2) * scale]
    assert np.abs(bottom - color).max(axis=1).min() < 60
    poses = np.abs(drawn(sample, WIDTH * scale, "poses") - plain).sum(axis=-1)
    u, v, w = sample.K @ np.array(sample.objects[0].X_camera_object)[:3, 3]
    assert poses[round(v / w * scale), round(u / w * scale)] > 60  # the origin, where three axes begin


def test_an_object_around_the_camera_is_drawn(dataset: Dataset) -> None:
    sample = dataset[0]
    pose = np.eye(4)
    pose[:3, 3] = (0.0, 0.0, -0.02)
    record = msgspec.structs.replace(sample.objects[0], X_camera_object=tuple(map(tuple, pose.tolist())))
    sample.record = msgspec.structs.replace(sample.record, objects=(record,))  # type: ignore[misc]  # Final
    assert draw_sample(sample, {}, ("poses", "boxes"), 64).size == (64, 48)


@pytest.mark.parametrize(
    "fields",
    [
        {"box_visible": (0, 0, 10**15, 10**15), "box_amodal": (-(10**15), 0, 10**16, 10**15)},
        {"box_visible": (10**30, 10**30, 10**30, 1)},
        {"box_visible": (5, 5, -3, -3)},
        {"X_camera_object": ((1e300, 0.0, 0.0, 1e300),) * 3 + ((0.0, 0.0, 0.0, 1.0),)},
        {"box_3d": ((0.0, 0.0, 0.0), (0.0, 0.0, 0.0))},
        {"instance": -5},
        {"instance": 10**12},
    ],
)
@pytest.mark.filterwarnings("ignore:overflow:RuntimeWarning", "ignore:invalid:RuntimeWarning")
def test_records_that_make_no_sense_are_drawn_quickly(dataset: Dataset, fields: dict[str, Any]) -> None:
    """A box of 10**15 pixels took a minute."""
    sample = dataset[0]
    record = msgspec.structs.replace(sample.objects[0], **fields)
    sample.record = msgspec.structs.replace(sample.record, objects=(record,))  # type: ignore[misc]  # Final
    assert draw_sample(sample, {1: "x" * 100_000}, LAYERS, 128).size == (128, 96)


def test_names_with_line_breaks_are_drawn(tmp_path: Path) -> None:
    folder = write_dataset(tmp_path / "out")
    for file in (folder / "manifest.jsonl", folder / "dataset.json"):
        file.write_text(file.read_text().replace("brick", "a\\nb\\u0000").replace("pile/view-0", "pile/\\nview"))
    dataset = Dataset(folder)
    assert dataset.classes[1] == "a\nb\0"
    assert dataset[0].id == "pile/\nview"
    assert contact_sheet(dataset, 2, LAYERS).width >= 2 * CELL_WIDTH


@pytest.mark.parametrize("width", [0, -5, 10**9])
def test_a_camera_without_a_size_is_refused(tmp_path: Path, width: int) -> None:
    folder = write_dataset(tmp_path / "out")
    path = folder / "manifest.jsonl"
    path.write_text(path.read_text().replace('"width":64', f'"width":{width}'))
    with pytest.raises(RecordError, match=r"manifest.jsonl, line .: Expected `int` .* at `\$.camera.width`"):
        contact_sheet(Dataset(folder), 1, LAYERS)


def test_numbers_of_the_summary(dataset: Dataset) -> None:
    summary = summarize(dataset)
    assert summary.objects_by_class == {1: 3, 2: 2}
    assert summary.samples_by_class == {1: (0, 1, 2), 2: (0, 1)}
    assert [sum(histogram.counts) for histogram in summary.histograms] == [5, 5]
    assert summary.histograms[1].counts[-1] == 3


def test_only_a_part_of_a_large_dataset_is_read(dataset: Dataset, monkeypatch: pytest.MonkeyPatch) -> None:
    from gateway.datasets.show import summary

    monkeypatch.setattr(summary, "MAX_SAMPLES", 2)
    part = summarize(dataset)
    assert len(part.sample_indices) == 2
    assert part == summarize(dataset)
    page = grid_page(dataset, part, Selection((), "color", None, 0))
    assert "2 of 3 samples (2 chosen at random)" in page


def test_the_contact_sheet(dataset: Dataset, tmp_path: Path) -> None:
    sheet = contact_sheet(dataset, 2, LAYERS)
    assert sheet.width >= 2 * CELL_WIDTH
    ran = scenegate("dataset", "show", str(dataset.folder), "--sheet", str(tmp_path / "sheet.jpg"))
    assert ran.exit_code == 0, ran.stderr
    with Image.open(tmp_path / "sheet.jpg") as written:
        assert written.width >= 3 * CELL_WIDTH
    ran = scenegate("dataset", "show", str(dataset.folder), "--sheet", str(tmp_path / "sheet.gif"))
    assert ran.exit_code == 1
    assert "must end in .jpg, .jpeg, .png" in ran.stderr


def test_a_dataset_without_annotations_and_one_without_samples(tmp_path: Path) -> None:
    empty = Dataset(write_dataset(tmp_path / "out", {}))
    assert summarize(empty).histograms == ()
    ran = scenegate("dataset", "show", str(empty.folder), "--sheet", str(tmp_path / "sheet.jpg"))
    assert "has no samples" in ran.stderr


@pytest.mark.browser
@pytest.mark.slow
def test_the_page_in_a_browser(dataset: Dataset) -> None:
    command = [sys.executable, "-m", "scenegate", "dataset", "show", str(dataset.folder), "--port", "0"]
    with chromium() as browser, subprocess.Popen(command, stderr=subprocess.PIPE, text=True) as process:
        try:
            assert process.stderr is not None
            url = re.search(r"http://127\.0\.0\.1:\d+/", process.stderr.readline())
            assert url is not None
            page = new_page(browser)
            faults: list[str] = []
            page.on("console", lambda message: faults.append(message.text))
            page.on("pageerror", lambda error: faults.append(str(error)))
            page.goto(url[0])
            wait_in_page(page, "[...document.images].every((image) => image.complete && image.naturalWidth > 0)")
            page.click("input[value=poses]")
            page.wait_for_url("**layer=masks&layer=boxes&image=color")
            page.click("text=pile/view-1")
            page.wait_for_url("**/sample/1?**")
            page.keyboard.press("ArrowRight")
            page.wait_for_url("**/sample/2?**")
            assert not page.is_checked("input[value=poses]")
            assert faults == []
        finally:
            process.terminate()
        assert process.wait(SECONDS) == 0
