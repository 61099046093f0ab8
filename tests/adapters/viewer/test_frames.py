"""The binary layout of the frames that the page receives."""

import struct

import numpy as np
import pytest

from gateway.adapters.viewer.frames import ALIGNMENT, FrameBuilder, encode
from gateway.adapters.viewer.messages import Received
from tests.support.view_frames import parse_frame


def test_arrays_are_aligned_and_found_by_offset_and_count() -> None:
    builder = FrameBuilder()
    bytes_span = builder.add_array(np.array([1, 2, 3], np.uint8))
    floats_span = builder.add_array(np.array([[0.5, -1.5], [2.5, 3.5]], np.float32))
    assert bytes_span == (0, 3)
    assert floats_span == (ALIGNMENT, 4)
    frame = builder.finish(Received(number=3))
    header, body = parse_frame(frame)
    assert header == {"kind": "received", "number": 3}
    assert (len(frame) - len(body)) % ALIGNMENT == 0
    assert len(body) % ALIGNMENT == 0
    assert np.frombuffer(body, "<f4", 4, floats_span[0]).tolist() == [0.5, -1.5, 2.5, 3.5]


def test_damaged_frames_are_errors() -> None:
    frame = encode(Received(number=3))
    header, body = parse_frame(frame)
    assert (header, len(body)) == ({"kind": "received", "number": 3}, 0)
    with pytest.raises(ValueError, match=f"of {len(frame) - 1} bytes ends within its header of {len(frame) - 8} bytes"):
        parse_frame(frame[:-1])
    for damaged in (b"", frame[:7], b"SGV2" + frame[4:]):
        with pytest.raises(ValueError, match="does not start with SGV1"):
            parse_frame(damaged)
    assert struct.unpack_from("<I", frame, 4) == (len(frame) - 8,)
