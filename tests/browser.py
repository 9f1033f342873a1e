"""Pages read as HTML, and opened in a real browser where there is one."""

import json
import re
import shutil
import subprocess
from html.parser import HTMLParser
from pathlib import Path

import pytest

BROWSERS = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable", "chrome", "microsoft-edge")
FLAGS = (
    "--headless=new",
    "--no-sandbox",
    "--disable-gpu",
    "--disable-dev-shm-usage",
    "--disable-background-networking",
    "--no-first-run",
    "--enable-logging=stderr",
    "--virtual-time-budget=10000",
    "--dump-dom",
)
EARLY = (
    "<script>window.faults = []; addEventListener('error', event => faults.push(event.message || 'resource'), true);"
)
EARLY += "addEventListener('securitypolicyviolation', event => faults.push(event.blockedURI));</script>"
REPORT = """
  seen.requests = performance.getEntriesByType("resource").map(each => each.name).filter(name => !/^data:/.test(name));
  seen.wide = document.documentElement.scrollWidth - document.documentElement.clientWidth;
  seen.faults = faults;
  const report = document.createElement("pre");
  report.id = "report";
  report.textContent = JSON.stringify(seen);
  document.body.append(report);
});</script>"""


class Reader(HTMLParser):
    """Tags that are opened and closed, their attributes, and the text between."""

    VOID = ("meta", "link", "img", "br")

    def __init__(self, text: str) -> None:
        super().__init__()
        self.open: list[str] = []
        self.tags: list[tuple[str, dict[str, str | None]]] = []
        self.words = ""
        self.feed(text)
        self.close()

    def handle_starttag(self, tag: str, attributes: list[tuple[str, str | None]]) -> None:
        self.tags.append((tag, dict(attributes)))
        if tag not in self.VOID:
            self.open.append(tag)

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag

    def handle_data(self, text: str) -> None:
        if not self.open or self.open[-1] not in ("style", "script"):
            self.words += text

    def of(self, tag: str) -> list[dict[str, str | None]]:
        return [attributes for name, attributes in self.tags if name == tag]


def open_in_browser(
    text: str, late: str, folder: Path, width: int = 1280, beside: Path | None = None
) -> tuple[dict, list[str]]:
    """What the script `late` reports of a page once it is loaded, and what the browser's console says.

    A page that needs other files is opened `beside` the one that it is, and leaves no trace there.
    """
    browser = next(filter(None, map(shutil.which, BROWSERS)), None)
    if browser is None:
        pytest.skip(f"no browser to open the page with: none of {', '.join(BROWSERS)} is installed")
    path = beside.with_name(f"opened_{width}_{beside.name}") if beside else folder / f"opened_{width}.html"
    opened = text.replace("<head>", f"<head>\n{EARLY}", 1).replace("</body>", f"{late}</body>")
    command = [browser, *FLAGS, f"--user-data-dir={folder / 'profile'}", f"--window-size={width},900", path.as_uri()]
    try:
        path.write_text(opened, encoding="utf-8")
        done = subprocess.run(command, capture_output=True, text=True, timeout=180, check=True)
    finally:
        if beside:
            path.unlink(missing_ok=True)
    report = re.search(r'<pre id="report">(.*?)</pre>', done.stdout, re.S)
    assert report, f"the page did not report: {done.stderr[-2000:]}"
    return json.loads(report[1].replace("&amp;", "&").replace("&lt;", "<").replace("&gt;", ">")), [
        line for line in done.stderr.splitlines() if "CONSOLE" in line
    ]
