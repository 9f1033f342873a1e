"""Colonies that get smaller are told of."""

import math

import pytest

from yeastfit.measure.replicate_curves import shrunk_colonies


def row(replicate: str, hours: float | None, area: float, condition: str = "") -> dict[str, object]:
    return {"file": f"{replicate}_{hours}.png", "condition": condition, "replicate": replicate} | {
        "hours": hours,
        "area": area,
    }


def test_a_colony_that_gets_smaller_is_named() -> None:
    rows = [row("a", 8.0, 80.0), row("a", 4.0, 100.0), row("a", 12.0, 300.0), row("b", 4.0, 50.0), row("b", 8.0, 60.0)]
    (said,) = shrunk_colonies(rows)
    assert said == (
        "the colony of a_8.0.png has 80 µm² at 8 h, less than 100 µm² at 4 h in a_4.0.png: are hours, replicate and "
        "outlines right?"
    )


@pytest.mark.parametrize(
    "later",
    [row("a", 8.0, 91.0), row("a", None, 10.0), row("b", 8.0, 10.0), row("a", 8.0, 10.0, "x"), row("a", 8.0, math.nan)],
)
def test_others_are_not(later: dict[str, object]) -> None:
    """Errors of outlines, images without hours, other colonies, and areas that are not known."""
    assert shrunk_colonies([row("a", 4.0, 100.0), later]) == []


def test_many_are_counted() -> None:
    rows = [row(str(k), hours, 100 - 10 * hours) for k in range(7) for hours in (1.0, 3.0)]
    *named, rest = shrunk_colonies(rows)
    assert len(named) == 3
    assert rest == "4 more colonies get smaller"
