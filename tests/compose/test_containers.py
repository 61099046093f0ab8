"""docker-compose.yml with containers: every profile does its work, and the other tests of this folder pass in one."""

import os
import re
import time
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import TypeVar

import httpx2
import pytest

from tests.support import clients
from tests.support.engines import BASE, Engine, Project, engines
from tests.support.forms import CONTENT_TYPE, body
from tests.support.waiting import SECONDS

pytestmark = [pytest.mark.compose, pytest.mark.slow]

IMAGES = {"scenegate": "deploy/Dockerfile", "scenegate-test": "tests/compose/Dockerfile"}
RECORDED = 250
"""Image sets of docker-compose.yml's recorder."""
RENDERS = 120
SCENE = {"asset": {"version": "2.0"}, "scene": 0, "scenes": [{}]}

Value = TypeVar("Value")


@pytest.fixture(scope="module", params=["docker", "podman"])
def engine(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Engine:
    """An engine with both images built from this working tree, on the pinned base or one of its name."""
    if os.environ.get("SCENEGATE_URL"):
        pytest.skip("SCENEGATE_URL names a gateway: these may be the tests in the container")
    found, missing = engines()
    if request.param in missing:
        pytest.skip(missing[request.param])
    chosen = found[request.param]
    if not chosen.has_base():
        chosen = chosen.by_tags(tmp_path_factory.mktemp("files"))
        if not chosen.has_base():
            pytest.skip(f"{chosen.name} cannot pull the base image {BASE}")
    for tag, dockerfile in IMAGES.items():
        built = chosen.build(tag, dockerfile)
        assert built.returncode == 0, built.stderr[-4000:]
    return chosen


def wait_for(what: str, ask: Callable[[], Value | None]) -> Value:
    """The first answer that is not None and not empty."""
    limit = time.monotonic() + SECONDS
    said: object = None
    while time.monotonic() < limit:
        try:
            if found := ask():
                return found
        except httpx2.TransportError as error:
            said = error
        time.sleep(0.1)
    raise AssertionError(f"{what} did not come in {SECONDS:.0f} s; {said or ''}")


def ready(project: Project) -> bool | None:
    return clients.get(f"{project.url('HTTP_PORT')}/readyz").status_code == 200 or None


@contextmanager
def needs(engine: Engine, service: str) -> Iterator[Project]:
    """A project, where the image of a service of others is to be had."""
    if not engine.has_for(service):
        pytest.skip(f"{engine.name} cannot pull the image of {service}")
    with engine.project() as project:
        yield project


def test_the_gateway_is_soon_ready(engine: Engine) -> None:
    with engine.project() as project:
        project.up("", "gateway")
        wait_for("readiness", lambda: ready(project))
        (container,) = project.containers("gateway")
        engine.run("exec", container, "python", "-m", "gateway.runtime.http.healthcheck")
        assert engine.run("exec", container, "id", "-u").strip() == "10001"
        written = "for f in /opt/x /var/lib/scenegate/x /tmp/x; do touch $f && echo $f; done; true"
        assert engine.run("exec", container, "sh", "-c", written).split() == ["/tmp/x"], "the root is read-only"


def test_the_tests_pass_in_a_container(engine: Engine) -> None:
    with engine.project() as project:
        project.profiles["test"] = None
        ran = project.compose("--profile=test", "run", "--rm", "-T", "test")
        assert ran.returncode == 0, ran.stdout[-4000:] + ran.stderr[-4000:]
        passed = re.search(r"(\d+) passed", ran.stdout)
        assert passed is not None
        assert int(passed[1]) >= 14, "LCM and the browser were there, too"


def test_demo_publishes_and_records(engine: Engine) -> None:
    with engine.project() as project:
        project.up("demo")
        (recorder,) = wait_for("the recorder", lambda: project.containers("recorder"))
        wait_for("the rover", lambda: "rover" in clients.get(f"{project.url('HTTP_PORT')}/scene").text or None)
        ended = engine.run("wait", recorder).strip()
        assert ended == "0", engine.run("logs", recorder)[-4000:]
        listed = f"{project.name}_recorded:/recorded"
        files = engine.run("run", "--rm", "-v", listed, "--entrypoint", "find", "scenegate", "/recorded", "-type", "f")
    counts = {kind: len(re.findall(rf"_{kind}\.png$", files, re.MULTILINE)) for kind in ("left", "disparity")}
    assert counts == {"left": RECORDED, "disparity": RECORDED}


def test_haproxy_spreads_renders(engine: Engine) -> None:
    with needs(engine, "haproxy") as project:
        project.up("scale", "--scale", "render=3", "haproxy", "render")
        replicas = project.containers("render")
        assert len(replicas) == 3
        request = body(SCENE)
        with clients.Client(base_url=project.url("SCALE_PORT")) as client:

            def render() -> int:
                answer = client.post("/render", content=request, headers={"content-type": CONTENT_TYPE})
                return answer.status_code

            wait_for("a replica behind HAProxy", lambda: render() == 200 or None)
            wait_for("all replicas", lambda: all(drawn(engine, each) is not None for each in replicas) or None)
            before = {each: drawn(engine, each) or 0 for each in replicas}
            statuses = [render() for _ in range(RENDERS)]
        share = [(drawn(engine, each) or 0) - before[each] for each in replicas]
    assert statuses == [200] * RENDERS
    assert sum(share) == RENDERS
    assert min(share) > 0


def drawn(engine: Engine, container: str) -> int | None:
    """Renders that a replica says it has answered; None: it is not ready."""
    ask = (
        "import urllib.request as u; o = lambda p: u.urlopen('http://127.0.0.1:8000' + p).read().decode();"
        "o('/readyz'); print([x.split()[1] for x in o('/metrics').splitlines() if x.startswith"
        "('scenegate_renders_total{') and 'outcome=\"ok\"' in x])"
    )
    try:
        said = engine.run("exec", container, "python", "-c", ask)
    except AssertionError:
        return None
    return sum(int(float(value)) for value in re.findall(r"'([\d.e+]+)'", said))


def test_prometheus_scrapes_every_target(engine: Engine) -> None:
    with needs(engine, "prometheus") as project:
        project.up("observe", "gateway", "prometheus")
        expected = {"scenegate": 1}
        if engine.has_for("haproxy"):
            project.up("scale", "--scale", "render=2", "haproxy", "render")
            expected = {"scenegate": 3, "haproxy": 1}
        api = f"{project.url('PROMETHEUS_PORT')}/api/v1"

        def up() -> bool | None:
            active = clients.get(f"{api}/targets").json()["data"]["activeTargets"]
            return Counter(each["labels"]["job"] for each in active if each["health"] == "up") == expected or None

        wait_for(f"Prometheus with the targets {expected}", up)
        answer = clients.get(f"{api}/query", params={"query": "sum(scenegate_interface_ready)"}).json()
        groups = clients.get(f"{api}/rules").json()["data"]["groups"]
    alerts = [rule["name"] for group in groups for rule in group["rules"]]
    assert float(answer["data"]["result"][0]["value"][1]) >= 1
    assert alerts
