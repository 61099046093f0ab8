"""The server's commands, which ``scenegate.cli`` runs. They import lazily."""

import typer

from gateway.cli import dataset
from gateway.cli.completion import IS_COMPLETING, add_client_commands
from gateway.cli.convert import convert
from gateway.cli.export import export
from gateway.cli.render import add_render
from gateway.cli.serve import add_serve
from gateway.cli.view import view
from scenegate.cli.output import print_line

app = typer.Typer(
    name="scenegate",
    help="Drake's glTF render server, an rc_visard stereo camera and Director's tree viewer, on one scene.",
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    rich_markup_mode="rich",
)


def warmup() -> None:
    """Compile the rendering kernels into the cache, so that the next start is fast."""
    from gateway.runtime.kernels.cache import configure
    from gateway.runtime.kernels.parts import ensure_compiled
    from renderers.compiler import cache_folder

    folder = configure()
    ensure_compiled(show=True)
    print_line(f"The {cache_folder.count()} rendering kernels are in {folder}.")


def doctor() -> None:
    """Find what does not work, what that means and what to do: libraries, ports, multicast, kernel cache."""
    from gateway.cli.doctor import print_findings

    if not print_findings():
        raise typer.Exit(1)


add_serve(app)
app.command()(view)
add_render(app)
for command in (export, convert, doctor, warmup):
    app.command()(command)
app.add_typer(dataset.app, name="dataset")
if IS_COMPLETING:
    add_client_commands(app)
