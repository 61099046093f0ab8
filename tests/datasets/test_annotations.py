"""Masks, boxes and visibility of objects whose pixels follow from arithmetic."""

from pathlib import Path

import cv2
import numpy as np
import pytest

from gateway.datasets import annotated_scene
from gateway.datasets.annotated_scene import annotate_scene
from gateway.datasets.classes import classes_of_models
from gateway.datasets.scenes import SceneError
from gateway.scene.draw.style import Style
from renderers.raster import CpuRenderer
from tests.datasets.plates import HEIGHT, WIDTH, Plate, plate_camera, scene_of, see

FILM = {"alphaMode": "BLEND", "pbrMetallicRoughness": {"baseColorFactor": [1, 0, 0, 0.25]}}


def test_a_plate_that_hides_half_of_another(renderer: CpuRenderer, tmp_path: Path) -> None:
    """1 m at 4 m is 10 pixels; at 2 m it is 20 pixels, from the middle of the far plate to the right."""
    seen = see(renderer, scene_of(tmp_path, Plate("far"), Plate("near", (0.5, 0.0, 2.0))))
    far, near = seen.objects["far"], seen.objects["near"]
    assert (far.instance, near.instance) == (1, 2)
    assert far.box_amodal == (27, 19, 10, 10)
    assert far.box_visible == (27, 19, 5, 10)
    assert (far.visible_pixels, far.amodal_pixels, far.visible_fraction, far.truncation) == (50, 100, 0.5, 0.0)
    assert near.box_visible == near.box_amodal == (32, 14, 20, 20)
    assert (near.visible_pixels, near.visible_fraction) == (400, 1.0)
    expected = np.zeros((HEIGHT, WIDTH), np.uint16)
    expected[19:29, 27:37] = 1
    np.testing.assert_array_equal(seen.mask("far"), expected == 1)
    expected[14:34, 32:52] = 2
    np.testing.assert_array_equal(seen.instance, expected)


def test_a_hidden_plate_has_a_record_without_a_visible_box(renderer: CpuRenderer, tmp_path: Path) -> None:
    seen = see(renderer, scene_of(tmp_path, Plate("far"), Plate("near", (0.0, 0.0, 2.0))))
    far = seen.objects["far"]
    assert (far.box_visible, far.visible_pixels, far.amodal_pixels, far.visible_fraction) == (None, 0, 100, 0.0)


def test_truncation_and_boxes_reach_beyond_the_image(renderer: CpuRenderer, tmp_path: Path) -> None:
    """The centre of the plate is on the left edge of the image, 3.2 m to the left at 4 m."""
    seen = see(renderer, scene_of(tmp_path, Plate("cut", (-3.2, 0.0, 4.0)), Plate("out", (-6.0, 0.0, 4.0))))
    cut = seen.objects["cut"]
    assert cut.box_amodal == (-5, 19, 10, 10)
    assert cut.box_visible == (0, 19, 5, 10)
    assert (cut.truncation, cut.visible_fraction, cut.amodal_pixels) == (0.5, 0.5, 100)
    assert "out" not in seen.objects


