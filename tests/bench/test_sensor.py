"""Statistics of the stereo camera's errors on rendered scenes, and the file that the fit writes."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from bench import sensor, sensor_fit, sensor_materials
from bench.sensor_images import Sample, samples
from renderers.stereo.depth.pixel_classes import CLASSES, STATISTICS_FILE, ImageKind, statistics, wrong_spread
from renderers.stereo.model import Quality
from tests.support.corpus import corpus_dir


@pytest.fixture(scope="module")
def scenes() -> list[Sample]:
    return list(samples(Quality.HIGH, 1))


@pytest.mark.slow
@pytest.mark.parametrize("mode", ["modelled", "matched"])
def test_confidence_of_rendered_scenes_is_the_share_of_right_pixels(mode: str, scenes: list[Sample]) -> None:
    unfiltered = [replace(s, settings=replace(s.settings, filters=sensor.NO_FILTERS)) for s in scenes]
    for projector in (False, True):
        pairs = [(s, sensor.MODES[mode](s)) for s in unfiltered if s.projector == projector]
        rows = sensor.reliability(pairs)
        pixels = sum(count for _, _, count in rows)
        for promised, right, count in rows:
            if count > 0.05 * pixels:  # one seed has few pixels of the other confidences
                assert right == pytest.approx(promised, abs=0.1)
        promised, right, count = rows[-1]
        assert count > 0.3 * pixels
        assert right == pytest.approx(promised, abs=0.03)


@pytest.mark.slow
def test_errors_lie_on_surfaces(scenes: list[Sample]) -> None:
    for sample in scenes:
        images = sensor.MODES["modelled"](sample)
        deviation = sensor.deviation_of(sample, images)
        density = float((images.disparity > 0).mean())
        if sample.name == "plain_room" and not sample.projector:
            assert density < 0.1
            continue
        assert density > 0.4
        assert 0.45 < sensor.correlation(deviation) < 0.85
        assert 0.02 < sensor.high_frequency(deviation) < 0.08


@pytest.mark.slow
def test_matching_is_as_dense_at_every_quality() -> None:
    """The streamed pair is matched, scaled to the quality."""
    for quality in (Quality.LOW, Quality.MEDIUM, Quality.HIGH):
        sample = next(sample for sample in samples(quality, 1) if sample.projector)
        assert (sensor.MODES["matched"](sample).disparity > 0).mean() > 0.85


def test_shares_of_rare_classes_are_those_of_their_texture_and_edge() -> None:
    part, whole = np.zeros(CLASSES), np.zeros(CLASSES)
    textured = CLASSES - 1  # the last class: most texture, most disagreement, behind an edge
    whole[textured], part[textured] = 1e6, 2e5
    whole[textured - 3], part[textured - 3] = 1.0, 1.0  # a pixel that disagrees less
    shares = sensor_fit.shares(part, whole)
    assert shares[textured] == pytest.approx(0.2, abs=1e-3)
    assert shares[textured - 3] == pytest.approx(0.2, abs=0.01)


def test_statistics_are_what_the_fit_would_write() -> None:
    """Writing the file from its own values gives the file."""
    by_kind = {kind.name: statistics(kind) for kind in ImageKind}
    assert sensor_fit.text_of(by_kind, wrong_spread()) == STATISTICS_FILE.read_text("utf-8")
    for table in by_kind.values():
        assert {values.shape for values in table.values()} == {(CLASSES + 1,)}


@pytest.mark.slow
@pytest.mark.parametrize("realism", [False, True])
@pytest.mark.parametrize("mode", ["modelled", "matched"])
@pytest.mark.corpus
def test_mirrors_are_holes_and_glass_shows_what_is_behind(mode: str, realism: bool) -> None:
    scene = sensor_materials.read_plates(corpus_dir())
    for projector in (False, True):
        shares = sensor_materials.plates(scene, sensor.MODES[mode], projector=projector, realism=realism)
        assert shares["mirror"][0] < 0.1
        assert shares["brushed metal"][0] < 0.3
        filled, wrong = shares["glass"]
        assert filled > 0.75
        assert wrong < 0.04
        if not projector:
            assert shares["black"][0] < 0.15


@pytest.mark.slow
@pytest.mark.parametrize("mode", ["modelled", "matched"])
def test_far_and_dark_walls_return_too_few_dots(mode: str) -> None:
    for albedo, near, far in ((0.5, 3.0, 8.0), (0.1, 1.5, 4.0), (0.01, 1.0, 2.0)):
        assert sensor_materials.filled_wall(albedo, near, sensor.MODES[mode]) > 0.9
        assert sensor_materials.filled_wall(albedo, far, sensor.MODES[mode]) < 0.05
