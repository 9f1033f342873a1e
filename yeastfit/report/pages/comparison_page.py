"""The page of a comparison: doubts, verdicts, models on the same data, conditions under one model."""

from collections.abc import Mapping, Sequence
from typing import Any

from yeastfit.inference.comparison.runs import Comparison
from yeastfit.report import html as page

MARGINALS = "Posterior of every parameter in every run, scaled to one height"
MODELS = (
    "Colonies are left out in turn and predicted by the others. Log density: of the observed colony under its "
    "prediction, in units of the standard deviations between colonies, summed over colonies; larger is better. Behind "
    "best: the difference from the best run, colony by colony, with its standard error. Inside: share of the "
    "observations in predicted intervals, which should be 50 and 90 %."
)
CONDITIONS = (
    "Median and interval of 90 % of the difference and of the ratio, first over second; first larger: probability that "
    "the first run's parameter is the larger one, ± error; told apart: that is at least 97.5 % or at most 2.5 %."
)


def comparison_page(comparison: Comparison, pictures: Mapping[str, bytes], made: Mapping[str, str]) -> str:
    """One HTML file.

    Arguments:
        comparison: The comparison.
        pictures: PNG by name: `marginals`, `left_out_1` and so on, and `colonies_NAME` of a run.
        made: How it was made.
    """
    lead = page.facts(
        [
            (page.number(len(comparison.runs)), "runs"),
            (page.number(len(comparison.models)), "sets of colonies seen by several runs"),
            (
                page.number(len(comparison.conditions)),
                "pairs of conditions" if len(comparison.conditions) != 1 else "pair of conditions",
            ),
        ]
    )
    verdicts = "".join(f"<li>{page.text(one)}</li>" for one in comparison.sentences())
    sections = [("Doubts", page.doubts(comparison.doubts)), ("What differs", f"<ul>{verdicts}</ul>")]
    if comparison.models:
        sections.append(("Models on the same colonies", _models(comparison, pictures)))
    if comparison.conditions:
        sections.append(("Conditions under the same model", _conditions(comparison, pictures)))
    if drawn := _drawn(comparison, pictures):
        sections.append(("Colonies", drawn))
    sections.append(("How this was made", page.pairs(made.items())))
    of_models = ("models.csv", "statistics.csv", "colonies.csv") if comparison.models else ()
    of_conditions = ("conditions.csv",) if comparison.conditions else ()
    foot = f'<p class="soft">Numbers: {", ".join((*of_models, *of_conditions, "comparison.json"))}.</p>'
    return page.document("Comparison of runs", lead, sections, foot)


def _models(comparison: Comparison, pictures: Mapping[str, bytes]) -> str:
    parts = [f"<p>{page.text(MODELS)}</p>"]
    for number, each in enumerate(comparison.models, start=1):
        name = f"left_out_{number}"
        parts.append(_table("Models on the same colonies", each.rows(), name))
        parts.append(page.card(name, pictures[name], "Colonies left out", "Colonies left out, and their predictions"))
    return "".join(parts)


def _conditions(comparison: Comparison, pictures: Mapping[str, bytes]) -> str:
    parts = [f"<p>{page.text(CONDITIONS)}</p>"]
    parts += [_table(f"{each.first} and {each.second}", each.rows(), "marginals") for each in comparison.conditions]
    parts.append(page.card("marginals", pictures["marginals"], MARGINALS, page.text(MARGINALS)))
    return "".join(parts)


def _drawn(comparison: Comparison, pictures: Mapping[str, bytes]) -> str:
    """Observed above simulated colonies of each run, where its folder has a picture of them."""
    cards = []
    for one in comparison.runs:
        name = f"colonies_{one.name}"
        if name in pictures:
            words = f"{one.name}: observed colonies above, where there are pictures of them; simulated ones below"
            cards.append(page.card(name, pictures[name], words, page.text(words)))
    return "".join(cards)


def _table(caption: str, rows: Sequence[Mapping[str, Any]], link: str) -> str:
    columns = [page.Column(name, words=isinstance(value, str)) for name, value in rows[0].items()]
    return page.table(caption, columns, [list(row.values()) for row in rows], [link] * len(rows))
