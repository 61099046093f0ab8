"""``scenegate doctor``: prints findings about the installation and the machine, with meaning and remedy."""

from __future__ import annotations

from collections import Counter

from rich.console import Console
from rich.markup import escape
from rich.table import Table

from gateway.runtime.diagnostics import Finding, Verdict, findings
from gateway.runtime.worker_pool import usable_cpus
from gateway.settings import load
from gateway.settings.option import flag_of
from gateway.wiring import warmup

_STYLE = {Verdict.OK: "green", Verdict.NOTE: "yellow", Verdict.ERROR: "red"}
SERVER_OF_SETTING = {"http_port": "HTTP", "grpc_port": "gRPC", "tcpq_port": "TCPQ hub", "rest_port": "device REST"}
"""Name of the server behind each port setting."""


def print_findings() -> bool:
    """Print the table of findings. Return True if none of them is an error."""
    settings = load()
    ports = {
        flag_of(name): (label, port)
        for name, label in SERVER_OF_SETTING.items()
        if (port := getattr(settings, name)) is not None
    }
    table = Table(box=None, pad_edge=False)
    for heading in ("what", "state", "finding"):
        table.add_column(heading, overflow="fold")
    counts: Counter[Verdict] = Counter()
    for finding in findings(settings.host, ports, settings.threads or usable_cpus(), warmup.PARTS):
        counts[finding.verdict] += 1
        table.add_row(finding.subject, f"[{_STYLE[finding.verdict]}]{finding.verdict.value}[/]", _description(finding))
    console = Console(highlight=False)
    console.print(table)
    console.print(f"\n{counts[Verdict.ERROR]} errors, {counts[Verdict.NOTE]} notes.")
    return not counts[Verdict.ERROR]


def _description(finding: Finding) -> str:
    """Return detail, meaning and remedy, one line each, escaped for rich."""
    remedy = f"To do: {finding.remedy}" if finding.remedy else ""
    return "\n".join(escape(line) for line in (finding.detail, finding.meaning, remedy) if line)
