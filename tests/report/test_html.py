"""The page of `yeastfit measure`: whole, readable, safe, and opened in a real browser where there is one."""

import re
from pathlib import Path

import numpy as np
import pytest
from browser import REPORT, Reader, open_in_browser
from PIL import Image

from yeastfit.commands import app as cli
from yeastfit.report import html as page

LATE = (
    """<script>addEventListener("load", () => {
  const seen = { pictures: [...document.images].map(image => [image.alt, image.naturalWidth, image.complete]) };
  const first = document.querySelector("figure button");
  first.click();
  seen.enlarged = [document.querySelector("dialog").open, document.querySelector("dialog img").naturalWidth > 1];
  document.querySelector("dialog form button").click();
  seen.closed = !document.querySelector("dialog").open;
  const names = () => [...document.querySelectorAll("tbody tr")].map(row => row.cells[0].textContent);
  const head = [...document.querySelectorAll("thead th")].find(cell => cell.textContent.startsWith("area"));
  seen.sorted = [1, 2].map(() => { head.querySelector("button").click(); return [head.ariaSort, names()]; });
"""
    + REPORT
)


@pytest.fixture(scope="module")
def measured(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Results of a data set with two conditions, two times, a doubt and a file that is no image."""
    folder = tmp_path_factory.mktemp("page")
    lines = ["um_per_pixel = 0.5"]
    for k, (condition, replicate, hours, radius) in enumerate(
        (c, r, h, 12 + 4 * h + r) for c in ("<b>wild & free</b>", 'the "other"') for r in (1, 2) for h in (3, 5)
    ):
        write_star(folder / "data" / f"{k}.png", radius, twins=k == 3)
        lines += ["[[image]]", f"file = '{k}.png'", f"replicate = {replicate}", f"hours = {hours}"]
        lines += [f"condition = '{condition}'"]
    (folder / "data" / "7.png").write_text("<script>alert(1)</script>")
    (folder / "data" / "manifest.toml").write_text("\n".join(lines))
    assert cli.run(["measure", str(folder / "data"), "--out", str(folder / "out"), "--jobs", "1"]) == 2
    return folder / "out"


def write_star(path: Path, radius: float, twins: bool) -> None:
    """A dark star of five arms, or two of them side by side."""
    path.parent.mkdir(parents=True, exist_ok=True)
    image = np.full((140, 300), 185.0)
    for centre in (80, 220) if twins else (150,):
        x, y = np.arange(300) - centre, np.arange(140)[:, None] - 70
        image[np.hypot(x, y) <= radius * (1 + 0.2 * np.cos(5 * np.arctan2(y, x)))] = 55
    noise = np.random.default_rng(round(radius)).normal(0, 2, image.shape)
    Image.fromarray((image + noise).astype(np.uint8)).save(path)


def test_the_page_is_whole_and_says_what_a_reader_needs(measured: Path) -> None:
    read = Reader((measured / "index.html").read_text(encoding="utf-8"))
    assert read.open == []
    assert read.of("html")[0]["lang"] == "en"
    assert any(meta.get("name") == "viewport" for meta in read.of("meta"))
    assert all((image["src"] or "").startswith("data:image/") for image in read.of("img"))
    assert all(image["alt"] for image in read.of("img")[:-1])  # the last is filled when a picture grows
    names = [attributes["id"] for _, attributes in read.tags if "id" in attributes]
    assert len(set(names)) == len(names)
    assert {(link["href"] or "")[1:] for link in read.of("a")} <= set(names)
    assert len(read.of("figure")) == 1 + 8
    assert len(read.of("tr")) == 1 + 7
    assert len(read.of("script")) == 1
    for words in ("<b>wild & free</b>", "7.png: is no image", "several objects (1 of 8)", "µm²", "SHA-256", "yeastfit"):
        assert words in read.words
    before = read.words.index("several objects")
    assert read.words.index("Not measured: 1") < before < read.words.index("replicate 1, 3 h")


def test_the_page_asks_for_nothing(measured: Path) -> None:
    text = (measured / "index.html").read_text(encoding="utf-8")
    assert "default-src 'none'" in text
    assert not re.search(r"(?:src|href)=[\"'](?!#|data:)", text)
    assert not re.search(r"https?://|@import|url\(", re.sub(r"base64,[A-Za-z0-9+/=]+", "", text))
    assert len(text) < 2e6
    assert str(measured.parent) not in text


@pytest.mark.parametrize(
    ("value", "shown"),
    [
        (0, "0"),
        (12, "12"),
        (1234567, "1\u202f234\u202f567"),
        (1234.6, "1\u202f235"),
        (0.12345, "0.1235"),
        (-2.5, "−2.500"),
        (3e-7, "3.000e−07"),
        (float("nan"), "–"),
    ],
)
def test_numbers_have_four_digits(value: float, shown: str) -> None:
    assert page.number(value) == shown


@pytest.mark.parametrize(("unit", "lines"), [("", 0), ("µm", 2)])
def test_sentences_wrap_and_a_line_of_units_is_there_where_a_column_has_one(unit: str, lines: int) -> None:
    columns = [page.Column("parameter"), page.Column("meaning", unit=unit, words=True)]
    wide = "a meaning of more words than a cell can hold without a break"
    written = page.table("All", columns, [["fork", wide], ["transition", "short"]], ["one", "two"])
    assert written.count("<small>") == lines
    assert f'<td class="words sentence">{wide}</td>' in written
    assert '<td class="words">short</td>' in written


# -------------------------------------------------------------------------------------------------------------- browser


@pytest.mark.parametrize("width", [1280, 500])
def test_a_browser_shows_every_picture_and_has_nothing_to_complain_of(
    measured: Path, tmp_path: Path, width: int
) -> None:
    seen, console = open_in_browser((measured / "index.html").read_text(encoding="utf-8"), LATE, tmp_path, width)
    assert console == []
    assert seen["faults"] == []
    assert seen["requests"] == []
    assert len(seen["pictures"]) == 1 + 7 + 1  # curves, images that could be read, and the one that grows
    assert all(width > 0 and complete for _, width, complete in seen["pictures"])
    assert seen["enlarged"] == [True, True]
    assert seen["closed"]
    assert seen["wide"] <= 0
    (up, rising), (down, falling) = seen["sorted"]
    assert (up, down) == ("ascending", "descending")
    # radii 12 + 4 h + replicate; the fourth shows two of the largest
    assert rising == ["0.png", "4.png", "2.png", "6.png", "1.png", "5.png", "3.png"]
    assert falling == rising[::-1]


def test_the_browser_would_notice_faults(measured: Path, tmp_path: Path) -> None:
    text = (measured / "index.html").read_text(encoding="utf-8")
    broken = text.replace("data:image/jpeg;base64,/9j/", "data:image/jpeg;base64,AAAA", 1)
    broken = broken.replace("<main>", '<main><img src="https://example.org/a.png" alt="outside">', 1)
    broken = broken.replace("</main>", "</main><script>nothing.here()</script>", 1)
    assert broken != text
    seen, console = open_in_browser(broken, LATE, tmp_path)
    assert any("nothing is not defined" in line for line in console)
    assert {"resource", "https://example.org/a.png"} <= set(seen["faults"])
    assert sum(width == 0 for _, width, _ in seen["pictures"]) == 2
