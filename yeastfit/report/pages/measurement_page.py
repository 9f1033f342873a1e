"""The page of `yeastfit measure`: doubts and failures first, then curves, micrographs, the table, how it was made."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from yeastfit.measure.outlining.doubts import BY_HAND, DOUBTS
from yeastfit.measure.replicate_curves import shrunk_colonies
from yeastfit.measure.statistics.registry import STATISTICS, names_with
from yeastfit.report import html as page
from yeastfit.report.outcome import Outcome

REMEDY = (
    "A wrong outline is corrected, and a right one accepted, by an outline of its own in the column mask of the "
    "manifest; a pixel inside the colony (seed_point) or a part of the image (roi) is often enough. The page Your own "
    "photographs of the documentation says how."
)
LINKED = 12  # images that a doubt names one by one; the others are counted


def measurement_page(
    title: str, outcomes: Sequence[Outcome], curves: bytes, skipped: Sequence[Path], made: Mapping[str, Any]
) -> str:
    """Write the page that shows all outcomes.

    Arguments:
        title: Of the page.
        outcomes: Of all micrographs.
        curves: A PNG of the conditions' curves; empty for none.
        skipped: Files that were passed over.
        made: Versions and settings to show.

    Returns:
        HTML.
    """
    measured = [outcome for outcome in outcomes if outcome.row]
    doubtful = [outcome for outcome in measured if outcome.in_doubt]
    lead = page.facts(
        [
            (len(outcomes), "micrograph" if len(outcomes) == 1 else "micrographs"),
            (len(measured), "measured"),
            (len(doubtful), "of them in doubt"),
            (len(outcomes) - len(measured), "not measured"),
        ]
    )
    sections = [*measurement_sections(outcomes, curves, skipped), ("How this was made", _made(outcomes, made))]
    foot = '<p class="soft">Outlines are drawn in orange. Larger ones, with axes, are in the folder overlays.</p>'
    return page.document(title, lead, sections, foot)


def measurement_sections(
    outcomes: Sequence[Outcome], curves: bytes, skipped: Sequence[Path] = ()
) -> list[tuple[str, str]]:
    """Write the parts of the page that show outcomes; for arguments see `measurement_page`.

    Returns:
        Headings with their HTML.
    """
    sections = [("Doubts and failures", _troubles(outcomes, skipped))]
    if curves:
        alt = "Statistics of every condition, with colonies and one standard deviation about their mean"
        words = (
            "<p>Thin lines or dots are colonies; thick lines or dashes their mean; "
            "bands or bars one standard deviation. The numbers are in <code>curves.csv</code>.</p>"
        )
        sections.append(("Curves", f'{words}<figure class="whole">{page.picture(curves, alt)}</figure>'))
    sections.append(("Micrographs", _micrographs(outcomes)))
    if any(outcome.row for outcome in outcomes):
        sections.append(("Measurements", _measurements(outcomes)))
    return sections


def _troubles(outcomes: Sequence[Outcome], skipped: Sequence[Path]) -> str:
    """Failures, doubts by name with the images they concern, and files passed over."""
    parts = []
    failed = [(k, outcome) for k, outcome in enumerate(outcomes) if not outcome.row]
    if failed:
        items = "".join(f"<li>{_link(k, outcome)}: {page.text(_reason(outcome))}</li>" for k, outcome in failed)
        parts.append(f'<div class="note bad"><p><strong>Not measured: {len(failed)}</strong></p><ul>{items}</ul></div>')
    for doubt in dict.fromkeys(doubt for outcome in outcomes for doubt in outcome.doubts):
        named = [_link(k, outcome) for k, outcome in enumerate(outcomes) if doubt in outcome.doubts]
        rest = f" and {len(named) - LINKED} more" if len(named) > LINKED else ""
        kind = "note" if doubt == BY_HAND else "note doubt"
        parts.append(
            f'<div class="{kind}"><p><strong>{page.text(doubt)}</strong> ({len(named)} of {len(outcomes)}): '
            f"{page.text(DOUBTS[doubt])}</p><p>{', '.join(named[:LINKED])}{rest}</p></div>"
        )
    if any(outcome.in_doubt for outcome in outcomes):
        parts.append(f'<p class="soft">{REMEDY}</p>')
    if smaller := shrunk_colonies([outcome.row for outcome in outcomes if outcome.row]):
        items = "".join(f"<li>{page.text(one)}</li>" for one in smaller)
        parts.append(f'<div class="note doubt"><p><strong>smaller than before</strong></p><ul>{items}</ul></div>')
    if skipped:
        names = ", ".join(path.name for path in skipped[:LINKED])
        rest = f" and {len(skipped) - LINKED} more" if len(skipped) > LINKED else ""
        parts.append(f'<p class="soft">Passed over, as their names are no image\'s: {page.text(names)}{rest}.</p>')
    return "".join(parts) if failed or len(parts) > bool(skipped) else "<p>None.</p>" + "".join(parts)


def _reason(outcome: Outcome) -> str:
    """The error without the path, which does not belong on a page that may be passed on."""
    return outcome.error.replace(f"{outcome.image.path}: ", "")


def _link(number: int, outcome: Outcome) -> str:
    """To the micrograph's card."""
    return f'<a href="#image{number}">{page.text(outcome.image.label)}</a>'


