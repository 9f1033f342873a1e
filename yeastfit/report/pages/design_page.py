"""The page of a design: what to measure next, what the existing data do not see, and every candidate."""

from collections.abc import Mapping, Sequence
from pathlib import Path

from yeastfit.inference.information.design_result import Design
from yeastfit.inference.information.identifiability import percent
from yeastfit.inference.models.forward_model import ForwardModel
from yeastfit.report import html as page
from yeastfit.report.pictures import figures

PICTURES = {
    "design": "By how much each possible next measurement makes the errors smaller",
    "spectrum": "How well each combination of parameters is known, the higher the better, and what it consists of",
    "ellipses": "Errors of pairs of parameters from what is measured already, one and two standard errors",
}


def design_page(
    result: Design,
    model: ForwardModel,
    at: Mapping[str, float],
    folder: Path,
    made: Mapping[str, str],
    warnings: Sequence[str] = (),
) -> str:
    """Write the page.

    Arguments:
        result: The design.
        model: What was simulated.
        at: Parameters that it was made at, by name.
        folder: Of the pictures.
        made: How it was made: settings, versions.
        warnings: What is to be doubted, in words.

    Returns:
        HTML.
    """
    after = result.sequence[-1].typical_error if result.sequence else result.typical_error
    further = len(result.sequence)
    lead = page.facts(
        [
            (percent(result.typical_error), "typical error from what is measured"),
            (percent(after), f"after {further} more measurement{'s' * (further != 1)}"),
            (f"{result.added:g}", f"{model.nouns[1]} in each of them"),
        ]
    )
    pairs = ("ellipses",) if result.before.has_pairs else ()
    steps = "".join(f"<li>{page.text(one)}</li>" for one in result.sentences())
    sections = [
        ("Doubts", page.doubts([*warnings, *result.before.sentences(), *result.doubts()])),
        ("What to measure next", f"<ol>{steps}</ol>{figures(folder, PICTURES, 'design')}"),
        ("What the existing data see", _errors(result, model, at) + figures(folder, PICTURES, "spectrum", *pairs)),
        ("All candidates", _candidates(result)),
        ("How this was made", page.pairs(made.items())),
    ]
    foot = '<p class="soft">Numbers: design.csv, design.json, information.json.</p>'
    return page.document("Which measurement comes next", lead, sections, foot)


def _errors(result: Design, model: ForwardModel, at: Mapping[str, float]) -> str:
    """Parameters that the design was made at, with the errors of those that are free."""
    columns = [
        page.Column("parameter", words=True),
        page.Column("value"),
        page.Column("in_units", words=True),
        page.Column("error", words=True),
        page.Column("meaning", words=True),
    ]
    errors, cells = result.before.log_standard_errors, []
    for name, value in at.items():
        one = model.parameters.get(name)
        cells.append(
            [
                name.replace("_", " "),
                value,
                page.in_units(value, *model.unit_of(name)) if one else "",
                percent(errors[name]) if name in errors else "held",
                f"{one.symbol}: {one.meaning}" if one else "",
            ]
        )
    words = "<p>Simulated at these values. The error is that of what is measured already.</p>"
    return words + page.table("Parameters and their errors", columns, cells, ["spectrum"] * len(cells))


def _candidates(result: Design) -> str:
    """The table of design.csv."""
    rows = [{**row, "statistics": row["statistics"].replace(" ", ", ").replace("_", " ")} for row in result.rows()]
    columns = [page.Column(name, words=name == "statistics") for name in rows[0]]
    words = "<p>Each as the next measurement, the best first; a heading sorts by its column.</p>"
    return words + page.table("Candidates", columns, [list(row.values()) for row in rows], ["design"] * len(rows))
