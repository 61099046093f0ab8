"""Spans of a gateway as an OpenTelemetry collector gets them, and of parts of it in memory."""

import asyncio
import gzip
import itertools
import socket
import sys
import threading
import time
from collections.abc import Callable, Iterator
from http.server import BaseHTTPRequestHandler
from typing import Any

import grpc
import pytest
from opentelemetry import trace
from opentelemetry.exporter.otlp.proto.http.trace_exporter import OTLPSpanExporter
from opentelemetry.proto.collector.trace.v1.trace_service_pb2 import ExportTraceServiceRequest
from opentelemetry.proto.trace.v1.trace_pb2 import Span
from opentelemetry.sdk.trace import TracerProvider
from opentelemetry.sdk.trace.export import BatchSpanProcessor, SimpleSpanProcessor
from opentelemetry.sdk.trace.export.in_memory_span_exporter import InMemorySpanExporter
from structlog.testing import capture_logs

from gateway.runtime.logs import tracing
from gateway.runtime.workers.worker_pool import WorkerPool
from gateway.wiring import telemetry
from scenegate import Box, TreeViewer
from scenegate.camera import image_interface_pb2 as pb
from tests.support import clients, forms
from tests.support.gateway_process import gateway_process
from tests.support.http_stub import http_server
from tests.support.waiting import SECONDS


class Collector:
    """Takes spans over OTLP/HTTP."""

    def __init__(self) -> None:
        self.spans: list[Span] = []
        self.resources: list[dict[str, str]] = []

    def take(self, request: BaseHTTPRequestHandler) -> tuple[int, bytes]:
        body = request.rfile.read(int(request.headers["Content-Length"]))
        if request.headers.get("Content-Encoding") == "gzip":
            body = gzip.decompress(body)
        for part in ExportTraceServiceRequest.FromString(body).resource_spans:
            self.resources.append({a.key: a.value.string_value for a in part.resource.attributes})
            self.spans += [span for scope in part.scope_spans for span in scope.spans]
        return 200, b""


@pytest.fixture(scope="module")
def collector() -> Collector:
    """Spans of two renders, one of which fails, of a stereo set, a request over LCM and paths without spans."""
    collector = Collector()
    with http_server(collector.take) as url:
        _use_every_interface(url)
    return collector


def _use_every_interface(endpoint: str) -> None:
    flags = ("--demo", "--grpc-port", "0", "--tcpq-port", "0", "--lcm-url", "off")
    environment = {"OTEL_EXPORTER_OTLP_ENDPOINT": endpoint, "OTEL_RESOURCE_ATTRIBUTES": "deployment.environment=test"}
    headers = {"Content-Type": forms.CONTENT_TYPE, "traceparent": f"00-{'ab' * 16}-{'cd' * 8}-01"}
    with gateway_process(*flags, env=environment) as (gateway, url), clients.Client(base_url=url) as http:
        form = forms.body(forms.gltf(), forms.drake_fields("color"))
        assert http.post("/render", content=form, headers=headers).status_code == 200
        form = forms.body(b"no glTF", forms.drake_fields("color"))
        assert http.post("/render", content=form, headers=headers).status_code == 400
        interfaces = http.get("/healthz").json()["interfaces"]
        assert http.get("/scene?token=secret").status_code == 200
        with TreeViewer(f"tcpq://127.0.0.1:{interfaces['treeviewer']['port']}", timeout=SECONDS) as viewer:
            viewer["box"].set(Box((1, 1, 1)))
        with grpc.insecure_channel(f"127.0.0.1:{interfaces['stereo']['port']}") as channel:
            call = channel.unary_stream(
                "/ImageInterface/StreamImageSets", pb.ImageSetRequest.SerializeToString, pb.ImageSet.FromString
            )
            stream = call(pb.ImageSetRequest(left_enabled=True, disparity_enabled=True), timeout=SECONDS)
            next(stream)
            next(stream)
            stream.cancel()
        assert gateway.stop() == 0


def children(spans: list[Span], parent: Span) -> list[Span]:
    below = [span for span in spans if span.parent_span_id == parent.span_id]
    return sorted(below, key=lambda span: span.start_time_unix_nano)


def attributes(span: Span) -> dict[str, Any]:
    return {a.key: a.value.string_value or a.value.int_value for a in span.attributes}


@pytest.mark.slow
def test_a_render_has_a_span_for_each_stage(collector: Collector) -> None:
    request, rejected = (span for span in collector.spans if span.name == "POST /render")
    stages = children(collector.spans, request)
    assert [stage.name for stage in stages] == ["queue", "parse", "render", "encode"]
    assert request.trace_id.hex() == "ab" * 16, "the client's own trace goes on"
    assert request.parent_span_id.hex() == "cd" * 8
    assert attributes(request)["http.response.status_code"] == 200
    for before, after in itertools.pairwise(stages):
        assert request.start_time_unix_nano <= before.start_time_unix_nano
        assert before.end_time_unix_nano <= after.start_time_unix_nano
        assert after.end_time_unix_nano <= request.end_time_unix_nano
    assert [stage.name for stage in children(collector.spans, rejected)] == ["queue", "parse"]
    failed = children(collector.spans, rejected)[-1]
    assert failed.status.code == failed.status.STATUS_CODE_ERROR
    assert failed.status.message.startswith("GltfError: ")
    assert not failed.events, "a traceback may show data of clients"


