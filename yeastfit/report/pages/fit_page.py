"""The page of a fit: doubts first, then parameters, curves, what the data do not see, and the measurements below."""

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from yeastfit.inference.fit.result import Fit
from yeastfit.inference.models.forward_model import ForwardModel
from yeastfit.report import html as page
from yeastfit.report.learnt import learnt_by_fit
from yeastfit.report.pictures import figures

PICTURES = {
    "fit": "Data with their standard errors, the fitted curves, and the residuals below",
    "spectrum": "How well each combination of parameters is known, the higher the better, and what it consists of",
    "ellipses": "Errors of pairs of parameters, one and two standard errors",
    "profiles": "Rise of chi-square along each parameter, the others fitted anew",
    "bootstrap": "Fits to resampled colonies, for pairs of parameters",
    "convergence": "How the fit converged from its starts",
}
Sections = Sequence[tuple[str, str]]


def fit_page(
    result: Fit,
    model: ForwardModel,
    folder: Path,
    made: Mapping[str, str],
    truth: Mapping[str, float] | None = None,
    lines: Sequence[str] = (),
    measured: Sections = (),
) -> str:
    """Write the page.

    Arguments:
        result: The fit.
        model: What was fitted.
        folder: Of the pictures.
        made: How it was made: settings, versions.
        truth: True parameters by name, where they are known.
        lines: What bootstrap and profiles found, in words.
        measured: Sections of the page of the measurements, where photographs were measured.

    Returns:
        HTML.
    """
    colonies = max(int(each.targets.replicates.max()) for each in result.conditions)
    freedom = result.degrees_of_freedom
    lead = page.facts(
        [
            ("yes" if result.converged else "no", "converged"),
            (
                page.number(result.chi_square),
                f"chi-square, on {freedom} degree{'' if freedom == 1 else 's'} of freedom",
            ),
            (colonies, f"{model.nouns[1]} measured"),
            (page.number(result.simulations), f"{model.nouns[1]} simulated"),
        ]
    )
    units = f'<p class="soft">{page.text(model.units)}</p>' if model.units else ""
    pairs = ("ellipses",) if result.information.has_pairs else ()
    sections = [
        ("Doubts", page.doubts([*([] if result.converged else [result.message]), *result.warnings])),
        ("Parameters", f"<p>{page.text(learnt_by_fit(result))}</p>{_parameters(result, model, truth)}{units}"),
        ("Curves", figures(folder, PICTURES, "fit")),
        (
            "What the data see",
            _seen(result, lines) + figures(folder, PICTURES, "spectrum", *pairs, "profiles", "bootstrap"),
        ),
        ("Convergence", f"<p>{page.text(result.message)}.</p>{figures(folder, PICTURES, 'convergence')}"),
        ("How this was made", page.pairs(made.items())),
        *((f"Measurements: {name[:1].lower()}{name[1:]}", body) for name, body in measured),
    ]
    single = "colonies.csv, " if any(each.targets.colonies for each in result.conditions) else ""
    foot = f'<p class="soft">Numbers: parameters.csv, targets.csv, {single}fit.json.</p>'
    return page.document("Fit of the parameters", lead, sections, foot)


def _parameters(result: Fit, model: ForwardModel, truth: Mapping[str, float] | None) -> str:
    """The table: value, error, the same in units, and what the parameter means."""
    rows = sorted(result.rows(), key=lambda row: row["standard_error"] is None)
    several, known = "condition" in rows[0], model.parameters
    columns = [
        page.Column("parameter", words=True),
        *([page.Column("condition", words=True)] if several else []),
        page.Column("value"),
        page.Column("standard_error"),
        page.Column("error", "%"),
        page.Column("in_units", words=True),
        *([page.Column("truth")] if truth else []),
        page.Column("meaning", words=True),
    ]
    cells = []
    for row in rows:
        name, value, error = row["parameter"], row["value"], row["standard_error"]
        factor, unit = model.unit_of(name) if name in known else (1.0, "")
        meaning = f"{known[name].symbol}: {known[name].meaning}" if name in known else ""
        known_to = float("nan") if error is None else float(error)
        shown = "fixed" if error is None else known_to if np.isfinite(known_to) else "not determined"
        cells.append(
            [
                name.replace("_", " "),
                *([row["condition"]] if several else []),
                value,
                shown,
                100 * known_to / value if value else float("nan"),  # what is fixed may be 0
                page.in_units(value, factor, unit, known_to),
                *([truth.get(name)] if truth else []),
                meaning,
            ]
        )
    return page.table("Fitted and fixed parameters", columns, cells, ["fit"] * len(cells))


def _seen(result: Fit, lines: Sequence[str]) -> str:
    """Combinations of parameters by how well they are known, and what bootstrap and profiles found."""
    said = [one for one in (*result.information.sentences(), *lines) if one not in result.warnings]
    items = "".join(f"<li>{page.text(one)}</li>" for one in said)  # the others are among the doubts
    columns = [page.Column("combination", words=True), page.Column("known_to", words=True)]
    cells = [
        [row["combination"].replace("_", " "), "not seen" if row["blind"] else row["combination_known_to"]]
        for row in result.information.rows()
    ]
    words = "<p>The data see these combinations of parameters, from the best known to the worst.</p>"
    table = page.table("Combinations of parameters", columns, cells, ["spectrum"] * len(cells))
    return f"{f'<ul>{items}</ul>' if items else ''}{words}{table}"
