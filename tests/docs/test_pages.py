"""Links, files, commands and flags in the documentation exist."""

import re
import shlex
from functools import cache
from pathlib import Path
from typing import Any

import pytest
import typer.main

from gateway.cli.commands import app
from gateway.runtime.settings import Settings
from gateway.runtime.settings.option import env_of
from gateway.runtime.settings.setting_sources import NON_SETTING_VARIABLES
from scenegate.cli import CLIENT_COMMANDS, command_parser
from tests.docs.pages import GENERATED, PAGES, ROOT, anchors, blocks, commands, links, prose, spans

FOREIGN = {
    "--backup", "--blend_file", "--bpy_settings_file", "--force-reinstall", "--ignore-scripts", "--only-binary",
    "--peers", "--profile", "--rm", "--secret", "--step", "--steps", "--upgrade", "--workers", "--live", "--network",
    "--announce", "--url", "--data-binary", "--no-build-isolation", "--lcm", "--out", "--pictures",
}  # fmt: skip
"""Flags of other programs and of our benches that pages may mention."""


@cache
def known() -> dict[tuple[str, ...], set[str]]:
    """Return the flags of each command."""
    found: dict[tuple[str, ...], set[str]] = {}

    def walk(command: Any, name: tuple[str, ...]) -> None:
        found[name] = {"--help"} | {
            option for parameter in command.params for option in (*parameter.opts, *parameter.secondary_opts)
        }
        for child, below in getattr(command, "commands", {}).items():
            walk(below, (*name, child))

    walk(typer.main.get_command(app), ())
    found[()].add("--version")
    for name in CLIENT_COMMANDS:
        actions = command_parser(name)._actions  # noqa: SLF001 - argparse has no public list of options
        found[name,] = {flag for action in actions for flag in action.option_strings}
    return found


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_links_lead_somewhere(page: Path) -> None:
    for link in links(page):
        if link.startswith(("http://", "https://", "mailto:")):
            continue
        path, _, anchor = link.partition("#")
        target = (page.parent / path).resolve() if path else page
        if target in GENERATED and not target.exists():
            continue
        assert target.exists(), f"{link}: there is no {target}"
        assert target.is_relative_to(ROOT), f"{link} leads out of the repository"
        if anchor:
            assert anchor in anchors(target), f"{link}: {target.name} has {sorted(anchors(target))}"


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_files_that_are_named_are_there(page: Path) -> None:
    pattern = re.compile(r"(gateway|renderers|examples|tests|docs|bench|protos|lcmtypes)/[\w./-]+")
    for span in spans(page):
        if pattern.fullmatch(span) and "NAME" not in span:
            assert (ROOT / span).exists(), span


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_commands_and_flags_exist(page: Path) -> None:
    lines = [line for block in blocks(page) if block.language in ("", "sh", "bash") for line in commands(block)]
    for text in (*lines, *spans(page)):
        for command in re.split(r"&&|\|\||[|;](?!\w+=)|\s&(?:\s|$)", text):
            words = split(command)
            while words and re.fullmatch(r"[A-Z_]+=.*|time|nice|sudo|exec", words[0]):
                words = words[1:]
            if words and words[0].rpartition("/")[2] == "scenegate":
                check_command(words[1:], command)
    flags = {re.split(r"[ =]", span)[0] for span in spans(page) if span.startswith("--")}
    everywhere = set().union(*known().values()) | FOREIGN
    assert flags <= everywhere, f"no command has {sorted(flags - everywhere)}"


def split(text: str) -> list[str]:
    """Return the words of a command; a text that is no valid shell (an odd apostrophe) is split at spaces."""
    try:
        return shlex.split(text, comments=True)
    except ValueError:
        return text.split()


def check_command(words: list[str], text: str) -> None:
    name: tuple[str, ...] = ()
    while words and (*name, words[0]) in known():
        name, words = (*name, words[0]), words[1:]
    assert name or not words or words[0].startswith("-"), f"{text}: there is no command {words[:1]}"
    for word in words:
        if re.match(r"--?[a-zA-Z]", word):
            assert word.partition("=")[0] in known()[name], f"{text}: {' '.join(name)} has no {word}"


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_variables_exist(page: Path) -> None:
    if page.name == "CONTRIBUTING.md":  # those of the tests
        return
    allowed = NON_SETTING_VARIABLES | {env_of(name) for name in Settings.model_fields}
    text = page.read_text("utf-8")
    assert set(re.findall(r"\bSCENEGATE_[A-Z_]+[A-Z]\b", text)) <= allowed


def test_index_and_site_have_every_page() -> None:
    docs = ROOT / "docs"
    pages = {*docs.rglob("*.md"), *GENERATED}
    indices = [page for page in pages if page.name == "README.md"]
    listed = {(index.parent / link).resolve() for index in indices for link in links(index)}
    assert pages - {docs / "README.md"} <= listed
    navigation = (ROOT / "mkdocs.yml").read_text("utf-8")
    assert [page for page in pages if f" {page.relative_to(docs)}\n" not in navigation] == []


def test_the_tools_of_this_test_find_something() -> None:
    assert len(PAGES) > 10
    assert sum(len(links(page)) for page in PAGES) > 30
    assert ("dataset", "check") in known()
    assert "how-to-add" in anchors(ROOT / "CONTRIBUTING.md")
    with pytest.raises(AssertionError, match="serve has no --http-prot"):
        check_command(["serve", "--http-prot", "1"], "scenegate serve --http-prot 1")
    with pytest.raises(AssertionError, match="there is no command"):
        check_command(["server"], "scenegate server")
    assert "```" not in prose(ROOT / "README.md")
