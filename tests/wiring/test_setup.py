"""Configurations that the interfaces get from the settings, and what the browser view shows of them."""

import asyncio
from collections.abc import AsyncIterator
from dataclasses import replace
from pathlib import Path
from types import ModuleType, SimpleNamespace
from typing import Any

import msgspec
import numpy as np
import pytest

from gateway.adapters.stereo.device.camera_config import StereoConfig
from gateway.adapters.stereo.device.profile import read_profile
from gateway.adapters.stereo.imaging.scene_view import SceneView
from gateway.adapters.stereo.service import StereoService
from gateway.adapters.viewer.messages import Fact, Status
from gateway.app import create_app
from gateway.demo import ROOT, Demo
from gateway.files.assets.light_rig_file import read_rig
from gateway.files.gltf import GltfLimits
from gateway.runtime.settings import Settings
from gateway.runtime.workers.worker_pool import WorkerPool
from gateway.scene.draw.flatten import Flattener
from gateway.scene.draw.mount import Mount
from gateway.scene.draw.style import Style
from gateway.scene.tree import transforms as tf
from gateway.scene.tree.geometry import Part
from gateway.scene.tree.labels import LabelTable
from gateway.scene.tree.live import LiveTree
from gateway.wiring import render, sceneapi, stereo, treeviewer
from gateway.wiring.context import Context, Provided, ProvidedCamera
from gateway.wiring.startup import enabled_interfaces
from gateway.wiring.view import gateway_status
from renderers.drawlist import Material
from renderers.raster import CpuRenderer
from renderers.stereo.light.levels import LightLevels
from renderers.stereo.model import StereoModel
from renderers.stereo.realism import REALISM_PARTS
from scenegate.messages.geometry import Box
from tests.files.gltf.builder import Builder
from tests.support.waiting import until

MIB = 1 << 20


@pytest.fixture
async def contexts() -> AsyncIterator[Any]:
    """Return a function that makes the context of an application that is not started."""
    made: list[Context] = []

    def make(**settings: Any) -> Context:
        context: Context = create_app(Settings(**settings)).state.context
        made.append(context)
        return context

    yield make
    for context in made:
        await context.close()


class Recorded(Exception):
    """Raised in place of making an object."""


async def arguments(
    monkeypatch: pytest.MonkeyPatch, module: ModuleType, name: str, context: Context, provided: Provided | None = None
) -> Any:
    """Return the arguments with which a module's set-up makes an object of its class ``name``."""
    calls: list[SimpleNamespace] = []

    def record(*positional: Any, **named: Any) -> None:
        calls.append(SimpleNamespace(positional=positional, named=named))
        raise Recorded

    monkeypatch.setattr(module, name, record)
    with pytest.raises(Recorded):
        await module.setup(context, provided or Provided())
    return calls[0]


