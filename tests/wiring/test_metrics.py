"""Metrics of a gateway after requests of each kind: values, HELP texts, documentation, alerts."""

import json
import re
import shutil
import subprocess
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import grpc
import promql_parser
import pytest

from scenegate.camera import image_interface_pb2 as pb
from tests.support import clients, forms
from tests.support.gateway_process import gateway_process
from tests.support.waiting import SECONDS

ALERTS = Path(__file__).parents[2] / "deploy" / "prometheus"


@pytest.fixture(scope="module")
def helps() -> dict[str, str]:
    """HELP texts of /metrics by name; filled by ``figures``."""
    return {}


@pytest.fixture(scope="module")
def figures(helps: dict[str, str]) -> Iterator[dict[str, float]]:
    """All samples of /metrics by name and labels, after a few requests of each kind."""
    flags = ("--demo", "--grpc-port", "0", "--tcpq-port", "0", "--lcm-url", "off")
    with gateway_process(*flags) as (_, url), clients.Client(base_url=url) as http:
        headers = {"Content-Type": forms.CONTENT_TYPE}
        for image_type in ("color", "depth", "label", "color"):
            body = forms.body(forms.gltf(), forms.drake_fields(image_type))
            assert http.post("/render", content=body, headers=headers).status_code == 200
        bad = forms.body(forms.gltf(), forms.drake_fields("color", width="-1"))
        assert http.post("/render", content=bad, headers=headers).status_code == 400
        interfaces = http.get("/healthz").json()["interfaces"]
        port = interfaces["stereo"]["port"]
        assert interfaces["stereo"]["where"] == f"gRPC on port {port}"
        assert interfaces["treeviewer"]["where"] == "TCPQ"
        with grpc.insecure_channel(f"127.0.0.1:{port}") as channel:
            stream = channel.unary_stream(
                "/ImageInterface/StreamImageSets", pb.ImageSetRequest.SerializeToString, pb.ImageSet.FromString
            )(pb.ImageSetRequest(left_enabled=True), timeout=SECONDS)
            next(stream)
            text = http.get("/metrics").text
            stream.cancel()
        helps.update(re.findall(r"^# HELP (scenegate_\w+) (.*)$", text, re.MULTILINE))
        samples = [line.rpartition(" ") for line in text.splitlines() if not line.startswith("#")]
        yield {name: float(value) for name, _, value in samples}


def test_renders_by_type_and_outcome(figures: dict[str, float]) -> None:
    assert figures['scenegate_renders_total{outcome="ok",type="color"}'] == 2
    assert figures['scenegate_renders_total{outcome="ok",type="label"}'] == 1
    assert figures['scenegate_renders_total{outcome="rejected",type="unknown"}'] == 1
    for stage in ("receive", "form", "queue", "parse", "render", "encode", "send"):
        assert figures[f'scenegate_render_stage_duration_seconds_count{{stage="{stage}"}}'] == 4
        assert 0 <= figures[f'scenegate_render_stage_duration_seconds_sum{{stage="{stage}"}}'] < SECONDS
    assert figures["scenegate_render_waiting_limit"] == 256


def test_caches(figures: dict[str, float]) -> None:
    assert figures['scenegate_cache_hits_total{cache="scenes"}'] == 3
    assert figures['scenegate_cache_misses_total{cache="scenes"}'] == 1
    assert figures['scenegate_cache_bytes{cache="scenes"}'] > 0
    assert figures['scenegate_cache_bytes{cache="prepared_meshes"}'] > 0
    assert figures["scenegate_cache_limit_bytes"] == 1 << 30


def test_streams_tree_and_messages(figures: dict[str, float]) -> None:
    assert figures["scenegate_stereo_streams"] == 1
    assert figures["scenegate_stereo_sets_sent_total"] >= 1
    assert figures["scenegate_stereo_sets_skipped_total"] >= 0
    assert figures["scenegate_tree_nodes"] > figures["scenegate_tree_geometry_nodes"] > 10
    assert figures["scenegate_tree_revision"] >= 1
    assert figures["scenegate_history_bytes"] > 0
    assert 0 < figures["scenegate_history_duration_seconds"] <= 60
    assert figures['scenegate_lcm_messages_total{what="received"}'] == 0
    assert figures['scenegate_lcm_lost_total{reason="datagrams"}'] == 0
    assert figures['scenegate_interface_ready{interface="stereo"}'] == 1


