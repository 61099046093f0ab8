"""``scenegate doctor``: prints findings about the installation and the machine, with meaning and remedy.

Imports are late: the command has to work where libraries or packages of ours do not.
"""

import sys
from collections import Counter
from collections.abc import Iterable, Iterator

from gateway.runtime.installation import Finding, Verdict, installation_findings
from scenegate.printable import printable

_STYLE = {Verdict.OK: "green", Verdict.NOTE: "yellow", Verdict.ERROR: "red"}
SERVER_OF_SETTING = {
    "http_port": "HTTP",
    "grpc_port": "gRPC",
    "tcpq_port": "TCPQ hub",
    "rest_port": "device REST",
    "foxglove_port": "Foxglove",
}
"""Name of the server behind each port setting."""


def print_findings() -> bool:
    """Print the table of findings. Return True if none of them is an error."""
    found = list(all_findings())
    counts = Counter(finding.verdict for finding in found)
    try:
        _print_table(found)
    except ImportError:  # of rich, which is one of the findings
        for finding in found:
            sys.stdout.write(f"{finding.subject}: {finding.verdict.value}: {_description(finding)}\n")
    numbers = [(counts[Verdict.ERROR], "error"), (counts[Verdict.NOTE], "note")]
    sys.stdout.write("\n" + ", ".join(f"{n} {word}{'' if n == 1 else 's'}" for n, word in numbers) + ".\n")
    return not counts[Verdict.ERROR]


def all_findings() -> Iterator[Finding]:
    """Run all checks. Those of the settings and the machine need libraries; without them they are one finding."""
    yield from installation_findings()
    try:
        yield from _settings_and_machine()
    except Exception as error:  # noqa: BLE001 - broken libraries raise anything
        reason = f"not checked: {type(error).__name__}: {error}"
        yield Finding("this machine", Verdict.ERROR, reason, "Scenegate does not start.", "mend the errors above first")


def _settings_and_machine() -> Iterator[Finding]:
    from gateway.runtime.diagnostics import findings
    from gateway.runtime.settings import Settings, SettingsError, load, unknown_environment
    from gateway.runtime.settings.option import flag_of

    for sentence in unknown_environment():
        yield Finding("environment", Verdict.NOTE, sentence, "It changes nothing.", "correct the name, or unset it")
    try:
        settings = load()
    except SettingsError as error:
        yield Finding("settings", Verdict.ERROR, str(error), "Scenegate does not start.", "correct the value")
        settings = Settings.model_construct()  # defaults, without the environment
    ports = {
        flag_of(name): (label, port)
        for name, label in SERVER_OF_SETTING.items()
        if (port := getattr(settings, name)) is not None
    }
    yield from findings(settings.host, ports)


def _print_table(found: Iterable[Finding]) -> None:
    from rich.console import Console
    from rich.markup import escape
    from rich.table import Table

    table = Table(box=None, pad_edge=False)
    for heading in ("what", "state", "finding"):
        table.add_column(heading, overflow="fold")
    for finding in found:
        state = f"[{_STYLE[finding.verdict]}]{finding.verdict.value}[/]"
        table.add_row(finding.subject, state, escape(_description(finding)))
    Console(highlight=False).print(table)


def _description(finding: Finding) -> str:
    """Return detail, meaning and remedy, one line each."""
    remedy = f"To do: {finding.remedy}" if finding.remedy else ""
    return "\n".join(printable(line) for line in (finding.detail, finding.meaning, remedy) if line)
