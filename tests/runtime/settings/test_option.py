"""Settings as text: flags, variables, defaults and placeholders."""

from typing import Any

import pytest

from gateway.runtime.settings import Settings
from gateway.runtime.settings.option import default_of, env_of, flag_of, metavar_of, second_flag_of


@pytest.mark.parametrize(
    ("default", "text"),
    [
        (True, "on"),
        (False, "off"),
        (None, ""),
        ((), ""),
        ("", ""),
        ((1, 2, 3), "1,2,3"),
        (0, "0"),
        (0.0, "0"),
        (0.25, "0.25"),
        (30.0, "30"),
        (7700, "7700"),
        ("udpm", "udpm"),
    ],
)
def test_defaults(default: Any, text: str) -> None:
    assert default_of(default) == text


@pytest.mark.parametrize(
    ("name", "metavar"),
    [
        ("http_port", "NUMBER"),
        ("tcpq_port", "NUMBER|off"),
        ("demo", "on|off"),
        ("render_seconds", "NUMBER"),
        ("state", "PATH"),
        ("host", "TEXT"),
        ("lcm_url", "TEXT"),
        ("mesh_root", "PATHS"),
        ("background", "R,G,B"),
        ("stereo_cameras", "CAMERAS"),
        ("only", "NAMES"),
        ("look", "auto|phong|pbr|gltf|plain|studio"),
        ("clock", "real|simulated"),
    ],
)
def test_placeholders(name: str, metavar: str) -> None:
    assert metavar_of(Settings.model_fields[name]) == metavar


def test_names() -> None:
    assert (flag_of("http_port"), env_of("http_port")) == ("--http-port", "SCENEGATE_HTTP_PORT")
    assert second_flag_of(Settings.model_fields["http_port"]) == "--port"
    assert second_flag_of(Settings.model_fields["grpc_port"]) is None
