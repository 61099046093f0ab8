"""Holds requests until the gateway has started, and the page that browsers show meanwhile."""

import asyncio
from collections.abc import Callable, Collection
from typing import Final

from starlette.responses import HTMLResponse, PlainTextResponse, Response
from starlette.types import Scope

from gateway.runtime.kernels.progress import KernelProgress

_PAGE_TEMPLATE: Final = """<!doctype html>
<html lang="en">
<meta charset="utf-8">
<meta name="viewport" content="width=device-width, initial-scale=1">
<title>Scenegate is starting</title>
<link rel="icon" href="data:,">
<noscript><meta http-equiv="refresh" content="2"></noscript>
<style>
  :root { color-scheme: light dark; }
  body { font: 16px/1.5 system-ui, sans-serif; min-height: 100vh; margin: 0; display: grid; place-items: center; }
  @media (prefers-color-scheme: dark) { body { background: #16191d; color: #dde1e6; } }
  main { width: min(26rem, 90vw); }
  h1 { font-size: 1.4rem; }
  progress { width: 100%; height: .8rem; accent-color: #2f6fde; }
  small { opacity: .7; }
</style>
<main>
<h1>Scenegate is starting</h1>
<progress {value_attribute}></progress>
<p>{text}</p>
<p><small>{note}</small></p>
</main>
<script>
  async function poll() {
    try {
      const response = await fetch(location.href, { headers: { Accept: "text/html" } });
      const page = new DOMParser().parseFromString(await response.text(), "text/html");
      const isStarting = response.status === 503 && page.title === document.title;
      if (!isStarting) return location.reload();
      document.querySelector("main").replaceWith(page.querySelector("main"));
    } catch {} // the gateway has stopped; it may start again
    setTimeout(poll, 500);
  }
  setTimeout(poll, 500);
</script>
</html>
"""
_NOTE: Final = "Kernels are compiled for this CPU at the first start and kept for later ones. The page opens by itself."


class StartGate:
    """Holds requests until the interfaces have started, because Drake's client does not retry.

    A browser that opens a page gets the starting page instead. It polls its own URL, and then loads the real page.
    """

    def __init__(
        self,
        *,
        started: asyncio.Event,
        problem: Callable[[], str],
        open_paths: Collection[str],
        progress: Callable[[], KernelProgress | None] = lambda: None,
    ) -> None:
        """
        Args:
            started: set when the interfaces have started, or when the start has failed.
            problem: returns why the gateway failed to start, or an empty string.
            open_paths: paths of requests that are served during the start.
            progress: returns the progress of compiling the kernels; None in other phases of the start.
        """
        self._started = started
        self._problem = problem
        self._open_paths = open_paths
        self._progress = progress

    def is_open(self, scope: Scope) -> bool:
        """Return True if a request or WebSocket handshake need not wait and will not be refused."""
        return (self._started.is_set() and not self._problem()) or scope["path"] in self._open_paths

    async def refusal(self, scope: Scope) -> Response | None:
        """Wait for the start; return the response if the gateway did not start, or to a browser at once."""
        if not self._started.is_set():
            # Only browsers that open a page list HTML in Accept.
            accepts_html = any(name == b"accept" and b"text/html" in value for name, value in scope["headers"])
            if scope["type"] == "http" and scope["method"] == "GET" and accepts_html:
                headers = {"Retry-After": "1", "Cache-Control": "no-store"}
                return HTMLResponse(_starting_page(self._progress()), 503, headers)
            await self._started.wait()
        if scope["type"] == "http" and (problem := self._problem()):
            return PlainTextResponse(f"The gateway did not start: {problem}\n", status_code=503)
        return None


def _starting_page(progress: KernelProgress | None) -> str:
    text, note = "Loading …", "The page opens by itself."
    value_attribute = ""  # browsers then show a bar of unknown length
    if progress is not None:
        text, note = str(progress), _NOTE
        text = f"{text[0].upper()}{text[1:]}"
        if progress.fraction > 0.0:
            value_attribute = f'value="{progress.fraction:.3f}"'
    return _PAGE_TEMPLATE.replace("{value_attribute}", value_attribute).replace("{text}", text).replace("{note}", note)
