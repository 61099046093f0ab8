"""Settings: precedence, sentences for what cannot be used, the generated reference."""

import os
from pathlib import Path

import pytest

from gateway.runtime import settings
from gateway.runtime.settings import Settings, SettingsError, load, option


@pytest.fixture(autouse=True)
def _clean(monkeypatch: pytest.MonkeyPatch) -> None:
    for name in list(os.environ):
        if name.startswith("SCENEGATE_"):
            monkeypatch.delenv(name)


def toml(folder: Path, text: str) -> Path:
    path = folder / "scenegate.toml"
    path.write_text(text)
    return path


def test_flags_override_the_environment_the_file_and_defaults(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    file = toml(tmp_path, "http_port = 1\nqueue = 2\nthreads = 3\n")
    assert load().http_port == 8000
    assert load(config=file).http_port == 1
    monkeypatch.setenv("SCENEGATE_HTTP_PORT", "11")
    monkeypatch.setenv("SCENEGATE_QUEUE", "12")
    chosen = load({"http_port": "21"}, file)
    assert (chosen.http_port, chosen.queue, chosen.threads) == (21, 12, 3)


def test_the_environment_names_the_file_and_its_keys_may_have_hyphens(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("SCENEGATE_CONFIG", str(toml(tmp_path, 'http-port = 7\nonly = ["render"]\n')))
    assert load().http_port == 7
    assert load().only == ("render",)
    assert [load().is_enabled(name) for name in ("render", "scene")] == [True, False]


def test_empty_variables_are_ignored(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("SCENEGATE_HTTP_PORT", "")
    assert load().http_port == 8000
    assert load().is_enabled("render")


def test_lists_are_split_at_their_separator(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("SCENEGATE_MESH_ROOT", os.pathsep.join(("/a", "/b c")))
    monkeypatch.setenv("SCENEGATE_ONLY", "render,scene")
    assert load().mesh_root == (Path("/a"), Path("/b c"))
    assert load().only == ("render", "scene")


@pytest.mark.parametrize(
    ("flags", "env", "file", "message"),
    [
        ({"http_port": "x"}, {}, "", "--http-port: input should be a valid integer"),
        ({}, {"SCENEGATE_HTTP_PORT": "70000"}, "", "SCENEGATE_HTTP_PORT: input should be less than or equal to 65535"),
        ({"mesh_root": "off:/a"}, {}, "", "--mesh-root off excludes folders and auto"),
        ({}, {}, "queue = -1", "queue in {file}: input should be greater than or equal to 0, got -1."),
        (
            {"look": "vtk"},
            {},
            "",
            "--look: input should be 'auto', 'phong', 'pbr', 'gltf', 'plain' or 'studio', got 'vtk'.",
        ),
        ({"only": "render,foo"}, {}, "", "--only: input should be 'render'"),
        ({"render_path": "render"}, {}, "", "--render-path: "),
        ({"background": "red"}, {}, "", "--background: must be R,G,B: three whole numbers of 0 to 255, got 'red'."),
        ({"clock": "sundial"}, {}, "", "--clock: input should be 'real' or 'simulated', got 'sundial'."),
        (
            {"lcm_url": "udpm://239.255.76.67:99999"},
            {},
            "",
            "--lcm-url: its port is not a number of 0 to 65535, got 'udpm://239.255.76.67:99999'.",
        ),
        ({}, {"SCENEGATE_LCM_URL": "udpm://10.1.2.3"}, "", "SCENEGATE_LCM_URL: 10.1.2.3 is not a multicast address"),
        ({"lcm_url": "udpm://?ttl=far"}, {}, "", "--lcm-url: ttl must be a number of 0 to 255, not 'far', got "),
        ({"lcm_url": "tcpq://host:port"}, {}, "", "--lcm-url: its port is not a number of 0 to 65535, got "),
        ({}, {}, "lcm_url = 'bogus'", "lcm_url in {file}: the URL must begin with udpm://, tcpq://, mpudpm://"),
        ({}, {"LCM_DEFAULT_URL": "udpm://x"}, "", "LCM_DEFAULT_URL: x is not a multicast address (224.0.0.0 to "),
        ({}, {}, "htpp_port = 1", "htpp_port in {file} is not a setting; did you mean http_port?"),
        ({}, {}, "http_port = ", "The configuration file {file} is not TOML"),
    ],
)
def test_an_invalid_value_is_one_sentence_with_its_source(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, flags: dict[str, str], env: dict[str, str], file: str, message: str
) -> None:
    for name, value in env.items():
        monkeypatch.setenv(name, value)
    path = toml(tmp_path, file)
    with pytest.raises(SettingsError) as raised:
        load(flags, path)
    assert str(raised.value).startswith(message.format(file=path))
    assert "\n" not in str(raised.value)


def test_a_missing_file_is_reported_in_one_sentence(tmp_path: Path) -> None:
    with pytest.raises(SettingsError, match=r"none\.toml .*No such file"):
        load(config=tmp_path / "none.toml")


def test_two_faults_are_two_sentences_in_a_line(tmp_path: Path) -> None:
    """The command prints line breaks as escapes."""
    with pytest.raises(SettingsError, match=r"^--http-port: .*'x'\. --queue: .*'y'\.$"):
        load({"http_port": "x", "queue": "y"})
    with pytest.raises(SettingsError, match=r"^htpp_port .*\? foo .*\.$"):
        load(config=toml(tmp_path, "htpp_port = 1\nfoo = 1"))


def test_unknown_variables_are_reported(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("SCENEGATE_HTPP_PORT", "1")
    monkeypatch.setenv("SCENEGATE_CORPUS", "/somewhere")
    monkeypatch.setenv("SCENEGATE_ROBOTS", "/somewhere")
    assert settings.unknown_environment() == ["SCENEGATE_HTPP_PORT is not a setting; did you mean SCENEGATE_HTTP_PORT?"]


def test_every_setting_has_a_group_a_description_and_a_default_that_is_valid() -> None:
    for name, field in Settings.model_fields.items():
        assert field.description, name
        assert field.description.endswith("."), name
        assert option.group_of(field), name
    defaults = {name: field.default for name, field in Settings.model_fields.items()}
    assert Settings.model_validate(defaults) == load()


def test_pairs_and_a_scene_file_exclude_each_other(tmp_path: Path) -> None:
    with pytest.raises(SettingsError, match=r"--stereo-images .*--stereo-scene"):
        load({"stereo_images": tmp_path, "stereo_scene": "scene.glb"})
    assert load({"stereo_images": tmp_path}).stereo_scene == "live"


MOUNT = "1,2,3,1,0,0,0"


@pytest.mark.parametrize(
    ("name", "text", "value"),
    [
        ("background", "0,0,0", (0, 0, 0)),
        ("background", "255, 255 ,255", (255, 255, 255)),
        ("http_port", "0", 0),
        ("http_port", "65535", 65535),
        ("tcpq_port", "off", None),
        ("tcpq_port", "0", 0),
        ("tcpq_port", "7700", 7700),
        ("stereo_cameras", MOUNT, (MOUNT,)),
        ("stereo_cameras", '["robot", "head"]', ('["robot", "head"]',)),
        ("stereo_cameras", ' ["robot"]', (' ["robot"]',)),
        ("stereo_cameras", "eye=1,2,3;target=0,0,0", ("eye=1,2,3;target=0,0,0",)),
        ("stereo_cameras", "|".join([MOUNT] * 15), (MOUNT,) * 15),
        ("root_path", "/proxy/8000/", "/proxy/8000"),
        ("root_path", "/user/%C3%A4nn", "/user/änn"),
        ("root_path", "/", ""),
        ("root_path", "", ""),
        *(("frame_origins", text, (text,)) for text in ("*", "http://localhost:8888", "vscode-webview:")),
        ("frame_origins", "https://*.example.org", ("https://*.example.org",)),
    ],
)
def test_values(name: str, text: str, value: object) -> None:
    assert getattr(load({name: text}), name) == value


@pytest.mark.parametrize(
    ("name", "reason", "texts"),
    [
        ("background", ".*0 to 255", ("1,2", "1,2,3,4", "", "1,2,-3", "1,2,1.5", "256,0,0", "0,0,256", "1,2,\u0663")),
        ("stereo_cameras", "", ("1,2,3", "[1.5]", "|".join([MOUNT] * 16))),
        ("root_path", "", ("proxy", "//host/x", "/a?b", "/a b", "https://host/x")),
        ("frame_origins", "", ("localhost:8888", "http://a;script-src *", "http://a\r\nX: y", "http://a/b")),
    ],
)
def test_values_that_are_refused(name: str, reason: str, texts: tuple[str, ...]) -> None:
    for text in texts:
        with pytest.raises(SettingsError, match=f"^--{name.replace('_', '-')}: {reason}"):
            load({name: text})


TWO = {"workers": 2, "only": "render"}


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"grpc_certificate": "c"}, "--grpc-certificate and --grpc-key need each other"),
        ({"grpc_key": "k"}, "--grpc-certificate and --grpc-key need each other"),
        ({"http_certificate": "c"}, "--http-certificate and --http-key need each other"),
        ({"http_key": "k"}, "--http-certificate and --http-key need each other"),
        ({"grpc_client_ca": "a"}, "--grpc-client-ca needs --grpc-certificate and --grpc-key"),
        ({"grpc_client_ca": "a", "http_certificate": "c", "http_key": "k"}, "--grpc-client-ca needs "),
        ({"grpc_certificate": "c", "grpc_key": "k", "grpc_client_ca": "a"}, ""),
        ({"workers": 2}, "--workers 2 needs --only render: "),
        ({"workers": 2, "only": "render,view"}, "--workers 2 needs --only render: "),
        ({**TWO, "state": "x.db"}, "--workers 2 and --state exclude each other: one process "),
        ({**TWO, "foxglove_port": 0}, "--workers 2 and --foxglove-port exclude each other: one process "),
        ({**TWO, "demo": True}, "--workers 2 and --demo exclude each other: the live scene "),
        ({**TWO, "backdrop": "live"}, "--workers 2 and --backdrop live exclude each other: the live scene "),
        ({**TWO, "backdrop": "room.glb"}, ""),
    ],
)
def test_settings_that_need_or_exclude_each_other(settings: dict[str, object], message: str) -> None:
    """Several processes only render, and share nothing."""
    if not message:
        load(settings)
        return
    with pytest.raises(SettingsError) as raised:
        load(settings)
    assert message in str(raised.value)


def test_auto_is_half_of_the_cores(monkeypatch: pytest.MonkeyPatch) -> None:
    """Sixteen processes on sixteen cores render fewer images than eight: clients and kernel need cores, too."""
    settings = load({"workers": "auto", "only": "render"})
    for cpus, processes in ((1, 1), (2, 1), (5, 2), (16, 8)):
        monkeypatch.setattr("gateway.runtime.settings.settings.usable_cpus", lambda cpus=cpus: cpus)
        assert settings.processes == processes
    with pytest.raises(SettingsError, match=r"^--workers auto needs --only render: "):
        load({"workers": "auto"})


@pytest.mark.parametrize(
    ("value", "folders", "anywhere"),
    [(None, (), True), ("off", (), False), ("/a", ("/a",), False), ("auto:/a", ("/a",), True)],
)
def test_mesh_root(value: str | None, folders: tuple[str, ...], anywhere: bool) -> None:
    flags = {} if value is None else {"mesh_root": value}
    assert load(flags).mesh_folders == tuple(map(Path, folders))
    assert load(flags).local_clients_read_all_folders == anywhere
    assert not load({**flags, "root_path": "/gate"}).local_clients_read_all_folders, "a proxy is in front"
