"""``scenegate serve``: its flags are made from the settings, then one process serves until a signal."""

from __future__ import annotations

import asyncio
import inspect
import socket
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from pydantic.fields import FieldInfo
from rich.markup import escape

from gateway.settings import Settings, SettingsError, load, types, unknown_environment

if TYPE_CHECKING:
    from gateway.state.service import PersistentState


def add_serve(app: typer.Typer) -> None:
    """Adds the command with one flag a setting."""
    app.command("serve")(_command())


def _command() -> Any:
    def serve(config: Path | None, **flags: Any) -> None:
        given = {name: value for name, value in flags.items() if value is not None}
        try:
            settings = load(given, config)
        except SettingsError as error:
            typer.echo(f"scenegate: {error}", err=True)
            raise typer.Exit(2) from None
        raise typer.Exit(run(settings))

    serve.__doc__ = (
        "Serve every interface until SIGTERM or Ctrl+C.\n\n"
        "Each flag may also be an environment variable (SCENEGATE_HTTP_PORT=9000) or a key of the TOML file "
        "(http_port = 9000); a flag wins over the environment, the environment over the file."
    )
    parameters = [_config_parameter(), *(_parameter(name, field) for name, field in Settings.model_fields.items())]
    serve.__signature__ = inspect.Signature(parameters)  # type: ignore[attr-defined]  # what typer reads
    serve.__annotations__ = {parameter.name: parameter.annotation for parameter in parameters}
    return serve


def _config_parameter() -> inspect.Parameter:
    info = typer.Option("--config", help="TOML file with settings (also SCENEGATE_CONFIG).", dir_okay=False)
    return inspect.Parameter(
        "config", inspect.Parameter.KEYWORD_ONLY, default=None, annotation=Annotated[Path | None, info]
    )


def _parameter(name: str, field: FieldInfo) -> inspect.Parameter:
    """A flag. Everything but switches is handed over as text: the settings are what judges it."""
    flag = types.flag_of(name)
    second = field.json_schema_extra.get("flag") if isinstance(field.json_schema_extra, dict) else None
    switch = field.annotation is bool
    default = types.default_of(field.default)
    names = [f"{flag}/--no-{flag[2:]}"] if switch else [flag, *([str(second)] if second else [])]
    info = typer.Option(
        *names,
        help=escape(f"{field.description}{f' [default: {default}]' if default else ''}"),
        rich_help_panel=types.group_of(field),
        metavar=None if switch else types.kind_of(field),
        show_default=False,
    )
    kind = bool | None if switch else str | None
    return inspect.Parameter(name, inspect.Parameter.KEYWORD_ONLY, default=None, annotation=Annotated[kind, info])


def run(settings: Settings) -> int:
    """Serves until a signal; the exit code."""
    from gateway.runtime import logs, process_tuning

    process_tuning.pause_gc()
    logs.configure(settings.log_format, settings.log_level)
    import structlog

    log = structlog.get_logger("gateway")
    for warning in unknown_environment():
        log.warning(warning)
    from gateway.server.security import Security
    from gateway.state.errors import StateError
    from gateway.wiring.state import open_state

    try:
        security = Security.of(settings)
    except SettingsError as error:
        log.error(str(error))
        return 1
    try:
        state = open_state(settings)
    except StateError as error:
        log.error(str(error))
        return 1
    try:
        listener = process_tuning.listen(settings.host, settings.http_port)
    except OSError as error:
        reason = process_tuning.listen_error(error, settings.host, settings.http_port)
        log.error(f"HTTP cannot listen: {reason}; choose another with --http-port or --host.")
        return 1
    port = listener.getsockname()[1]
    host = f"[{settings.host}]" if ":" in settings.host else settings.host
    scheme = "http" if security.tls is None else "https"
    pages = "/view, / and /docs" if not settings.only or "view" in settings.only else "/ and /docs"
    log.info(f"Scenegate listens; look at {pages}", url=f"{scheme}://{host}:{port}")
    return _serve(settings, listener, state, security.tls)


def _serve(
    settings: Settings, listener: socket.socket, state: PersistentState | None, tls: tuple[Path, Path] | None
) -> int:
    import structlog
    import uvloop

    from gateway.app import create_app
    from gateway.runtime import process_tuning
    from gateway.server import http_server

    log = structlog.get_logger("gateway")
    app = create_app(settings, state)
    config = http_server.server_config(app, settings.shutdown_seconds, lifespan=True, tls=tls)

    def leave() -> None:
        log.info("Scenegate stops; requests that it has accepted may finish", seconds=settings.shutdown_seconds)
        app.state.leave()

    server = http_server.MainServer(config, leave)
    # Answers without an end (MJPEG) look at it; nobody else would tell them before their connections are cut.
    app.state.closing = lambda: server.should_exit
    app.state.on_started = process_tuning.freeze_gc
    gave_up = False

    def give_up() -> None:
        nonlocal gave_up
        gave_up = server.should_exit = True

    app.state.give_up = give_up
    with asyncio.Runner(loop_factory=uvloop.new_event_loop) as runner:
        runner.run(server.serve(sockets=[listener]))
    log.info("Scenegate has stopped")
    return 1 if gave_up else 0 if server.started else 3
