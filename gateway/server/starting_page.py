"""Page for browsers while the gateway starts. It shows the progress, polls its own URL and then loads the real page."""

from __future__ import annotations

from typing import Final, Protocol

_PAGE: Final = """<!doctype html>
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
<progress {value}></progress>
<p>{text}</p>
<p><small>{note}</small></p>
</main>
<script>
  async function poll() {
    try {
      const response = await fetch(location.href, { headers: { Accept: "text/html" } });
      const page = new DOMParser().parseFromString(await response.text(), "text/html");
      if (response.status !== 503 || page.title !== document.title) return location.reload();
      document.querySelector("main").replaceWith(page.querySelector("main"));
    } catch {} // the gateway has stopped; it may start again
    setTimeout(poll, 500);
  }
  setTimeout(poll, 500);
</script>
</html>
"""
_NOTE: Final = "Kernels are compiled for this CPU at the first start and kept for later ones. The page opens by itself."


class Progress(Protocol):
    """Progress of a phase of the start. ``str`` describes it."""

    @property
    def fraction(self) -> float:
        """0 to 1."""


def starting_page(progress: Progress | None) -> str:
    """Return the page as HTML.

    Args:
        progress: progress of compiling the kernels; None in other phases of the start.
    """
    text, value = "Loading …", ""
    if progress is not None:
        text = str(progress)
        text = f"{text[0].upper()}{text[1:]}"
        value = f'value="{progress.fraction:.3f}"' if progress.fraction else ""
    note = _NOTE if progress is not None else "The page opens by itself."
    return _PAGE.replace("{value}", value).replace("{text}", text).replace("{note}", note)
