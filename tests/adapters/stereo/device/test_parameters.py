"""Parameters of the device: ranges, types and what they mean for the stream."""

from dataclasses import replace

import pytest

from gateway.adapters.stereo.device.camera_config import StereoConfig
from gateway.adapters.stereo.device.parameter_specs import NODES, Spec
from gateway.adapters.stereo.device.parameters import ParameterError, Parameters, UnknownParameterError, check_value
from gateway.adapters.stereo.device.stream_settings import Region
from gateway.adapters.stereo.stream.set_kind import read_set_kind
from renderers.stereo.mesh.disparity_mesh import MeshOptions
from renderers.stereo.model import Quality, StereoModel
from renderers.stereo.sensor.exposure import Exposure
from scenegate.camera import image_interface_pb2 as pb
from tests.adapters.stereo.conftest import settings

SPECS = [spec for specs in NODES.values() for spec in specs.values()]


@pytest.mark.parametrize("spec", SPECS, ids=lambda spec: spec.name)
def test_both_limits_are_included_and_nothing_beyond(spec: Spec) -> None:
    for value in (spec.default, *spec.choices, *spec.aliases):
        check_value(spec, value)
    beyond: list[float | str] = [""]
    if spec.type != "string":
        low, high = float(spec.minimum), float(spec.maximum)
        assert (check_value(spec, spec.minimum), check_value(spec, spec.maximum)) == (low, high)
        step = 1e-9 if spec.type == "float64" else 1
        beyond = [low - step, high + step]
    for value in beyond:
        with pytest.raises(ParameterError, match=f"^{spec.name}: "):
            check_value(spec, value)


def test_the_devices_ranges() -> None:
    ranges = {spec.name: (spec.minimum, spec.maximum, spec.default) for spec in SPECS}
    expected = {
        "fps": (1.0, 25.0, 25.0),
        "exp_max": (6.6e-5, 0.018, 0.018),
        "exp_value": (6.6e-5, 0.018, 0.005),
        "gain_value": (0.0, 18.0, 0.0),
        "gamma": (0.1, 10.0, 1.0),
        "wb_ratio_red": (0.125, 8.0, 1.2),
        "wb_ratio_blue": (0.125, 8.0, 2.4),
        "seg": (0, 4000, 200),
        "fill": (0, 4, 3),
        "minconf": (0.5, 1.0, 0.5),
        "mindepth": (0.1, 100.0, 0.1),
        "maxdepth": (0.1, 100.0, 100.0),
        "maxdeptherr": (0.01, 100.0, 100.0),
    }
    assert expected.items() <= ranges.items()


def test_types() -> None:
    fps, seg, auto = NODES["rc_camera"]["fps"], NODES["rc_stereomatching"]["seg"], NODES["rc_camera"]["exp_auto"]
    assert isinstance(check_value(fps, 5), float)
    assert check_value(seg, 5.0) == 5
    assert isinstance(check_value(seg, 5.0), int)
    assert [check_value(auto, value) for value in (0, 1, True, 0.0)] == [False, True, True, False]
    for spec, value, message in (
        (seg, 5.5, "seg: 5.5 .*whole"),
        (seg, True, "seg: True "),
        (auto, 2, "exp_auto: 2 "),
        (auto, None, "exp_auto: None "),
        (fps, 10**400, "fps: .*too large"),
        (fps, float("nan"), "fps: nan "),
        (fps, float("-inf"), "fps: -inf "),
        (NODES["rc_camera"]["exp_control"], 1, "exp_control: 1 .*string"),
        (NODES["rc_camera"]["exp_control"], "auto", "exp_control: 'auto' .*Auto, Manual, HDR$"),
    ):
        with pytest.raises(ParameterError, match=f"^{message}"):
            check_value(spec, value)


def test_long_values_are_cut_in_messages() -> None:
    control = NODES["rc_camera"]["exp_control"]
    for length, shown in ((78, repr("a" * 78)), (79, repr("a" * 79)[:80] + "…")):
        with pytest.raises(ParameterError) as refusal:
            check_value(control, "a" * length)
        assert f"exp_control: {shown} is not one" in str(refusal.value)