def test_a_floor_below_the_camera_ends_at_the_edge_of_the_canvas(renderer: CpuRenderer, tmp_path: Path) -> None:
    """A plate of 200 m, 1 m below the camera, reaches behind it: three images wide and up to the horizon."""
    quarter_turn = [np.sqrt(0.5), 0.0, 0.0, np.sqrt(0.5)]
    floor = Plate("floor", (0.0, 1.0, 0.0), node={"rotation": quarter_turn, "scale": [200.0, 200.0, 1.0]})
    seen = see(renderer, scene_of(tmp_path, floor, Plate("on it")))
    record = seen.objects["floor"]
    assert record.box_amodal is not None
    x, y, width, height = record.box_amodal
    assert (x, width, y + height) == (-WIDTH, 3 * WIDTH, 2 * HEIGHT)
    assert y in (HEIGHT // 2, HEIGHT // 2 + 1)
    assert record.truncation == pytest.approx(1.0 - seen.mask("floor").sum() / record.amodal_pixels)
    assert seen.objects["on it"].visible_pixels + record.visible_pixels == (seen.instance > 0).sum()


def test_planes_far_and_near_cut_silhouettes(renderer: CpuRenderer, tmp_path: Path) -> None:
    scene = scene_of(tmp_path, Plate("a", (0.0, 0.0, 1.0)), Plate("b"), Plate("c", (0.0, 0.0, 9.0)))
    seen = see(renderer, scene, plate_camera(near=2.0, far=8.0))
    assert seen.objects.keys() == {"b"}
    assert seen.objects["b"].visible_fraction == 1.0


def test_cut_outs_and_translucent_plates(renderer: CpuRenderer, tmp_path: Path) -> None:
    """Pixels belong to what colour shows: not to the holes of a leaf, nor to a film below the threshold."""
    leaf = Plate("leaf", (0.0, 0.0, 2.0), "leaf", material={"alphaMode": "MASK"}, half=True)
    film = Plate("film", (0.0, 0.0, 3.0), "film", material=FILM)
    scene = scene_of(tmp_path, leaf, film, Plate("wall"))
    for style, behind in ((Style(alpha_threshold=0.5), "wall"), (Style(), "film")):
        seen = see(renderer, scene, style=style)
        assert seen.instance[HEIGHT // 2, WIDTH // 2 - 3] == seen.objects[behind].instance
        assert seen.instance[HEIGHT // 2, WIDTH // 2 + 3] == seen.objects["leaf"].instance
        assert seen.objects["leaf"].amodal_pixels == 200
        assert ("film" in seen.objects) == (behind == "film")
    assert see(renderer, scene, style=Style("pbr")).objects["leaf"].amodal_pixels == 400  # as RenderEngineVtk


def test_class_images_follow_from_instances(renderer: CpuRenderer, tmp_path: Path) -> None:
    plates = Plate("1", mesh="b"), Plate("2", (2.0, 0.0, 4.0), "a"), Plate("3", (-2, 0, 4), "b")
    scene = scene_of(tmp_path, *plates)
    seen = see(renderer, scene)
    classes = cv2.imdecode(np.frombuffer(seen.images["class"], np.uint8), cv2.IMREAD_UNCHANGED)
    assert {name: each.class_id for name, each in seen.objects.items()} == {"1": 2, "2": 1, "3": 2}
    np.testing.assert_array_equal(classes, np.array([0, 2, 1, 2])[seen.instance])


def test_silhouettes_do_not_depend_on_the_others(renderer: CpuRenderer, tmp_path: Path) -> None:
    """Tilted plates behind each other have the silhouettes that they have alone."""
    rng = np.random.default_rng(5)
    quaternions = rng.normal(size=(12, 4))
    quaternions /= np.linalg.norm(quaternions, axis=1, keepdims=True)
    places = rng.uniform((-2, -1.5, 2), (2, 1.5, 6), (12, 3)).tolist()
    plates = [Plate(str(k), places[k], node={"rotation": quaternions[k].tolist()}) for k in range(12)]
    together = see(renderer, scene_of(tmp_path, *plates))
    assert any(each.visible_fraction < 0.9 for each in together.objects.values())
    for plate in plates:
        if plate.name in together.objects:
            alone = see(renderer, scene_of(tmp_path, plate))
            assert (together.mask(plate.name) ^ (alone.instance > 0)).sum() <= 1
            assert abs(together.objects[plate.name].amodal_pixels - alone.objects[plate.name].amodal_pixels) <= 1


def test_a_scene_with_too_many_objects_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(annotated_scene, "MAX_OBJECTS", 1)
    scene = scene_of(tmp_path, Plate("a"), Plate("b"))
    with pytest.raises(SceneError, match=r"2 annotated .*1"):
        annotate_scene(scene, classes_of_models(["plate"]), lambda record, data: None)
