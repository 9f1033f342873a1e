"""What the studies of mechanisms conclude from made-up records; they are not run."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from benchmarks import nitrogen, recovery_of_rules
from benchmarks.lines import append_line
from benchmarks.nitrogen_colonies import DISHES, NAMES, NITROGEN, VALUES, Study, plain
from benchmarks.nitrogen_page import answer, statements, stopped, summary, verdict
from yeastfit import InputError

SMALL = DISHES[0]


def colony(
    amount: float, member: int, cells: Sequence[float], compactness: Sequence[float], **others: Any
) -> dict[str, Any]:
    """A record with four samples; filament indices are a tenth of the compactness, all others alike."""
    indices = {name: [0.1 * one for one in compactness] for name in NAMES if "filament" in name}
    curves = dict.fromkeys(NAMES, compactness) | indices | {"cell_count": cells}
    return {
        **{"dish": plain(SMALL), "values": VALUES | NITROGEN, "amount": amount},
        **{"member": member, "times": [1.0, 2.0, 3.0, 4.0], "nitrogen left": 0.1, "statistics": curves, "warnings": []},
        **{"processor seconds": 1.0},
        **others,
    }


@pytest.fixture
def study(tmp_path: Path) -> Study:
    """Colonies that stop early and grow hairs with little nitrogen, and stay round with much."""
    for member in range(4):
        jitter = 0.1 * member
        little = [3.0 + jitter, 4.0 + jitter, 8.0 + jitter, 9.0 + jitter]
        append_line(
            tmp_path / "colonies.jsonl", colony(1.0, member, [10, 50 + member, 50 + member, 50 + member], little)
        )
        much = [2.0 + jitter, 2.1 + jitter, 2.2 + jitter, 2.3 + jitter]
        append_line(tmp_path / "colonies.jsonl", colony(10.0, member, [10, 70, 90 + member, 90 + member], much))
    return Study((SMALL,), (1.0, 10.0), 8, tmp_path)


def test_statements_are_judged_from_the_colonies(study: Study) -> None:
    found = {row["statement"]: row["verdict"] for row in statements(study, SMALL)}
    assert len(found) == 8
    assert set(found.values()) == {"holds"}
    assert summary(study)[0]["colonies"] == 4
    assert summary(study)[0]["births stopped by"] == "t = 2"
    assert "births have stopped; 10 times the nitrogen makes the rounder colony, by C: holds" in answer(study)


def test_colonies_without_a_core_are_left_out_for_filament_indices(study: Study) -> None:
    """Their I_F is above 1; what else is said of them counts, and how many are left is told."""
    hollow = colony(10.0, 4, [10, 70, 90, 90], [2.0, 2.1, 2.2, 2.3])
    hollow["statistics"]["filament_area_index"] = [0.2, 0.21, 0.22, 1.5]
    append_line(study.work / "colonies.jsonl", hollow)
    many = summary(study)[1]
    assert (many["colonies"], many["of these with I_F and I_R"]) == (5, 4)
    assert {row["verdict"] for row in statements(study, SMALL)} == {"holds"}
    assert "1.5" not in many["I_F"]


def test_a_colony_that_is_still_budding_is_said(study: Study) -> None:
    append_line(study.work / "colonies.jsonl", colony(1.0, 4, [10, 50, 60, 70], [3.0, 4.0, 8.0, 9.0]))
    first = statements(study, SMALL)[0]
    assert (first["verdict"], first["numbers"]) == ("does not hold", "in 8 of 9 colonies")
    assert "still born at the end in 1 of 9 colonies, and 10 % of the nitrogen is left" in answer(study)


def test_verdicts_have_three_outcomes() -> None:
    low, high, wide = np.array([1.0, 1.1, 1.2]), np.array([2.0, 2.1, 2.2]), np.array([0.0, 1.1, 2.4])
    assert verdict(low, high) == "holds"
    assert verdict(high, low) == "does not hold"
    assert verdict(low, wide) == "not resolved"
    assert verdict(np.full(3, 5.0), np.full(3, 9.0)) == "holds"
    assert verdict(np.full(3, 9.0), np.full(3, 5.0)) == "does not hold"
    assert verdict(low[:1], high) == "not resolved: fewer than two colonies"


@pytest.mark.parametrize(("cells", "sample"), [([5, 5, 5, 5], 0), ([1, 2, 5, 5], 2), ([1, 2, 3, 4], 3)])
def test_births_stop_at_the_first_sample_with_all_cells(cells: list[float], sample: int) -> None:
    assert stopped(colony(1.0, 0, cells, [1.0] * 4)) == sample


@pytest.mark.parametrize("other", [{"values": {"mobility": 5.0}}, {"dish": {"name": "small", "side": 41.0}}])
def test_colonies_of_another_study_are_refused(study: Study, other: dict[str, Any]) -> None:
    append_line(study.work / "colonies.jsonl", colony(1.0, 5, [1, 2, 3, 3], [1.0] * 4, **other))
    with pytest.raises(InputError, match="holds colonies of other dishes or parameters"):
        summary(study)


def test_an_unknown_size_is_refused() -> None:
    with pytest.raises(InputError, match=r"--sizes is 'huge', it must be none or some of small,middle,real"):
        nitrogen.study_of(False, Path("out"), "huge")
    assert nitrogen.study_of(False, Path("out"), "none")[1] == ()


def test_pulls_of_recovered_parameters() -> None:
    """A fit that determines all, one that leaves the rule's own open, and one that failed."""
    names = recovery_of_rules.CASES["clocks"].free
    exact = dict(zip(names, np.log([1.0, 1.0, 0.3]) + np.array([0.0, 0.1, -0.2]), strict=True))
    errors = dict.fromkeys(names, 0.1)
    records = [
        {"rule": "clocks", "seed": 1, "status": "converged", "log": exact, "error": errors},
        {"rule": "clocks", "seed": 2, "status": "converged", "log": exact, "error": {**errors, names[2]: None}}
        | {"warnings": ["the data do not see it", "fix it"]},
        {"rule": "clocks", "seed": 3, "status": "failed", "log": dict.fromkeys(names), "error": dict.fromkeys(names)},
    ]
    rows = recovery_of_rules.rows_of(records)
    assert [row["pull"] for row in rows[:3]] == pytest.approx([0.0, 1.0, -2.0])
    found = {row["parameter"]: row for row in recovery_of_rules.summary(rows)}
    assert [found[name]["determined"] for name in names] == ["2 of 3", "2 of 3", "1 of 3"]
    assert found["cycle_variation"]["rms pull"] == pytest.approx(2.0)
    assert found["metabolic_rate"]["median error %"] == pytest.approx(100 * np.expm1(0.1))
    assert [row["doubts"] for row in recovery_of_rules.said(records[::-1])] == [
        "none",
        "the data do not see it; fix it",
        "none",
    ]