def _micrographs(outcomes: Sequence[Outcome]) -> str:
    """Cards in the order of the images, under the name of their condition where there are several."""
    conditions = list(dict.fromkeys(outcome.image.condition for outcome in outcomes))
    parts = ["<p>The outline is what was taken for the colony. Click a picture to enlarge it.</p>"]
    for condition in conditions:
        if conditions != [""]:
            parts.append(f"<h3>{page.text(condition or 'no condition')}</h3>")
        cards = (_card(k, outcome) for k, outcome in enumerate(outcomes) if outcome.image.condition == condition)
        parts.append(f'<div class="cards">{"".join(cards)}</div>')
    return "".join(parts)


def _card(number: int, outcome: Outcome) -> str:
    """One micrograph with its outline, size and doubts."""
    image, row = outcome.image, outcome.row
    lines = [f"<b>{page.text(_name(outcome))}</b>"]
    if image.hours is not None:
        lines.append(page.text(image.label))
    if row:
        lines.append(f"area {page.number(row['area'])} µm², compactness {page.number(row['compactness'])}")
    if image.options.as_arguments():
        lines.append("set by hand: " + page.text(", ".join(image.options.as_arguments()).replace("_", " ")))
    lines += [f'<span class="tag doubt">{page.text(doubt)}</span>' for doubt in outcome.in_doubt]
    lines += [page.text(BY_HAND)] if BY_HAND in outcome.doubts else []
    lines += [] if row else ['<span class="tag bad">not measured</span>']
    alt = f"{_name(outcome)}, outlined" + (f"; in doubt: {', '.join(outcome.in_doubt)}" if outcome.in_doubt else "")
    return page.card(f"image{number}", outcome.thumbnail, alt, "<br>".join(lines))


def _name(outcome: Outcome) -> str:
    """How a reader calls a micrograph: replicate and time, or its file."""
    image = outcome.image
    return image.label if image.hours is None else f"replicate {image.replicate}, {image.hours:g} h"


def _measurements(outcomes: Sequence[Outcome]) -> str:
    """The table, and what its columns mean."""
    measured = {f"image{k}": outcome.row for k, outcome in enumerate(outcomes) if outcome.row}
    rows = list(measured.values())
    known = [name for name in ("condition", "replicate", "hours") if any(row[name] not in ("", None) for row in rows)]
    columns = [
        page.Column("file", words=True),
        *(page.Column(name, "h" if name == "hours" else "", name != "hours") for name in known),
        page.Column("um_per_pixel", "µm"),
        *(page.Column(name, STATISTICS[name].unit()) for name in names_with("mask")),
        page.Column("warnings", words=True),
    ]
    cells = [[row[column.name] for column in columns] for row in rows]
    words = "<p>Click a heading to sort by its column. The same table is <code>measurements.csv</code>.</p>"
    meanings = page.pairs((name.replace("_", " "), STATISTICS[name].meaning) for name in names_with("mask"))
    table = page.table("Measurements of every micrograph", columns, cells, list(measured))
    return f"{words}{table}<details><summary>What the columns mean</summary>{meanings}</details>"


def _made(outcomes: Sequence[Outcome], made: Mapping[str, Any]) -> str:
    """Versions, settings and the hashes of all inputs."""
    hashes = page.pairs((outcome.image.label, outcome.sha256) for outcome in outcomes if outcome.sha256)
    inputs = f"<details><summary>SHA-256 of the {len(outcomes)} inputs</summary>{hashes}</details>"
    return page.pairs((name, value) for name, value in made.items()) + inputs
