"""Web pages in one HTML file, pictures included, light or dark as the reader's system is.

All functions take and return text. Text that comes from a user or a file goes through `text`. The page's content
security policy forbids every request, so that a page can be passed on and shows the same everywhere.
"""

import base64
import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any

from yeastfit.text import as_html as text

STYLE = """
:root { color-scheme: light dark; --ground: #fbfaf7; --card: #ffffff; --ink: #1f1d1a; --soft: #67625a;
  --line: #dcd7cc; --accent: #8a4b13; --doubt: #7a5200; --doubt-ground: #fff1cf; --bad: #a3123a; --bad-ground: #fde7ec }
@media (prefers-color-scheme: dark) { :root { --ground: #161513; --card: #211f1c; --ink: #eeeae2; --soft: #a8a297;
  --line: #3b3832; --accent: #f0a867; --doubt: #ffd27a; --doubt-ground: #3a2e12; --bad: #ff9db3;
  --bad-ground: #43151f } }
* { box-sizing: border-box }
body { margin: 0; background: var(--ground); color: var(--ink); font: 16px/1.5 system-ui, sans-serif }
header, main, footer { max-width: 84rem; margin: 0 auto; padding: 0 1.25rem }
header { padding-top: 2rem }
h1 { font-size: 1.75rem; line-height: 1.2; margin: 0; overflow-wrap: anywhere }
h2 { font-size: 1.25rem; margin: 2.5rem 0 .75rem; padding-top: .5rem; border-top: 1px solid var(--line) }
h3 { font-size: 1rem; margin: 1.5rem 0 .5rem }
p { max-width: 50rem; margin: .5rem 0 }
a { color: var(--accent) }
nav { display: flex; flex-wrap: wrap; gap: .25rem 1.25rem; margin: .75rem 0 }
.facts { display: flex; flex-wrap: wrap; gap: .75rem; margin: 1.25rem 0; padding: 0; list-style: none }
.facts li { background: var(--card); border: 1px solid var(--line); border-radius: .5rem; padding: .5rem 1rem }
.facts b { display: block; font-size: 1.375rem; line-height: 1.25; font-variant-numeric: tabular-nums }
.facts span, figcaption, .soft { color: var(--soft); font-size: .875rem }
.note { border-radius: .5rem; padding: .75rem 1rem; margin: .75rem 0; overflow-wrap: anywhere }
.note p, .note ul { margin: 0; max-width: none }
.note ul { padding-left: 1.25rem }
.note a { color: inherit }
.doubt { background: var(--doubt-ground); color: var(--doubt) }
.bad { background: var(--bad-ground); color: var(--bad) }
.cards { display: grid; gap: .75rem; grid-template-columns: repeat(auto-fill, minmax(min(13rem, 44vw), 1fr)) }
figure { margin: 0; background: var(--card); border: 1px solid var(--line); border-radius: .5rem; overflow: hidden }
figure:target { outline: 3px solid var(--accent) }
figure.whole { background: #ffffff; padding: .5rem; overflow: auto }
.whole img { min-width: 52rem; margin: 0 auto }
img { display: block; max-width: 100%; height: auto }
figure button { display: block; width: 100%; padding: 0; border: 0; background: none; cursor: zoom-in }
.wide { grid-template-columns: repeat(auto-fill, minmax(min(26rem, 92vw), 1fr)) }
.cards img { width: 100%; aspect-ratio: 4 / 3; object-fit: contain; background: #00000014 }
.wide img { aspect-ratio: auto; background: none }
.none { aspect-ratio: 4 / 3; display: grid; place-items: center; background: #00000014; color: var(--soft) }
figcaption { padding: .5rem .75rem .625rem; overflow-wrap: anywhere; line-height: 1.35 }
figcaption b { color: var(--ink); font-weight: 600 }
.tag { display: inline-block; border-radius: .25rem; padding: 0 .375rem; margin-top: .25rem; font-size: .8125rem }
.table { overflow: auto; max-height: 34rem; border: 1px solid var(--line); border-radius: .5rem }
table { border-collapse: separate; border-spacing: 0; width: 100%; background: var(--card);
  font-size: .875rem; font-variant-numeric: tabular-nums }
caption { position: absolute; width: 1px; height: 1px; overflow: hidden; clip-path: inset(50%) }
th, td { padding: .3rem .75rem; text-align: right; border-bottom: 1px solid var(--line); white-space: nowrap }
th { font-weight: 600 }
.words { text-align: left }
.sentence { white-space: normal; min-width: 16rem }
tbody th, thead th:first-child { position: sticky; left: 0; background: var(--card); text-align: left }
thead th { position: sticky; top: 0; background: var(--card); vertical-align: bottom; z-index: 1 }
thead th:first-child { z-index: 2 }
thead button { all: unset; cursor: pointer }
thead button:focus-visible { outline: 3px solid var(--accent) }
thead small { display: block; font-weight: 400; color: var(--soft) }
th[aria-sort=ascending] button::after { content: " ↑" }
th[aria-sort=descending] button::after { content: " ↓" }
dialog { border: 0; padding: 0; background: var(--card); color: var(--ink); border-radius: .5rem; max-width: 96vw }
dialog::backdrop { background: #000000b0 }
dialog img { width: auto; max-height: 82vh; margin: 0 auto }
dialog p { margin: .5rem 1rem }
dialog form { text-align: right; padding: 0 1rem .75rem }
dl { display: grid; grid-template-columns: max-content 1fr; gap: .25rem 1.25rem; margin: 0 }
dt { color: var(--soft) }
dd { margin: 0; overflow-wrap: anywhere }
code { font-size: .875em; overflow-wrap: anywhere }
summary { cursor: pointer }
details { margin: .75rem 0 }
footer { padding: 2rem 1.25rem 3rem }
:focus-visible { outline: 3px solid var(--accent); outline-offset: 2px }
@media (max-width: 40rem) {
  tbody th { min-width: 8.5rem; max-width: 9rem; white-space: normal; overflow-wrap: anywhere }
  dl { display: block }
  dd { margin-bottom: .375rem } }
@media print { .table { max-height: none } figure { break-inside: avoid } }
"""

