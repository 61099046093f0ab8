"""``scenegate check``: prints a table of the installation and of the machine's settings."""

from __future__ import annotations

from rich.console import Console
from rich.table import Table

from gateway.runtime.diagnostics import Verdict, findings
from gateway.runtime.worker_pool import usable_cpus
from gateway.settings import load
from gateway.wiring import warmup

_STYLE = {Verdict.OK: "green", Verdict.NOTE: "yellow", Verdict.BAD: "red"}
SERVER_OF_SETTING = {"http_port": "HTTP", "grpc_port": "gRPC", "tcpq_port": "TCPQ hub", "rest_port": "device REST"}
"""Name of the server behind each port setting."""


def print_findings() -> bool:
    """Print the table; return whether there is no error in it."""
    settings = load()
    ports = {label: port for name, label in SERVER_OF_SETTING.items() if (port := getattr(settings, name)) is not None}
    table = Table(box=None, pad_edge=False)
    for heading in ("what", "", "finding"):
        table.add_column(heading, overflow="fold")
    good = True
    for finding in findings(settings.host, ports, settings.threads or usable_cpus(), warmup.PARTS):
        good = good and finding.verdict is not Verdict.BAD
        table.add_row(finding.subject, f"[{_STYLE[finding.verdict]}]{finding.verdict.value}[/]", finding.detail)
    Console(highlight=False).print(table)
    return good
