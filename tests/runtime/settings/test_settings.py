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
        ({"background": "1,2,256"}, {}, "", "--background: must be R,G,B"),
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
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    flags: dict[str, str],
    env: dict[str, str],
    file: str,
    message: str,
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


def test_two_faults_are_two_sentences() -> None:
    with pytest.raises(SettingsError) as raised:
        load({"http_port": "x", "queue": "y"})
    assert len(str(raised.value).splitlines()) == 2


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


@pytest.mark.parametrize(
    ("text", "color"),
    [("0,0,0", (0, 0, 0)), ("255, 255 ,255", (255, 255, 255)), ("1,2,3", (1, 2, 3))],
)
def test_colours(text: str, color: tuple[int, int, int]) -> None:
    assert load({"background": text}).background == color


@pytest.mark.parametrize("text", ["1,2", "1,2,3,4", "", "1,2,-3", "1,2,1.5", "256,0,0", "0,0,256", "1,2,\u0663"])
def test_other_texts_are_no_colours(text: str) -> None:
    with pytest.raises(SettingsError, match=r"^--background: .*0 to 255"):
        load({"background": text})


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"grpc_certificate": "c"}, "--grpc-certificate and --grpc-key need each other"),
        ({"grpc_key": "k"}, "--grpc-certificate and --grpc-key need each other"),
        ({"http_certificate": "c"}, "--http-certificate and --http-key need each other"),
        ({"http_key": "k"}, "--http-certificate and --http-key need each other"),
        ({"grpc_client_ca": "a"}, "--grpc-client-ca needs --grpc-certificate and --grpc-key"),
        ({"grpc_client_ca": "a", "http_certificate": "c", "http_key": "k"}, "--grpc-client-ca needs "),
    ],
)
def test_certificates_and_keys_come_in_pairs(settings: dict[str, str], message: str) -> None:
    with pytest.raises(SettingsError) as raised:
        load(settings)
    assert message in str(raised.value)


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({}, "--workers 2 needs --only render: "),
        ({"only": "render,view"}, "--workers 2 needs --only render: "),
        ({"only": "render", "state": "x.db"}, "--workers 2 and --state exclude each other: one process "),
        ({"only": "render", "foxglove_port": 0}, "--workers 2 and --foxglove-port exclude each other: one process "),
        ({"only": "render", "demo": True}, "--workers 2 and --demo exclude each other: the live scene "),
        ({"only": "render", "backdrop": "live"}, "--workers 2 and --backdrop live exclude each other: the live scene "),
    ],
)
def test_several_processes_only_render_and_share_nothing(settings: dict[str, object], message: str) -> None:
    with pytest.raises(SettingsError) as raised:
        load({"workers": "2", **settings})
    assert str(raised.value).startswith(message)


def test_auto_is_half_of_the_cores(monkeypatch: pytest.MonkeyPatch) -> None:
    """Sixteen processes on sixteen cores render fewer images than eight: clients and kernel need cores, too."""
    settings = load({"workers": "auto", "only": "render"})
    for cpus, processes in ((1, 1), (2, 1), (5, 2), (16, 8)):
        monkeypatch.setattr("gateway.runtime.settings.settings.usable_cpus", lambda cpus=cpus: cpus)
        assert settings.processes == processes
    with pytest.raises(SettingsError, match=r"^--workers auto needs --only render: "):
        load({"workers": "auto"})


def test_several_processes_may_render_before_a_file() -> None:
    assert load({"workers": "4", "only": "render", "backdrop": "room.glb"}).workers == 4


def test_complete_certificates_are_accepted() -> None:
    settings = load(
        {"grpc_certificate": "c", "grpc_key": "k", "grpc_client_ca": "a", "http_certificate": "d", "http_key": "l"}
    )
    assert (settings.grpc_client_ca, settings.http_key) == (Path("a"), Path("l"))


@pytest.mark.parametrize(("name", "value"), [("http_port", 0), ("http_port", 65535), ("grpc_port", 0)])
def test_the_first_and_the_last_port(name: str, value: int) -> None:
    assert getattr(load({name: str(value)}), name) == value


@pytest.mark.parametrize(("text", "port"), [("off", None), ("0", 0), ("7700", 7700)])
def test_ports_that_may_be_off(text: str, port: int | None) -> None:
    assert load({"tcpq_port": text}).tcpq_port == port


@pytest.mark.parametrize(
    ("text", "allowed"),
    [
        ("1,2,3,1,0,0,0", True),
        ('["robot", "head"]', True),
        (' ["robot"]', True),
        ("eye=1,2,3;target=0,0,0", True),
        ("1,2,3", False),
        ("[1.5]", False),
    ],
)
def test_mounts_of_further_cameras(text: str, allowed: bool) -> None:
    if allowed:
        assert load({"stereo_cameras": text}).stereo_cameras == (text,)
    else:
        with pytest.raises(SettingsError):
            load({"stereo_cameras": text})


@pytest.mark.parametrize(("count", "allowed"), [(15, True), (16, False)])
def test_the_number_of_further_cameras(count: int, allowed: bool) -> None:
    text = "|".join(["1,2,3,1,0,0,0"] * count)
    if allowed:
        assert len(load({"stereo_cameras": text}).stereo_cameras) == count
    else:
        with pytest.raises(SettingsError):
            load({"stereo_cameras": text})


@pytest.mark.parametrize(
    ("text", "path"), [("/proxy/8000/", "/proxy/8000"), ("/user/%C3%A4nn", "/user/änn"), ("/", ""), ("", "")]
)
def test_root_paths(text: str, path: str) -> None:
    assert Settings(root_path=text).root_path == path


@pytest.mark.parametrize("text", ["proxy", "//host/x", "/a?b", "/a b", "https://host/x"])
def test_other_texts_are_no_root_paths(text: str) -> None:
    with pytest.raises(ValueError, match="must be a path such as"):
        Settings(root_path=text)


@pytest.mark.parametrize(
    ("text", "allowed"),
    [
        ("*", True),
        ("http://localhost:8888", True),
        ("https://*.example.org", True),
        ("vscode-webview:", True),
        ("localhost:8888", False),
        ("http://a;script-src *", False),
        ("http://a\r\nX: y", False),
        ("http://a/b", False),
    ],
)
def test_origins_of_frames_cannot_end_the_header(text: str, allowed: bool) -> None:
    try:
        assert Settings(frame_origins=(text,)).frame_origins == (text,)
        accepted = True
    except ValueError:
        accepted = False
    assert accepted == allowed


@pytest.mark.parametrize(
    ("value", "folders", "anywhere"),
    [(None, (), True), ("off", (), False), ("/a", ("/a",), False), ("auto:/a", ("/a",), True)],
)
def test_mesh_root(value: str | None, folders: tuple[str, ...], anywhere: bool) -> None:
    flags = {} if value is None else {"mesh_root": value}
    assert load(flags).mesh_folders == tuple(map(Path, folders))
    assert load(flags).local_clients_read_all_folders == anywhere
    assert not load({**flags, "root_path": "/gate"}).local_clients_read_all_folders, "a proxy is in front"