def test_changes_are_counted_and_reset() -> None:
    parameters = Parameters()
    assert parameters.set("rc_camera", []) == []
    assert parameters.version == 0
    assert parameters.set("rc_camera", [("fps", 5), ("exp_auto", False)]) == ["fps", "exp_auto"]
    assert (parameters.version, parameters.values("rc_camera")["exp_control"]) == (1, "Manual")
    for control, auto in (("HDR", True), ("Manual", False), ("Auto", True), ("Manual", False)):
        parameters.set("rc_camera", [("exp_control", control)])
        assert parameters.values("rc_camera")["exp_auto"] is auto
    parameters.set("rc_camera", [("exp_auto", 1)])
    assert parameters.values("rc_camera")["exp_control"] == "Auto"
    with pytest.raises(ParameterError):
        parameters.set("rc_camera", [("fps", 7), ("gain_value", 99)])
    assert (parameters.version, parameters.values("rc_camera")["fps"]) == (6, 5.0)
    parameters.reset("rc_camera")
    assert (parameters.version, parameters.values("rc_camera")["fps"]) == (7, 25.0)
    with pytest.raises(UnknownParameterError, match="there is no node 'x'; there are rc_camera, "):
        parameters.spec("x", "fps")


@pytest.mark.parametrize(
    ("divisor", "rows", "columns"),
    [(1, slice(20, 31), slice(10, 17)), (2, slice(10, 16), slice(5, 9)), (6, slice(3, 6), slice(1, 3))],
)
def test_regions_include_pixels_that_lie_partly_inside(divisor: int, rows: slice, columns: slice) -> None:
    assert Region(x=10, y=20, width=7, height=11).slices(divisor) == (rows, columns)


def test_regions_need_width_and_height() -> None:
    assert settings("rc_stereomatching", roi_width=5).depth_region is None
    assert settings("rc_stereomatching", roi_height=5).depth_region is None
    region = settings("rc_stereomatching", roi_offset_x=1, roi_offset_y=2, roi_width=3, roi_height=4).depth_region
    assert region == Region(1, 2, 3, 4)
    metered = settings(exp_offset_x=5, exp_offset_y=6, exp_width=7, exp_height=8)
    assert (metered.exposure_region, metered.depth_region) == (Region(5, 6, 7, 8), None)


@pytest.mark.parametrize(
    ("mode", "camera", "depth"),
    [("Low", 0, 0), ("High", 1, 1), ("ExposureActive", 1, 1), ("ExposureAlternateActive", 0, 1)],
)
def test_output_modes(mode: str, camera: int, depth: int) -> None:
    first, second = settings("rc_iocontrol", out1_mode=mode), settings("rc_iocontrol", out2_mode=mode)
    assert (first.camera_gpio, first.depth_gpio) == (camera, depth)
    assert (second.camera_gpio, second.depth_gpio) == (2 * camera, 2 * depth)
    assert first.separate_depth == second.separate_depth == (camera != depth)
    assert first.alternate_exposure == (mode == "ExposureAlternateActive")
    assert not second.alternate_exposure
    triggered = replace(first, single_frame_out1=True)
    assert (triggered.camera_gpio, triggered.depth_gpio) == (0, 1)


def test_acquisition_modes() -> None:
    for mode, expected in (
        ("Continuous", (False, False)),
        ("SingleFrame", (True, False)),
        ("SingleFrameOut1", (True, True)),
    ):
        chosen = settings("rc_stereomatching", acquisition_mode=mode)
        assert (chosen.single_frame, chosen.single_frame_out1) == expected


def test_rates() -> None:
    assert settings(fps=20).camera_rate == 20.0
    assert settings(fps=24, exp_control="HDR").camera_rate == 8.0
    assert settings("rc_iocontrol", out1_mode="ExposureAlternateActive").camera_rate == 12.5
    for quality, rate, static_rate in (("Full", 1, 1), ("High", 3, 3), ("Medium", 15, 15), ("Low", 25, 25)):
        assert settings("rc_stereomatching", quality=quality).depth_rate == rate
        static = settings("rc_stereomatching", quality=quality, static_scene=True)
        assert static.averaged_images == (8 if quality in ("Full", "High") else 1)
        assert static.depth_rate == static_rate
    slow = replace(settings("rc_stereomatching", quality="High", static_scene=True), fps=8.0)
    assert slow.depth_rate == 1.0