def test_help_texts_are_complete_sentences(figures: dict[str, float], helps: dict[str, str]) -> None:
    assert len(helps) > 30
    assert len(set(helps.values())) == len(helps)
    for name, text in helps.items():
        assert len(text.split()) >= 4, (name, text)
        assert text.endswith("."), (name, text)
        assert not re.match(r"(Those|Their|They|It|What|Which|Of|From|As) ", text), (name, text)
        for unit in ("seconds", "bytes"):
            assert not re.search(rf"_{unit}(_total)?$", name) or text.startswith(unit.capitalize()), (name, text)


def test_durations_are_named_so_and_there_are_no_created_series(figures: dict[str, float]) -> None:
    names = {re.split(r"[ {]", name)[0] for name in figures if name.startswith("scenegate_")}
    assert not [name for name in figures if "_created" in name]
    seconds = [re.sub(r"_(bucket|sum|count)$", "", name) for name in names if "_seconds" in name]
    assert seconds
    assert [name for name in seconds if not name.endswith("_duration_seconds")] == []


def test_alerts_use_existing_metrics(figures: dict[str, float]) -> None:
    there = {re.split(r"[ {]", name)[0] for name in figures}
    asked = set(re.findall(r"\bscenegate_\w+", (ALERTS / "alerts.yml").read_text()))
    assert asked
    assert asked <= there


def test_each_alert_has_a_test() -> None:
    alerts = re.findall(r"alert: (\w+)", (ALERTS / "alerts.yml").read_text())
    tested = re.findall(r'alertname="(\w+)"', (ALERTS / "alerts_test.yml").read_text())
    assert alerts
    assert sorted(tested) == sorted(alerts)


def test_each_alert_fires_when_it_should() -> None:
    promtool = shutil.which("promtool")
    if promtool is None:
        pytest.skip("promtool is not installed (on Debian: apt install prometheus)")
    for command in (("check", "config", "prometheus.yml"), ("test", "rules", "alerts_test.yml")):
        done = subprocess.run([promtool, *command], cwd=ALERTS, capture_output=True, text=True, check=False)
        assert done.returncode == 0, done.stdout + done.stderr


def test_the_dashboard_asks_for_metrics_and_labels_that_there_are(figures: dict[str, float]) -> None:
    labels_of: dict[str, set[str]] = {}
    for sample in figures:
        name, _, labels = sample.partition("{")
        labels_of.setdefault(name, {"instance", "job"}).update(re.findall(r'(\w+)="', labels))
    asked: set[str] = set()
    for query, legend in dashboard_queries():
        metrics, given = metrics_and_labels(promql_parser.parse(query))
        assert metrics, query
        assert metrics <= labels_of.keys(), query
        there = set.intersection(*(labels_of[name] for name in metrics))
        assert given | set(re.findall(r"{{(\w+)}}", legend)) <= there, (query, legend)
        asked |= metrics
    assert len(asked) > 30
    alerts = set(re.findall(r"\bscenegate_\w+", (ALERTS / "alerts.yml").read_text()))
    assert alerts <= asked, "who gets an alert finds its metric on the dashboard"


def dashboard_queries() -> Iterator[tuple[str, str]]:
    """Yield the query and the legend of each line of the dashboard, with values for Grafana's variables."""
    dashboard = json.loads((ALERTS.parent / "grafana/dashboards/scenegate.json").read_text("utf-8"))
    (variable,) = dashboard["templating"]["list"]
    metric, label = re.findall(r"\w+", variable["query"]["query"])[1:]
    yield f"count by ({label}) ({metric})", ""
    for panel in dashboard["panels"]:
        assert panel["type"] == "row" or panel["targets"], panel["title"]
        for target in panel.get("targets", ()):
            query = target["expr"].replace("$__rate_interval", "5m").replace(f"${variable['name']}", ".*")
            assert "$" not in query
            yield query, target["legendFormat"]


def metrics_and_labels(expression: Any) -> tuple[set[str], set[str]]:
    """Return the names of metrics and of labels in a query."""
    metrics: set[str] = set()
    labels: set[str] = set()
    selector = getattr(expression, "vector_selector", expression)
    if isinstance(selector, promql_parser.VectorSelector):
        assert selector.name is not None
        metrics.add(selector.name)
        labels.update(matcher.name for matcher in selector.matchers.matchers)
    modifier = getattr(expression, "modifier", None)
    labels.update(getattr(modifier, "labels", None) or ())
    parts = [*getattr(expression, "args", ()), *(getattr(expression, name, None) for name in ("expr", "lhs", "rhs"))]
    for part in filter(None, parts):
        inner_metrics, inner_labels = metrics_and_labels(part)
        metrics |= inner_metrics
        labels |= inner_labels
    return metrics, labels
