"""The committed protobuf classes equal protoc's output for protos/image_interface.proto."""

import subprocess
import sys
from pathlib import Path

import pytest

from scenegate.camera import image_interface_pb2 as pb

ROOT = Path(__file__).resolve().parents[4]
VENV = Path(sys.prefix)


@pytest.mark.slow
def test_committed_classes_equal_protocs_output(tmp_path: Path) -> None:
    made = subprocess.run(
        ["make", "--no-print-directory", "-o", f"{VENV}/.tools", "generate", f"VENV={VENV}", f"ARGS={tmp_path}"],
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=False,
    )
    if made.returncode:
        pytest.skip(f"grpcio-tools cannot be had here: {made.stderr[-200:]}")
    for name in ("image_interface_pb2.py", "image_interface_pb2.pyi"):
        committed = ROOT / "client" / "scenegate" / "camera" / name
        assert (tmp_path / name).read_text() == committed.read_text(), f"run `make generate`: {name} differs"


def test_wire_names_and_numbers_of_the_protocol_document() -> None:
    assert pb.DESCRIPTOR.package == ""
    service = pb.DESCRIPTOR.services_by_name["ImageInterface"]
    assert [m.full_name for m in service.methods] == ["ImageInterface.StreamImageSets"]
    service = pb.DESCRIPTOR.services_by_name["ImageEventsInterface"]
    assert [m.full_name for m in service.methods] == ["ImageEventsInterface.StreamImageEvents"]
    assert {f.name: f.number for f in pb.ImageEvents.DESCRIPTOR.fields} == {
        "imageset_timestamp": 1, "depth_acquisition_done": 2,
    }  # fmt: skip
    assert {f.name: f.number for f in pb.Event.DESCRIPTOR.fields} == {"timestamp": 1, "message": 2}
    image = {f.name: f.number for f in pb.Image.DESCRIPTOR.fields}
    assert image == {
        "timestamp": 1, "height": 2, "width": 3, "focal_length": 4, "principal_point_u": 5, "principal_point_v": 6,
        "encoding": 7, "is_bigendian": 8, "step": 9, "data": 10, "gpios": 11, "exposure_time": 12, "gain": 13,
        "noise": 14, "out1_reduction": 16, "brightness": 17, "gamma": 18, "auto_exposure_adapting": 19,
    }  # fmt: skip