def test_white_balance_and_exposure_parameters() -> None:
    manual = settings(exp_control="Manual", exp_value=0.002, gain_value=6, gamma=2)
    assert (manual.auto_exposure, manual.manual_exposure) == (None, Exposure(0.002, 6.0, 2.0))
    warm = settings(wb_auto=False, wb_ratio_red=2.4, wb_ratio_blue=1.2).manual_exposure
    assert (warm.red, warm.blue) == (2.0, 0.5)
    hdr = settings(exp_control="HDR", exp_max=0.01, exp_auto_average_max=0.6, exp_auto_average_min=0.2)
    assert hdr.manual_exposure.hdr
    assert hdr.auto_exposure is not None
    limits = hdr.auto_exposure
    assert (limits.max_time, limits.average_max, limits.average_min) == (0.01, 0.6, 0.2)


@pytest.mark.parametrize(
    ("fields", "name"),
    [
        ({"width": 15}, "size"), ({"width": 8193}, "size"), ({"height": 15}, "size"), ({"height": 8193}, "size"),
        ({"focal_factor": 0.049}, "focal_factor"), ({"focal_factor": 20.1}, "focal_factor"),
        ({"focal_factor": float("nan")}, "focal_factor"), ({"baseline": 0.9e-4}, "baseline"),
        ({"baseline": 100.1}, "baseline"), ({"baseline": -0.16}, "baseline"),
    ],
)  # fmt: skip
def test_models_beyond_the_limits_are_refused(fields: dict[str, float], name: str) -> None:
    values = {"name": "x", "width": 640, "height": 480, "focal_factor": 1.0, "baseline": 0.1}
    with pytest.raises(ValueError, match=f"^stereo (camera )?{name} "):
        StereoModel(**{**values, **fields})  # type: ignore[arg-type]  # fields of several types
    StereoModel("smallest", 16, 16, 0.05, 1e-4)
    StereoModel("largest", 8192, 8192, 20.0, 100.0)


def test_nearest_depth_and_number_of_disparities() -> None:
    model = StereoModel("x", 1000, 800, 1.0, 0.1, full_max_disparities=100)  # focal length times baseline: 100 px m
    assert model.nearest_depth(0.1, 100.0, 2) == 0.25
    assert model.nearest_depth(2.0, 100.0, 2) == 2.0
    assert model.nearest_depth(0.1, 100.0, 1) == pytest.approx(100 / 101)
    assert model.nearest_depth(0.1, 0.5, 1) == pytest.approx(100 / 300)
    assert model.has_reduced_range(0.1, 100.0, 1)
    assert not model.has_reduced_range(0.1, 100.0, 2)
    assert not model.has_reduced_range(1.0, 100.0, 1)
    assert model.disparity_count(1, 1.0, 100.0) == 100
    assert model.disparity_count(2, 0.1) == 200
    assert model.disparity_count(Quality.LOW.divisor, 0.1) == 67


def test_descriptions_have_the_devices_fields() -> None:
    parameters = Parameters()
    switch, choice = parameters.describe("rc_camera", "exp_auto"), parameters.describe("rc_camera", "exp_control")
    assert [switch[name] for name in ("type", "value", "min", "max", "default")] == ["bool", True, False, True, True]
    assert [choice[name] for name in ("type", "value", "min", "max", "default")] == ["string", "Auto", "", "", "Auto"]
    seg = parameters.describe("rc_stereomatching", "seg")
    assert [seg[name] for name in ("name", "type", "value", "min", "max")] == ["seg", "int32", 200, 0, 4000]


def test_mesh_options_of_a_request() -> None:
    options = pb.MeshOptions(max_points=1000, binning_method=pb.MeshOptions.MIN_DEPTH, watertight=True)
    request = pb.ImageSetRequest(mesh_enabled=True, mesh_options=options)
    config = StereoConfig()
    assert read_set_kind(request, config).mesh == MeshOptions(1000, min_depth=True, watertight=True)
    request.mesh_options.textured = True
    request.mesh_options.binning_method = pb.MeshOptions.AVERAGE
    assert read_set_kind(request, config).mesh == MeshOptions(1000, watertight=True, textured=True)
