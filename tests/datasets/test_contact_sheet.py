"""``scenegate dataset show``: one HTML file that works without a server."""

import re
from pathlib import Path

import pytest
from PIL import Image

from gateway.datasets.check import check_dataset
from gateway.datasets.contact_sheet import contact_sheet
from scenegate.datasets import Dataset, RecordError, manifest
from scenegate.datasets.formats import export
from tests.datasets.analytic import write_dataset
from tests.support.browser import chromium, new_page
from tests.support.command import scenegate


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_dataset(tmp_path_factory.mktemp("show") / "out")


def test_every_sample_has_a_thumbnail_with_masks_and_boxes(folder: Path) -> None:
    page = contact_sheet(Dataset(folder), 100)
    assert "3 of 3 samples" in page
    for name in ("pile/view-0", "pile/view-1", "single/view-0"):
        assert f"<figcaption>{name}</figcaption>" in page
    assert [page.count(text) for text in ("data:image/jpeg", 'class="masks"', 'class="boxes"')] == [3, 3, 3]
    visible = sum(record.box_visible is not None for sample in Dataset(folder) for record in sample.objects)
    assert page.count("<rect ") == visible > 3
    assert not re.search(r"(src|href)=\"(?!data:)", page), "nothing is loaded"
    assert "1 of 3 samples" in contact_sheet(Dataset(folder), 1)


def test_text_of_a_dataset_is_escaped(tmp_path: Path) -> None:
    folder = write_dataset(tmp_path / "a<b>")
    description = folder / "dataset.json"
    description.write_text(description.read_text().replace("brick", "<script>x"))
    page = contact_sheet(Dataset(folder), 1)
    assert "a&lt;b&gt;" in page
    assert "&lt;script&gt;x" in page


def test_images_that_cannot_be_shown_are_sentences(tmp_path: Path) -> None:
    folder = write_dataset(tmp_path / "out")
    Image.new("RGB", (64, 48)).save(tmp_path / "secret.png")
    lines = folder / "manifest.jsonl"
    lines.write_text(lines.read_text().replace("scenes/pile/view-0.color.png", "../secret.png"))
    page = contact_sheet(Dataset(folder), 100)
    assert "lies outside of the dataset" in page
    assert page.count("data:image/jpeg") == 2


def test_images_above_the_limit_are_not_decoded(folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(manifest, "MAX_IMAGE_PIXELS", 500)
    monkeypatch.setattr(Image.Image, "load", lambda image: pytest.fail("decoded"))
    assert contact_sheet(Dataset(folder), 100).count("500") == 3
    problems = check_dataset(folder, 1, lambda *_: None).problems
    assert sum("500" in problem for problem in problems) == 3 * 5, problems
    with pytest.raises(RecordError, match="500"):
        export(Dataset(folder), tmp_path / "out", "bop")


def test_the_command_writes_a_file_beside_the_folder(folder: Path) -> None:
    result = scenegate("dataset", "show", str(folder))
    assert result.exit_code == 0, result.stderr
    assert folder.with_name("out.html").read_text("utf-8") == contact_sheet(Dataset(folder), 100)
    assert scenegate("dataset", "show", str(folder), "-o", "sheet.png").exit_code != 0


@pytest.mark.browser
def test_the_menu_shows_the_samples_with_a_class(folder: Path, tmp_path: Path) -> None:
    file = tmp_path / "sheet.html"
    file.write_text(contact_sheet(Dataset(folder), 100), "utf-8")
    with chromium() as browser, new_page(browser) as page:
        page.goto(file.as_uri())
        page.select_option("select", "2")
        assert page.locator("figure:visible").count() == 2
        page.select_option("select", "")
        assert page.locator("figure:visible").count() == 3
        assert page.locator(".masks:visible").count() == 3
        page.uncheck("#masks")
        assert [page.locator(name).count() for name in (".masks:visible", ".boxes:visible")] == [0, 3]
