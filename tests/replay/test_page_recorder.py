"""Recordings lead a page to the state at each time, from the start and from each keyframe."""

import asyncio
import io
from typing import Any

import numpy as np
import pytest
from PIL import Image as Pillow

from gateway.adapters.viewer.resources import sample_order
from gateway.replay.page_recorder import MAX_BYTES, PageRecorder, record_section
from gateway.scene.page.live_page import LivePage
from gateway.scene.tree.geometry import Part, PointCloud
from gateway.scene.tree.live import LiveTree, Snapshot
from gateway.scene.tree.timeline import FileTooLargeError
from renderers.drawlist import Material, Texture
from renderers.images import image_from_bytes
from scenegate.messages.geometry import Box, Sphere
from tests.adapters.viewer.model import Model, tree_of
from tests.adapters.viewer.recordings import SECOND, States, frames_of, headers_of
from tests.support.view_frames import parse_frame


def moving_scene(count: int) -> States:
    """Return states a second apart: a box moves, a ball is there at odd times, the box's colour changes at the end."""
    times = iter(range(SECOND, (count + 2) * SECOND, SECOND))
    tree = LiveTree(clock=lambda: next(times))
    snapshots: list[Snapshot] = []
    for number in range(count):
        with tree.edit() as edit:
            if number == 0:
                edit.set_parts(("robot", "box"), (Part(Box((1, 2, 3)), Material()),))
            edit.set_pose(("robot", "box"), (float(number), 0, 0, 1, 0, 0, 0))
            if number % 2:
                edit.set_parts(("ball",), (Part(Sphere(0.5), Material()),))
            elif number:
                edit.delete(("ball",))
            if number == count - 1:
                edit.set_parts(("robot", "box"), (Part(Box((1, 2, 3)), Material(base_color=(1, 0, 0, 1))),))
        snapshots.append(tree.snapshot)
    return States(snapshots)


async def record(states: States, start: int, end: int, rate: float, max_bytes: int = MAX_BYTES) -> bytes:
    """Return the recording of a section."""
    return await record_section(PageRecorder(LivePage(), max_bytes), states, start, end, rate, asyncio.to_thread)


async def test_each_update_and_each_keyframe_leads_to_the_state_of_its_time() -> None:
    states = moving_scene(40)
    recording = await record(states, *states.span, rate=1.0)
    page = Model()
    shown: list[float] = []
    keyframes = 0
    for time, frame in frames_of(recording):
        header, _ = parse_frame(frame)
        if header["kind"] not in ("mesh", "update"):
            continue
        if header["kind"] == "update":
            expected = tree_of((await states.snapshot_at(round(time * SECOND))).root)
            if header["from"] == 0 and shown:
                keyframes += 1
                started = Model()
                started.meshes = set(page.meshes)
                started.receive(frame)
                assert started.tree() == expected
                assert started.revision == page.revision
                continue
            page.receive(frame)
            assert page.tree() == expected
            shown.append(time)
        else:
            page.receive(frame)
    assert shown == list(range(1, 41))
    assert 2 < keyframes < 20


async def test_states_between_the_samples_and_unchanged_ones_are_left_out() -> None:
    states = moving_scene(9)
    half = await record(states, *states.span, rate=0.5)
    assert [time for time, frame in frames_of(half) if parse_frame(frame)[0]["kind"] == "update"] == [1, 3, 5, 7, 9]
    still = await record(states, SECOND, SECOND, rate=30.0)
    assert [parse_frame(frame)[0]["kind"] for _, frame in frames_of(still)] == [
        "light",
        "page",
        "mesh",
        "update",
        "end",
    ]
    twice = await record(states, *states.span, rate=2.0)
    assert len(headers_of(twice, "update")) >= 9
    assert frames_of(twice)[-1][0] == 9.0


def test_textures_and_channels_are_in_the_recording() -> None:
    file = io.BytesIO()
    Pillow.new("RGB", (2, 1), (250, 10, 10)).save(file, "PNG")
    material = Material(base_color_texture=Texture(image_from_bytes(file.getvalue())))
    broken = Material(base_color_texture=Texture(image_from_bytes(b"no image")))
    points = np.arange(15, dtype=np.float32).reshape(5, 3)
    channels = {"intensity": np.arange(5, dtype=np.float32), "velocity": np.ones((5, 2), np.float32)}
    tree = LiveTree()
    with tree.edit() as edit:
        edit.set_parts(("broken",), (Part(Box((1, 1, 1)), broken),))
        edit.set_parts(("box",), (Part(Box((1, 1, 1)), material),))
        edit.set_parts(("cloud",), (Part(PointCloud(points, channels), Material()),))
    recorder = PageRecorder(LivePage())
    recorder.add(0, tree.snapshot)
    recording = recorder.finish(0)
    data: dict[tuple[Any, ...], bytes] = {}
    for _, frame in frames_of(recording):
        header, body = parse_frame(frame)
        if header["kind"] in ("image", "channel"):
            start, count = header["data"]
            data[header["kind"], header["id"], header.get("name")] = bytes(body[start : start + count])
    [update] = headers_of(recording, "update")
    nodes = {node["name"]: node for node in update["nodes"]}
    [draw] = nodes["box"]["parts"][0]["draws"]
    image = Pillow.open(io.BytesIO(data.pop(("image", draw["material"]["texture"]["image"], None))))
    assert image.convert("RGB").getpixel((1, 0)) == (250, 10, 10)
    [draw] = nodes["cloud"]["parts"][0]["draws"]
    intensity = np.frombuffer(data.pop(("channel", draw["mesh"], "intensity")), np.float32)
    assert intensity.tolist() == channels["intensity"][sample_order(5)].tolist()
    assert len(data.pop(("channel", draw["mesh"], "velocity"))) == 40
    assert data == {}


async def test_limits_name_what_to_do() -> None:
    states = moving_scene(9)
    with pytest.raises(FileTooLargeError, match=r"4000 bytes.* shorter time"):
        await record(states, *states.span, rate=1.0, max_bytes=4000)
