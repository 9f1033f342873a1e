"""Names of users are drawn as they are: no mathtext, no missing glyphs, nothing hidden."""

from pathlib import Path

import pytest
from matplotlib.figure import Figure

from yeastfit import InputError, plot
from yeastfit.plot.style import literal, words

NAMES = [
    "$x_1$ and $",
    "50 µM \\$ or \\alpha",
    "$\\frac{",
    "_hidden",
    "培养基 🧫",
    "a\nb\x1b[31m",
    "\u202efit.\udcff",
    "%s {0}",
    "$" * 9,
    "[red]x[/red]",
]


@pytest.mark.parametrize("name", NAMES)
def test_any_name_is_drawn_as_it_is(name: str) -> None:
    """Warnings are errors, also matplotlib's of missing glyphs."""
    figure = Figure()
    axes = figure.subplots()
    axes.plot([1, 2], label=literal(name))
    entry = axes.legend().get_texts()
    axes.set_title(literal(name, 3))
    axes.set_xlabel(f"{words(name)} in $\\mu$m" if name.count("$") else words(name))
    figure.canvas.draw()
    assert len(entry) == 1


def test_letters_that_the_font_lacks_become_their_code_points() -> None:
    assert literal("Δ培") == "Δ\\u57f9"
    assert literal("🧫") == "\\U0001f9eb"
    assert literal("_a$b") == " _a\\$b"
    assert literal("a b$ c", 3) == "a\nb\\$\nc"


def test_conditions_of_any_name_stand_in_the_legend() -> None:
    names = [*NAMES, "x" * 200]
    table = [
        {"condition": name, "replicate": replicate, "hours": hours, "area": 2.0 + k + hours + 0.1 * replicate}
        for k, name in enumerate(names)
        for replicate in (1, 2)
        for hours in (1.0, 2.0)
    ]
    mean = [
        {"statistic": "area", "condition": row["condition"], "hours": row["hours"], "mean": row["area"]}
        | {"standard_deviation": 0.1}
        for row in table
        if row["replicate"] == 1
    ]
    for rows in (table, [row for row in table if row["hours"] == 1]):
        curves = [curve for curve in mean if curve["hours"] in {row["hours"] for row in rows}]
        figure = plot.condition_curves(rows, curves, {"area": "µm²"})
        figure.canvas.draw()
    over_time = plot.condition_curves(table, mean, {"area": "µm²"})
    assert len(over_time.legends[0].get_texts()) == len(names)


def test_a_picture_of_no_known_format_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"fit.xyz: its ending 'xyz' is that of no picture, known are .*png"):
        plot.save(Figure(), tmp_path / "fit.xyz")
    plot.save(Figure(), tmp_path / "fit.pdf")
    assert [path.name for path in tmp_path.iterdir()] == ["fit.pdf"]