SCRIPT = """
const view = document.querySelector("dialog");
for (const button of document.querySelectorAll("figure button")) button.addEventListener("click", () => {
  const picture = button.querySelector("img"), large = view.querySelector("img");
  large.src = picture.src;
  large.alt = picture.alt;
  view.querySelector("p").textContent = picture.alt;
  view.showModal();
});
view.addEventListener("click", event => { if (event.target === view || event.target.tagName === "IMG") view.close(); });
for (const head of document.querySelectorAll("thead th")) head.querySelector("button").addEventListener("click", () => {
  const down = head.getAttribute("aria-sort") === "ascending", body = head.closest("table").tBodies[0];
  for (const other of head.parentElement.children) other.removeAttribute("aria-sort");
  head.setAttribute("aria-sort", down ? "descending" : "ascending");
  const key = row => row.cells[head.cellIndex].dataset.value ?? row.cells[head.cellIndex].textContent;
  const order = (a, b) => key(a).localeCompare(key(b), "en", { numeric: true });
  const numbers = (a, b) => (Number(key(a)) - Number(key(b)));
  const rows = [...body.rows], empty = rows.filter(row => key(row) === ""), full = rows.filter(row => key(row) !== "");
  full.sort(full.every(row => !isNaN(key(row))) ? numbers : order);
  body.append(...(down ? full.reverse() : full), ...empty);
});
"""

POLICY = "default-src 'none'; img-src data:; style-src 'unsafe-inline'; script-src 'unsafe-inline'"
LONG = 40  # characters of a cell that is wrapped
BLANK = "data:image/gif;base64,R0lGODlhAQABAAAAACH5BAEKAAEALAAAAAABAAEAAAICTAEAOw=="


@dataclass(frozen=True)
class Column:
    """A column of a table.

    Attributes:
        name: Its heading.
        unit: Below the heading; may be empty.
        words: Whether it holds words instead of numbers.
    """

    name: str
    unit: str = ""
    words: bool = False


def number(value: float) -> str:
    """Format a number with four significant digits and thin spaces between thousands; a dash if it is not finite."""
    if not math.isfinite(value):
        return "–"
    if value and not 1e-3 <= abs(value) < 1e9:
        return f"{value:.3e}".replace("-", "−")
    digits = 0 if isinstance(value, int) or not value else max(0, 3 - math.floor(math.log10(abs(value))))
    return f"{value:,.{digits}f}".replace(",", "\u202f").replace("-", "−")


def document(title: str, lead: str, sections: Sequence[tuple[str, str]], foot: str) -> str:
    """Write a whole page.

    Arguments:
        title: Of the page.
        lead: HTML below the title.
        sections: Headings with their HTML.
        foot: HTML at the end.

    Returns:
        HTML.
    """
    links = "".join(f'<a href="#part{k}">{text(heading)}</a>' for k, (heading, _) in enumerate(sections))
    parts = "".join(
        f'<section id="part{k}" aria-labelledby="heading{k}"><h2 id="heading{k}">{text(heading)}</h2>{body}</section>\n'
        for k, (heading, body) in enumerate(sections)
    )
    return (
        '<!doctype html>\n<html lang="en">\n<head>\n<meta charset="utf-8">\n'
        f'<meta http-equiv="Content-Security-Policy" content="{POLICY}">\n'
        '<meta name="viewport" content="width=device-width, initial-scale=1">\n<link rel="icon" href="data:,">\n'
        f"<title>{text(title)}</title>\n<style>{STYLE}</style>\n</head>\n<body>\n"
        f'<header><h1>{text(title)}</h1>{lead}<nav aria-label="Parts of this page">{links}</nav></header>\n'
        f"<main>\n{parts}</main>\n<footer>{foot}</footer>\n"
        f'<dialog aria-label="Larger picture"><img src="{BLANK}" alt=""><p></p>'
        f'<form method="dialog"><button>Close</button></form></dialog>\n<script>{SCRIPT}</script>\n</body>\n</html>\n'
    )


