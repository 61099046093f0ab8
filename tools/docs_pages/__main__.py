"""``python -m tools.docs_pages FOLDER``: write the generated pages into FOLDER, which is docs/."""

import sys
from pathlib import Path

from gateway.datasets.scenario.file import schema_text
from tools.docs_pages import commands_page, grpc_page, http_page, lcm_page, limits_page, settings_page

if __name__ == "__main__":
    docs = Path(sys.argv[1])
    (docs / "reference").mkdir(exist_ok=True)
    for name, text in (
        ("configuration.md", settings_page.page()),
        ("limits.md", limits_page.page()),
        ("reference/commands.md", commands_page.page()),
        ("reference/http.md", http_page.page(http_page.description())),
        ("reference/grpc.md", grpc_page.page()),
        ("reference/lcm.md", lcm_page.page()),
        ("scenario.schema.json", schema_text()),
    ):
        (docs / name).write_text(text, "utf-8")
