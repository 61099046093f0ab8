"""``scenegate serve``: one flag per setting; serves until SIGTERM or Ctrl+C."""

import inspect
import os
import sys
import time
from functools import partial
from pathlib import Path
from typing import Annotated, Any, NoReturn

import typer
from pydantic.fields import FieldInfo
from rich.markup import escape

from gateway.cli import first_line
from gateway.cli.completion import IS_COMPLETING
from gateway.runtime.settings import Settings, SettingsError, load, unknown_environment
from gateway.runtime.settings.option import default_of, flag_of, group_of, metavar_of, second_flag_of
from scenegate.cli.output import print_note

HELP = """Serve all protocols until SIGTERM or Ctrl+C.

Each flag is also an environment variable (SCENEGATE_HTTP_PORT=9000) and a key of the TOML file (http_port = 9000).
Flags override the environment, which overrides the file. --help-all lists all flags, --help the common ones.
A switch such as --demo is turned off by --no-demo.
"""
COMMON = frozenset(
    {
        *("host", "http_port", "only", "demo"),
        *("look", "samples", "backdrop", "keep_failures"),
        *("lcm_url", "tcpq_port", "mesh_root"),
        *("grpc_port", "stereo_scene", "stereo_pose", "stereo_profile"),
        *("http_token_file", "state", "workers", "threads", "log_format"),
    }
)
"""Settings that ``--help`` lists."""
REPEATABLE = frozenset({"xacro_arg"})
"""Settings whose flag can be repeated."""


def add_serve(app: typer.Typer) -> None:
    """Add the command. Typer reads its flags from a signature that is made from the settings."""

    def serve(config: Path | None, help_all: bool | None, **flags: Any) -> None:
        given = {name: value for name, value in flags.items() if value not in (None, [])}
        try:
            settings = load(given, config)
        except SettingsError as error:
            print_note(f"scenegate: {error}")
            raise typer.Exit(2) from None
        end(run(settings))

    info = typer.Option("--config", help="TOML file with settings (also SCENEGATE_CONFIG).", dir_okay=False)
    help_all = typer.Option("--help-all", help="Show all flags and exit.", is_eager=True, callback=_print_all_flags)
    parameters = [
        _parameter("config", Annotated[Path | None, info]),
        _parameter("help_all", Annotated[bool | None, help_all]),
        *(_parameter(name, _flag(name, field)) for name, field in Settings.model_fields.items()),
    ]
    serve.__signature__ = inspect.Signature(parameters)  # type: ignore[attr-defined]  # Typer reads it
    serve.__annotations__ = {parameter.name: parameter.annotation for parameter in parameters}
    app.command("serve", help=HELP)(serve)


def _print_all_flags(context: typer.Context, wanted: bool) -> None:
    if not wanted:
        return
    for parameter in context.command.params:
        parameter.hidden = False  # type: ignore[attr-defined]  # all are options
        parameter.secondary_opts = []  # --no-…, whose column would leave too little of 80 characters for the others
    typer.echo(context.get_help())
    raise typer.Exit


def _parameter(name: str, annotation: Any) -> inspect.Parameter:
    return inspect.Parameter(name, inspect.Parameter.KEYWORD_ONLY, default=None, annotation=annotation)


def _flag(name: str, field: FieldInfo) -> Any:
    """Return the annotation of a flag. Its value stays text, which the settings parse and check; switches are bool."""
    flag, second, default = flag_of(name), second_flag_of(field), default_of(field.default)
    switch = field.annotation is bool
    names = [f"{flag}/--no-{flag[2:]}"] if switch else [flag, *([second] if second else [])]
    choices = [word for word in metavar_of(field).split("|") if word.islower()]
    info = typer.Option(
        *names,
        autocompletion=None if switch else lambda: choices,
        help=escape(f"{field.description}{f' [default: {default}]' if default else ''}"),
        rich_help_panel=group_of(field),
        metavar=None if switch else metavar_of(field),
        show_default=False,
        hidden=name not in COMMON and not IS_COMPLETING,
    )
    if name in REPEATABLE:
        return Annotated[list[str] | None, info]
    return Annotated[bool | None if switch else str | None, info]


def run(settings: Settings) -> int:
    """Serve until a signal; return the exit code. Imports are late, so that ``--help`` is fast."""
    from gateway.runtime.logs import log_setup
    from gateway.runtime.workers import process_tuning

    process_tuning.pause_gc()
    log_setup.configure(settings.log_format, settings.log_level)
    import structlog

    log = structlog.get_logger("gateway")
    for warning in unknown_environment():
        log.warning(warning)
    if problem := process_tuning.address_space_problem():
        log.error(problem)
        return 1
    from gateway.runtime.http.security import Security
    from gateway.runtime.state.database import StateError
    from gateway.wiring.state import open_state

    try:
        tls = Security.from_settings(settings).tls
        state = open_state(settings)
    except (SettingsError, StateError) as error:
        log.error(str(error))
        return 1
    try:
        listener = process_tuning.listen(settings.host, settings.http_port)
    except OSError as error:
        reason = process_tuning.listen_error(error, settings.host, settings.http_port)
        log.error(f"HTTP cannot listen: {reason}; choose another with --http-port or --host.")
        return 1
    url = _url(settings.host, listener.getsockname()[1], tls is not None)
    pages = "/view, / and /docs" if settings.is_enabled("view") else "/ and /docs"
    workers = {"workers": settings.processes} if settings.processes > 1 else {}
    log.info(f"Scenegate listens; look at {pages}", url=url, **workers)
    if settings.processes > 1:
        from gateway.cli.serve_workers import serve_workers

        return serve_workers(settings, listener)
    from gateway.app import create_app
    from gateway.cli.serve_app import serve_app
    from renderers.compiler import cache_folder

    log.info("The libraries are loaded", seconds=round(time.perf_counter() - first_line.BEGIN, 1))
    page_url = f"{url}/view" if settings.is_enabled("view") else f"{url}/"
    code = serve_app(partial(create_app, settings, state, page_url=page_url), listener)
    cache_folder.remove_private_root()
    log.info(first_line.STOPPED)
    return code


def end(code: int) -> NoReturn:
    """End the process at once. All is closed; to join threads and free memory would take up to seconds."""
    sys.stdout.flush()
    sys.stderr.flush()
    os._exit(code)


def _url(host: str, port: int, tls: bool) -> str:
    """Return the address of the server for a browser on this machine."""
    # Nothing is bound here.
    shown = {"0.0.0.0": "localhost", "::": "localhost"}.get(host, f"[{host}]" if ":" in host else host)  # noqa: S104
    return f"{'https' if tls else 'http'}://{shown}:{port}"
