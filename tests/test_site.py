"""The documentation site as `make docs` builds it: every public name has a page, every page is whole in a browser."""

import html
import re
from pathlib import Path
from urllib.parse import unquote, urldefrag, urljoin, urlsplit

import pytest
from browser import REPORT, open_in_browser

import yeastfit
from yeastfit import measure, model, offlattice, plot

SITE = Path(__file__).parents[1] / "build" / "docs"
PAGES = (
    "docs/index.html",
    "docs/start.html",
    "docs/guide.html",
    "docs/model.html",
    "docs/recovery.html",
    "docs/reference.html",
    "docs/reference/yeastfit/fit.html",
    "docs/reference/yeastfit/Posterior.html",
    "notebooks/fitting.html",
)
LATE = (
    """<script>addEventListener("load", () => {
  const seen = { pictures: [...document.images].filter(each => each.offsetParent).map(each => each.naturalWidth) };
  seen.title = document.querySelector("h1").getBoundingClientRect().width;
"""
    + REPORT
)
pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(not SITE.is_dir(), reason=f"{SITE} is not there: `make docs` builds it"),
]


@pytest.mark.parametrize("width", [1280, 500])
@pytest.mark.parametrize("page", PAGES)
def test_a_browser_shows_the_page(page: str, width: int, tmp_path: Path) -> None:
    path = SITE / page
    seen, console = open_in_browser(path.read_text(encoding="utf-8"), LATE, tmp_path, width, beside=path)
    assert console == []
    assert seen["faults"] == []
    assert not [address for address in seen["requests"] if not address.startswith("file:")]
    assert all(seen["pictures"])
    assert 0 < seen["title"] <= width
    assert seen["wide"] <= 0


def test_every_public_name_is_described() -> None:
    listed = (SITE / "docs" / "reference.html").read_text(encoding="utf-8")
    rooms = (yeastfit, measure, model, offlattice, plot)
    names = {f"{room.__name__}.{name}" for room in rooms for name in room.__all__} - {room.__name__ for room in rooms}
    pages = [page.read_text(encoding="utf-8") for page in SITE.rglob("*.html")]
    described = {name for page in pages for name in re.findall(r' id="(yeastfit[\w.]+)"', page)}
    assert names - described == set()
    assert {name for name in names if f'title="{name}"' not in listed} == set()


def test_every_link_leads_somewhere() -> None:
    pages = {path: path.read_text(encoding="utf-8") for path in SITE.rglob("*.html")}
    places = {
        path: {html.unescape(name) for name in re.findall(r'\sid="([^"]*)"', page)} for path, page in pages.items()
    }
    lost = []
    for path, page in pages.items():
        for address in map(html.unescape, re.findall(r'<(?:a|img|link|script)\s[^>]*?(?:href|src)="([^"]+)"', page)):
            if re.match(r"[a-z]+:", address):
                continue
            file, place = urldefrag(urljoin(path.as_uri(), address))
            target = Path(unquote(urlsplit(file).path))
            if not target.is_file() or (place and target in places and unquote(place) not in places[target]):
                lost.append(f"{path.relative_to(SITE)}: {address}")
    assert lost == []