@pytest.mark.slow
def test_a_stereo_set_has_spans_of_its_images(collector: Collector) -> None:
    frame = next(span for span in collector.spans if span.name == "stereo frame")
    assert frame.parent_span_id == b""
    (image_set,) = children(collector.spans, frame)
    assert (image_set.name, attributes(image_set)["stereo.set"]) == ("stereo set", "left+disparity")
    parts = children(collector.spans, image_set)
    assert {part.name for part in parts} >= {"meter", "expose", "depth", "serialise"}
    assert parts[-1].name == "serialise"
    exposed = next(part for part in parts if part.name == "expose")
    assert attributes(exposed)["stereo.image"] == "left"
    assert [span.name for span in children(collector.spans, exposed)] == ["queue"], "the thread's span is below it"


@pytest.mark.slow
def test_a_request_over_lcm_has_a_span(collector: Collector) -> None:
    messages = [span for span in collector.spans if span.name == "process LCM message"]
    assert messages
    for message in messages:
        assert message.kind == Span.SPAN_KIND_CONSUMER
        about = attributes(message)
        assert about["messaging.system"] == "lcm"
        assert about["messaging.destination.name"].startswith("DIRECTOR_TREE_VIEWER_REQUEST")
        assert about["messaging.message.body.size"] > 0


@pytest.mark.slow
def test_monitoring_and_tokens_are_in_no_span(collector: Collector) -> None:
    paths = [attributes(span).get("url.path", "") for span in collector.spans]
    assert "/render" in paths
    assert not {"/healthz", "/scene"} & set(paths)
    assert "secret" not in str(collector.spans)


@pytest.mark.slow
def test_the_service_has_a_name(collector: Collector) -> None:
    resource = collector.resources[0]
    assert resource["service.name"] == "scenegate"
    assert resource["service.version"]
    assert resource["deployment.environment"] == "test"


@pytest.fixture
def use() -> Iterator[Callable[[trace.TracerProvider | None], None]]:
    yield tracing.use
    tracing.use(None)


def test_a_worker_thread_carries_the_span_of_its_caller(use: Callable[[TracerProvider], None]) -> None:
    exporter, provider = InMemorySpanExporter(), TracerProvider()
    provider.add_span_processor(SimpleSpanProcessor(exporter))
    use(provider)

    def work() -> str:
        with tracing.span("work", attributes={"answer": 42}):
            return threading.current_thread().name

    async def call() -> str:
        pool = WorkerPool(1)
        await pool.run(work)  # no span around it: no span of the queue alone
        with tracing.span("caller"):
            thread = await pool.run(work)
        await pool.close()
        return thread

    assert asyncio.run(call()).startswith("worker")
    alone, queue, below, caller = exporter.get_finished_spans()
    assert [span.name for span in (alone, queue, below, caller)] == ["work", "queue", "work", "caller"]
    assert alone.parent is None
    for child in (queue, below):
        assert child.parent.span_id == caller.context.span_id
    assert below.attributes == {"answer": 42}


def test_without_a_collector_nothing_is_traced(use: Callable[[None], None]) -> None:
    for environment in (
        {},
        {"OTEL_EXPORTER_OTLP_ENDPOINT": ""},
        {"OTEL_EXPORTER_OTLP_ENDPOINT": "http://127.0.0.1:1", "OTEL_SDK_DISABLED": "TRUE"},
        {"OTEL_EXPORTER_OTLP_ENDPOINT": "http://127.0.0.1:1", "OTEL_TRACES_EXPORTER": "none"},
    ):
        assert telemetry.start(environment) is None
        assert telemetry.config() is telemetry.NO_TELEMETRY
    with tracing.span("nothing"), tracing.lcm_message_span("CHANNEL", 3):
        assert trace.get_current_span() is trace.INVALID_SPAN


def test_without_the_extra_a_warning_names_it(use: Callable[[None], None], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "opentelemetry.sdk.trace", None)
    with capture_logs() as entries:
        assert telemetry.start({"OTEL_EXPORTER_OTLP_TRACES_ENDPOINT": "http://127.0.0.1:1"}) is None
    (entry,) = entries
    assert "OTEL_EXPORTER_OTLP_TRACES_ENDPOINT is set" in entry["event"]
    assert "pip install 'scenegate[telemetry]'" in entry["event"]
    assert telemetry.config() is telemetry.NO_TELEMETRY


def test_a_provider_of_the_program_takes_the_spans(
    use: Callable[[None], None], monkeypatch: pytest.MonkeyPatch
) -> None:
    provider = TracerProvider()
    monkeypatch.setattr(trace, "get_tracer_provider", lambda: provider)
    assert telemetry.start({}) is None, "it is not ours to close"
    assert telemetry.config()["tracer_provider"] is provider


def test_a_collector_that_hangs_does_not_hold_the_end_up(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(telemetry, "CLOSE_SECONDS", 0.01)
    with socket.create_server(("127.0.0.1", 0)) as silent:
        url = f"http://127.0.0.1:{silent.getsockname()[1]}"
        exporter = OTLPSpanExporter(url, timeout=SECONDS)
        provider = TracerProvider(shutdown_on_exit=False)
        provider.add_span_processor(BatchSpanProcessor(exporter))
        provider.get_tracer("test").start_span("span").end()
        start = time.monotonic()
        telemetry.close(provider)
        assert time.monotonic() - start < SECONDS / 2