def picture(data: bytes, alt: str, width: int | None = None) -> str:
    """Write an image into the page.

    Arguments:
        data: A JPEG, PNG or GIF file.
        alt: What it shows, in words.
        width: In pixels; by default the image's own.

    Returns:
        HTML.
    """
    kind = "jpeg" if data.startswith(b"\xff\xd8") else "gif" if data.startswith(b"GIF8") else "png"
    size = f' width="{width}"' if width else ""
    return f'<img src="data:image/{kind};base64,{base64.b64encode(data).decode()}" alt="{text(alt)}"{size}>'


def card(name: str, data: bytes, alt: str, caption: str) -> str:
    """Write a small picture that grows when it is clicked.

    Arguments:
        name: Its anchor.
        data: A JPEG or PNG file; empty for none.
        alt: What it shows, in words.
        caption: HTML below it.

    Returns:
        HTML.
    """
    shown = f'<button type="button" aria-label="Enlarge {text(alt)}">{picture(data, alt)}</button>'
    shown = shown if data else '<div class="none">no picture</div>'
    return f'<figure id="{text(name)}">{shown}<figcaption>{caption}</figcaption></figure>\n'


def facts(pairs: Iterable[tuple[object, str]]) -> str:
    """Write large numbers, each above what it counts."""
    return f'<ul class="facts">{"".join(f"<li><b>{text(n)}</b><span>{text(w)}</span></li>" for n, w in pairs)}</ul>'


def doubts(sentences: Iterable[str]) -> str:
    """Write what is to be doubted, each sentence once, or that there is nothing."""
    items = "".join(f"<li>{text(one)}</li>" for one in dict.fromkeys(sentences))
    return f'<div class="note doubt"><ul>{items}</ul></div>' if items else "<p>None.</p>"


def in_units(value: float, factor: float, unit: str, error: float = math.nan) -> str:
    """Write a value in a unit, with its error where there is one: "1.30 ± 0.05 µm²/h"; nothing without a unit."""
    spread = f" ± {factor * error:.2g}" if math.isfinite(error) else ""
    return f"{number(factor * value)}{spread} {unit}" if unit else ""


def pairs(values: Iterable[tuple[str, object]]) -> str:
    """Write terms beside what they stand for."""
    return f"<dl>{''.join(f'<dt>{text(name)}</dt><dd>{text(value)}</dd>' for name, value in values)}</dl>"


def table(caption: str, columns: Sequence[Column], rows: Sequence[Sequence[Any]], links: Sequence[str]) -> str:
    """Write a table that scrolls and sorts by any column.

    Arguments:
        caption: What it holds, for screen readers.
        columns: Its columns.
        rows: Values by column.
        links: For each row the anchor that its first cell links to.

    Returns:
        HTML.
    """
    units = [f"<small>{text(column.unit) or '&nbsp;'}</small>" for column in columns]
    if not any(column.unit for column in columns):
        units = [""] * len(columns)
    head = "".join(
        f'<th scope="col"{_kind(column)}><button type="button">{text(column.name.replace("_", " "))}</button>'
        f"{unit}</th>"
        for column, unit in zip(columns, units, strict=True)
    )
    body = "".join(
        f'<tr><th scope="row"><a href="#{text(link)}">{text(row[0])}</a></th>'
        + "".join(_cell(value, column) for value, column in zip(row[1:], columns[1:], strict=True))
        + "</tr>\n"
        for row, link in zip(rows, links, strict=True)
    )
    return (
        f'<div class="table" tabindex="0" role="region" aria-label="{text(caption)}"><table><caption>{text(caption)}'
        f"</caption><thead><tr>{head}</tr></thead>\n<tbody>\n{body}</tbody></table></div>"
    )


def _kind(column: Column, words: str = "") -> str:
    if not column.words:
        return ""
    return ' class="words sentence"' if len(words) > LONG else ' class="words"'


def _cell(value: Any, column: Column) -> str:
    if isinstance(value, int | float):
        known = math.isfinite(value)
        return f'<td data-value="{float(value)!r}">{number(value)}</td>' if known else '<td data-value="">–</td>'
    words = "" if value is None else str(value)
    return f"<td{_kind(column, words)}>{text(words)}</td>"