async def test_settings_of_the_render_endpoint(contexts: Any, monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    rig = tmp_path / "rig.toml"
    rig.write_text("exposure = 0.5\n")
    context = contexts(
        render_path="/draw",
        rig=rig,
        look="pbr",
        samples=4,
        background=(1, 2, 3),
        depth_format="png",
        max_body_mb=3,
        queue_mb=5,
        max_pixels=7777,
        max_nodes=11,
        max_triangles=13,
        max_image_pixels=17,
        keep_failures=None,
    )
    made = await arguments(monkeypatch, render, "RenderService", context)
    config = made.positional[2]
    assert (config.path, config.style) == ("/draw", Style("pbr", (1, 2, 3), samples=4, rig=read_rig(rig)))
    assert (config.depth_format, config.max_pixels) == ("png", 7777)
    assert (config.max_body_bytes, config.max_inflight_bytes) == (3 * MIB, 5 * MIB)
    assert config.gltf == replace(
        GltfLimits(), max_nodes=11, max_elements=13, max_drawn_elements=13, max_image_pixels=17
    )
    assert made.named["backdrop"] is None


async def test_depth_is_tiff_and_the_readers_own_limit_stays(contexts: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    many = GltfLimits().max_elements + 1
    config = (await arguments(monkeypatch, render, "RenderService", contexts(max_triangles=many))).positional[2]
    assert config.depth_format == "tiff"
    assert (config.gltf.max_elements, config.gltf.max_drawn_elements) == (many - 1, many)


async def test_the_live_tree_as_backdrop(contexts: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    context = contexts(backdrop="live")
    backdrop = (await arguments(monkeypatch, render, "RenderService", context)).named["backdrop"]
    assert backdrop() is context.tree.snapshot.root
    with context.tree.edit() as edit:
        edit.set_visible(("a",), False)
    assert backdrop() is context.tree.snapshot.root


async def test_settings_of_the_scene_api(contexts: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    context = contexts(background=(1, 2, 3), max_pixels=7777)
    anything: Any = None
    camera: Any = object()
    provided = Provided(stereo=ProvidedCamera(anything, anything, lambda snapshot: camera))
    made = await arguments(monkeypatch, sceneapi, "SceneApi", context, provided)
    config = made.positional[3]
    assert (config.style.background, config.max_pixels) == ((1, 2, 3), 7777)
    assert made.positional[0].stereo_camera(context.tree.snapshot) is camera


@pytest.mark.parametrize(
    ("settings", "is_kept"),
    [
        ({}, True),
        ({"history_seconds": 0}, False),
        ({"only": ("render", "stereo")}, False),
        ({"only": ("scene",)}, True),
        ({"only": ("view",)}, True),
    ],
)
async def test_a_history_is_kept_where_it_can_be_seen(contexts: Any, settings: dict[str, Any], is_kept: bool) -> None:
    context = contexts(**settings)
    assert (context.history is not None) == is_kept


@pytest.mark.parametrize(
    ("lcm_url", "tcpq_port", "where"),
    [
        ("off", 7700, "TCPQ"),
        ("off", None, "off"),
        ("", 7700, "LCM"),
        ("udpm://239.1.2.3:4567", 7700, "udpm://239.1.2.3:4567"),
        ("udpm://239.1.2.3:4567", None, "udpm://239.1.2.3:4567"),
    ],
)
async def test_where_the_tree_viewer_is(
    contexts: Any, lcm_url: str, tcpq_port: int | None, where: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    context = contexts(lcm_url=lcm_url, tcpq_port=tcpq_port)
    shown: list[str] = []
    monkeypatch.setattr(Context, "run_service", lambda self, name, service, *, where: shown.append(f"{name} {where}"))
    await treeviewer.setup(context, Provided())
    assert shown == [f"treeviewer {where}"]


@pytest.mark.parametrize(
    ("settings", "names"),
    [
        ({}, ["render", "drakeviewer", "treeviewer", "stereo", "scene", "view"]),
        ({"demo": True}, ["render", "drakeviewer", "treeviewer", "stereo", "scene", "view", "demo"]),
        ({"drake_viewer": False}, ["render", "treeviewer", "stereo", "scene", "view"]),
        ({"only": ("view", "render")}, ["render", "view"]),
        ({"only": ("render",), "demo": True}, ["render", "demo"]),
    ],
)
def test_enabled_interfaces(settings: dict[str, Any], names: list[str]) -> None:
    assert list(enabled_interfaces(Settings(**settings))) == names


def test_configuration_of_the_stereo_camera(tmp_path: Path) -> None:
    certificate, key, ca = (tmp_path / name for name in ("c.pem", "k.pem", "ca.pem"))
    for path in (certificate, key, ca):
        path.write_text("")
    config = stereo.config_of(
        Settings(
            host="127.0.0.2",
            grpc_port=1234,
            depth_mode="matched",
            stereo_rate="max",
            stereo_seed=5,
            stereo_noise=False,
            stereo_profile="rc_visard_65m",
            background=(1, 2, 3),
            stereo_faults=True,
            stereo_light=LightLevels(sky=2.0, projector=0.5),
            grpc_certificate=certificate,
            grpc_key=key,
            grpc_client_ca=ca,
        )
    )
    assert (config.tls.certificate, config.tls.key, config.tls.client_ca) == (certificate, key, ca)
    assert replace(config, tls=None) == StereoConfig(
        host="127.0.0.2",
        port=1234,
        realism=frozenset(REALISM_PARTS),
        model=read_profile("rc_visard_65m").model,
        color=False,
        depth_mode="matched",
        rate="max",
        seed=5,
        noise=False,
        background=(1, 2, 3),
        light=LightLevels(sky=2.0, projector=0.5),
        dot_light=1.0,
        faults=True,
    )
    assert stereo.config_of(Settings()).tls is None


@pytest.fixture
def cameras(monkeypatch: pytest.MonkeyPatch) -> dict[str, tuple[StereoService, Any]]:
    """Services of the stereo cameras that are set up, and the sources of their scenes, by name; none runs."""
    made: dict[str, tuple[StereoService, Any]] = {}
    sources: list[Any] = []

    def recorded(config: Any, scene: Any, *rest: Any) -> StereoService:
        sources.append(scene)
        return StereoService(config, scene, *rest)

    def run_service(context: Context, name: str, service: StereoService, **_: Any) -> None:
        made[name] = service, sources[-1]

    monkeypatch.setattr(stereo, "StereoService", recorded)
    monkeypatch.setattr(Context, "run_service", run_service)
    return made


@pytest.mark.parametrize(("grpc_port", "ports"), [(5000, [5000, 5001, 5002]), (0, [0, 0, 0])])
async def test_further_cameras_have_ports_seeds_and_mounts_of_their_own(
    contexts: Any, grpc_port: int, ports: list[int], cameras: dict[str, tuple[StereoService, Any]]
) -> None:
    mounts = ("1,2,3,1,0,0,0", '["robot", "head"]')
    context = contexts(grpc_port=grpc_port, stereo_seed=7, stereo_cameras=mounts, stereo_pose="4,5,6,1,0,0,0")
    with context.tree.edit() as edit:
        edit.set_pose(("robot", "head"), (7, 8, 9, 1, 0, 0, 0))
    provided = await stereo.setup(context, Provided())
    assert list(cameras) == ["stereo", "stereo 1", "stereo 2"]
    assert [service.config.port for service, _ in cameras.values()] == ports
    assert [service.config.seed for service, _ in cameras.values()] == [7, 8, 9]
    poses = [source(None).X_world_left[:3, 3].tolist() for _, source in cameras.values()]
    assert poses == [[4, 5, 6], [1, 2, 3], [7, 8, 9]]
    camera = provided.stereo.camera(context.tree.snapshot)
    assert camera.X_world_camera[:3, 3].tolist() == [4, 5, 6]


@pytest.mark.parametrize(("projectors", "seen"), [("own", []), ("shared", [[1, 2, 3]])])
async def test_cameras_see_the_projectors_of_others_on_request(
    contexts: Any, projectors: str, seen: list[list[int]], cameras: dict[str, tuple[StereoService, Any]]
) -> None:
    mounts = ("name=lit;1,2,3,1,0,0,0",)
    context = contexts(grpc_port=0, stereo_cameras=mounts, stereo_projectors=projectors)
    await stereo.setup(context, Provided())
    others = cameras["stereo"][1](None).projectors
    assert [other.X_world_left[:3, 3].tolist() for other in others] == seen
    assert all(other.dot_light == 2.0 for other in others)


@pytest.mark.parametrize(("scene_lights", "x"), [("true", 2.0), ("false", 5.0)])
async def test_cameras_see_the_lights_of_their_scene_or_of_the_rig(
    contexts: Any, tmp_path: Path, scene_lights: str, x: float, cameras: dict[str, tuple[StereoService, Any]]
) -> None:
    scene, rig, b = tmp_path / "scene.gltf", tmp_path / "rig.toml", Builder()
    b.json["extensionsUsed"] = ["KHR_lights_punctual"]
    b.json["extensions"] = {"KHR_lights_punctual": {"lights": [{"type": "point"}]}}
    b.node(translation=[2, 0, 0], extensions={"KHR_lights_punctual": {"light": 0}})
    scene.write_bytes(b.text())
    rig.write_text(f'scene_lights = {scene_lights}\n[[lights]]\nkind = "point"\nposition = [5, 0, 0]\n')
    await stereo.setup(contexts(grpc_port=0, stereo_scene=str(scene), rig=rig, up="z"), Provided())
    service, source = cameras["stereo"]
    seen = service.config.rig.lights_of(source(None).scene)
    assert [light.position for light in seen] == [(x, 0.0, 0.0)]


class Sensor:
    """A small stereo camera at (1, 2, 3) that looks along z."""

    def __init__(self, *, live: bool = True) -> None:
        self.tree, self.workers = LiveTree(), WorkerPool(1)
        pose = np.eye(4)
        pose[:3, 3] = 1, 2, 3
        scene_view = SceneView(self.tree, Flattener(LabelTable()), Mount(pose))
        model = StereoModel("small", 64, 48, 0.8449, 0.160)
        config = StereoConfig(model=model, look="phong", depth_mode="ground_truth")
        self.service = StereoService(config, scene_view.state, CpuRenderer(1), self.workers)
        self.source = stereo.StereoSensor(self.service, scene_view, live=live)


@pytest.fixture
async def sensor() -> AsyncIterator[Sensor]:
    sensor = Sensor()
    yield sensor
    assert await sensor.workers.close()


async def test_the_stereo_rig_in_the_browser_view(sensor: Sensor) -> None:
    rig = sensor.source.rig(sensor.tree.snapshot)
    assert rig.pose[12:15] == [1, 2, 3]
    assert (rig.width, rig.height, rig.cx, rig.cy, rig.baseline) == (64, 48, 32, 24, 0.16)
    assert rig.fx == rig.fy == pytest.approx(0.8449 * 64)
    assert Sensor(live=False).source.rig(sensor.tree.snapshot) is None


async def test_captions_of_an_empty_scene(sensor: Sensor) -> None:
    exposure = [("exp_control", "Manual"), ("exp_value", 0.0025), ("gain_value", 6.0)]
    sensor.service.parameters.set("rc_camera", exposure)
    images = await sensor.source.capture()
    assert (images.left.shape, images.right.shape) == ((48, 64, 3), (48, 64, 3))
    assert images.disparity.shape == images.confidence.shape == (24, 32)
    assert not images.disparity.any()
    assert dict(images.captions) == {
        "left": "2.5 ms, 6 dB",
        "right": "2.5 ms, 6 dB",
        "disparity": "no depth",
        "confidence": "",
    }


async def test_captions_have_the_range_and_the_share_of_depth(sensor: Sensor) -> None:
    with sensor.tree.edit() as edit:
        edit.set_parts(("wall",), (Part(Box((100.0, 100.0, 2.0)), Material(), tf.translation(1, 2, 3 + 2 + 1)),))
    captions = (await sensor.source.capture()).captions
    assert captions["disparity"] == "2.0–2.0 m"
    percent = int(captions["confidence"].removesuffix(" %"))
    assert 80 < percent < 100, "all but the left edge"
    with sensor.tree.edit() as edit:
        edit.set_parts(("near",), (Part(Box((0.5, 100.0, 2.0)), Material(), tf.translation(1, 2, 3 + 1 + 1)),))
    assert (await sensor.source.capture()).captions["disparity"] == "1.0–2.0 m"


async def test_the_status_bar(contexts: Any) -> None:
    context = contexts()

    def status() -> Status:
        return gateway_status(context.registry, context.workers.stats)

    context.registry.fail("treeviewer", "no route")
    context.registry.ready("stereo 1", figures=lambda: {"warnings": ["no node"]})
    context.registry.warn("render", "robot.urdf", "a mesh is missing")
    context.registry.ready("render")
    assert msgspec.to_builtins(status())["interfaces"] == {
        "treeviewer": {"state": "failed", "problem": "no route", "title": "Tree viewer", "documentation": ""},
        "stereo 1": {"state": "ready", "warnings": ["no node"], "title": "Stereo camera 1", "documentation": ""},
        "render": {"state": "ready", "warnings": ["a mesh is missing"], "title": "Render server", "documentation": ""},
    }
    context.registry.ready("stereo", figures=lambda: {"clients": 2})
    assert status().facts == [Fact(name="queue", value=0), Fact(name="streams", value=2)]
    context.registry.ready("drakeviewer", figures=lambda: {"simulation_seconds": 1.5})
    assert status().facts[0] == Fact(name="simulation", value="1.50 s")
    for lcm, lost in (({"dropped": 0}, 0), ({"dropped": 3}, 3), ({"dropped": 3, "lost_datagrams": 4}, 7)):
        context.registry.ready("treeviewer", figures=lambda lcm=lcm: {"lcm": lcm})
        assert Fact(name="lost LCM", value=lost, warn=lost > 0) in status().facts
    for without in ({}, {"lcm": "off"}, {"lcm": {"url": "udpm://"}}):
        context.registry.ready("treeviewer", figures=lambda without=without: without)
        assert "lost LCM" not in [fact.name for fact in status().facts]


async def test_the_demo_is_in_the_tree_while_its_service_runs() -> None:
    tree = LiveTree()
    service = Demo(tree)
    assert not service.ready
    task = asyncio.create_task(service.run())
    await until(lambda: service.ready and tree.snapshot.revision >= 2)
    assert tree.snapshot.root.find(ROOT) is not None
    task.cancel()
    await asyncio.gather(task, return_exceptions=True)
    assert tree.snapshot.root.find(ROOT) is None
    assert not service.ready
