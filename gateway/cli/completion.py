"""Commands of the client and ``--version`` as Typer's, so that the shell completes them."""

import argparse
import inspect
import os
from typing import Annotated, Any, Final

import typer

from scenegate.cli import CLIENT_COMMANDS, command_parser

IS_COMPLETING: Final = "_SCENEGATE_COMPLETE" in os.environ
"""True if the shell asks for completions: no command runs then."""


def add_client_commands(app: typer.Typer) -> None:
    """Add the commands and ``--version``, which cannot be run."""

    @app.callback()
    def never_called(version: Annotated[bool, typer.Option("--version")] = False) -> None: ...

    for name, (_, description) in CLIENT_COMMANDS.items():

        def never_run(**_: Any) -> None: ...

        actions = command_parser(name)._actions  # noqa: SLF001 - argparse has no other list of them
        signature = inspect.Signature(
            [_parameter(action) for action in actions if action.option_strings and action.dest != "help"]
        )
        never_run.__signature__ = signature  # type: ignore[attr-defined]  # which Typer reads
        app.command(name, help=description)(never_run)


def _parameter(action: argparse.Action) -> inspect.Parameter:
    choices = [str(choice) for choice in action.choices or ()]
    option = typer.Option(*action.option_strings, autocompletion=lambda: choices)
    annotation: Any = Annotated[bool | None, option] if action.nargs == 0 else Annotated[str | None, option]
    return inspect.Parameter(action.dest, inspect.Parameter.KEYWORD_ONLY, default=None, annotation=annotation)
