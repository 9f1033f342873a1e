"""The files of a comparison: tables, JSON, pictures, and one page of it all."""

from collections.abc import Mapping
from pathlib import Path

from yeastfit import plot
from yeastfit.inference.comparison.runs import Comparison
from yeastfit.report.pages.comparison_page import comparison_page
from yeastfit.storage import write_json, write_table, written_whole


def write_comparison(folder: Path, comparison: Comparison, drawn: Mapping[str, bytes], made: Mapping[str, str]) -> None:
    """Write comparison.json, pictures, index.html, and tables of what is compared.

    They are models.csv, statistics.csv and colonies.csv of models on the same colonies, conditions.csv of conditions.

    Arguments:
        folder: Where to.
        comparison: The comparison.
        drawn: PNG of observed and simulated colonies, by the name of the run.
        made: How it was made, for the page.
    """
    numbered = list(enumerate(comparison.models, start=1))
    tables = {
        "models": [{"set": n, **row} for n, each in numbered for row in each.rows()],
        "statistics": [
            {"set": n, "run": one.name, **row}
            for n, each in numbered
            for one in each.runs
            for row in one.left_out.rows()
        ],
        "colonies": [
            {"set": n, "colony": row["colony"], "run": name, "log_density": density}
            for n, each in numbered
            for row in each.colony_rows()
            for name, density in row.items()
            if name != "colony"
        ],
        "conditions": [row for each in comparison.conditions for row in each.rows()],
    }
    for name, rows in tables.items():
        if rows:
            write_table(folder / f"{name}.csv", rows)
    verdicts = {
        "runs": [one.name for one in comparison.runs],
        "verdicts": comparison.sentences(),
        "doubts": comparison.doubts,
    }
    write_json(folder / "comparison.json", {**verdicts, **tables})
    pictures = {f"colonies_{name}": picture for name, picture in drawn.items()}
    figures = {
        f"left_out_{n}": plot.left_out({one.name: one.left_out for one in each.runs}) for n, each in numbered
    } | ({"marginals": plot.marginals(comparison.runs)} if comparison.conditions else {})
    for name, figure in figures.items():
        plot.save(figure, folder / f"{name}.png")
        pictures[name] = (folder / f"{name}.png").read_bytes()
    with written_whole(folder / "index.html") as temporary:
        temporary.write_text(comparison_page(comparison, pictures, made), encoding="utf-8")
