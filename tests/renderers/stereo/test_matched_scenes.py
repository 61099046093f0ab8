"""Matched depth on rendered scenes: confidence, density, materials."""

import pytest

from renderers.stereo.model import Quality
from tests.renderers.stereo.material_scenes import filled_wall, plates, read_plates
from tests.support.corpus import corpus_dir
from tools.calibration.errors import match, reliability, unfiltered
from tools.calibration.samples import Sample, samples


@pytest.fixture(scope="module")
def scenes() -> list[Sample]:
    return list(samples(Quality.HIGH, 1))


@pytest.mark.slow
@pytest.mark.parametrize("projector", [False, True])
def test_confidence_of_rendered_scenes_is_the_share_of_right_pixels(scenes: list[Sample], projector: bool) -> None:
    rows = reliability([(each, match(each)) for each in map(unfiltered, scenes) if each.projector == projector])
    pixels = sum(count for _, _, count in rows)
    for promised, right, count in rows:
        if count > 0.05 * pixels:  # one seed has few pixels of the other confidences
            assert right == pytest.approx(promised, abs=0.1)
    promised, right, count = rows[-1]
    assert count > 0.3 * pixels
    assert right == pytest.approx(promised, abs=0.03)


@pytest.mark.slow
def test_matching_is_as_dense_at_every_quality() -> None:
    """The streamed pair is matched, scaled to the quality."""
    for quality in (Quality.LOW, Quality.MEDIUM, Quality.HIGH):
        sample = next(sample for sample in samples(quality, 1) if sample.projector)
        assert (match(sample).disparity > 0).mean() > 0.85


@pytest.mark.slow
@pytest.mark.parametrize("realism", [False, True])
@pytest.mark.corpus
def test_mirrors_are_holes_and_glass_shows_what_is_behind(realism: bool) -> None:
    scene = read_plates(corpus_dir())
    for projector in (False, True):
        shares = plates(scene, projector=projector, realism=realism)
        assert shares["mirror"][0] < 0.1
        # Without the key light of realism, the lamp's highlight is matched, at the distance of its mirror image.
        assert shares["brushed metal"][0] < (0.2 if realism else 0.5)
        filled, wrong = shares["glass"]
        assert filled > 0.75
        assert wrong < 0.04
        if not projector:
            assert shares["black"][0] < 0.15


@pytest.mark.slow
def test_far_and_dark_walls_return_too_few_dots() -> None:
    for albedo, near, far in ((0.5, 3.0, 8.0), (0.1, 1.5, 4.0), (0.01, 1.0, 2.0)):
        assert filled_wall(albedo, near) > 0.9
        assert filled_wall(albedo, far) < 0.05
