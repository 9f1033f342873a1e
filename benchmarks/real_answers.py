"""Answers of the runs of real colonies, a few sentences: what `yeastfit compare` found, for a reader in a hurry.

Every one is computed from the comparisons, WORK/models/SET, WORK/comparison and WORK/nitrogen-compared.
"""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from yeastfit.inference.comparison.left_out import LeftOut
from yeastfit.inference.posterior.predictive_check import Predictive
from yeastfit.results.contents import MANIFEST
from yeastfit.storage import read_json

POOR, RICH, OTHER = "awri796-50um", "awri796-500um", "simi-white-50um"
CALLED = {POOR: "AWRI 796, 50 µM", RICH: "AWRI 796, 500 µM", OTHER: "Simi White, 50 µM"}
MODELS = {
    "offlattice-3": "the off-lattice model",
    "nitrogen": "the algebraic model with nitrogen",
    "clocks": "that with births by clocks",
    "death": "that with death by starvation",
    "polar": "that with polar budding",
    "algebraic": "the algebraic model with an endless nutrient",
}
MEDIA = 10.0  # ratio of nitrogen in the two media

Row = Mapping[str, Any]


def answers(work: Path) -> list[str]:
    """Question and answer, as far as the runs are there."""
    models = {name: found for name in CALLED if (found := comparison_in(work / "models" / name))}
    said = [f"**Which model predicts colonies that it has not seen?** {_best(models)}"] if models else []
    if missed := _missed(work):
        said.append(f"**What does it not explain?** {missed}")
    if found := comparison_in(work / "comparison"):
        media, strains = (_changes(found["conditions"], *pair) for pair in ((RICH, POOR), (OTHER, POOR)))
        said.append(f"**What differs between 500 and 50 µM of ammonium** (AWRI 796, off-lattice model)**?** {media}")
        said.append(f"**What differs between the strains** (Simi White and AWRI 796 at 50 µM)**?** {strains}")
    if found := comparison_in(work / "nitrogen-compared"):
        said.append(f"**Do the media differ in the model's nitrogen by their factor of ten?** {_nitrogen(found)}")
    return said


def comparison_in(folder: Path) -> Any:
    """What a comparison found; None where it is not there."""
    return read_json(folder / "comparison.json") if (folder / MANIFEST).is_file() else None


def _best(models: Mapping[str, Any]) -> str:
    said = []
    for name, found in models.items():
        first, *others = sorted(found["models"], key=lambda row: row["behind_best"])
        unsettled = {
            row["run"] for row in others if any(one.startswith(f"{row['run']}: not") for one in found["doubts"])
        }
        behind = [
            f"{_model(row)} by {row['behind_best']:.0f} ± {row['error_of_that']:.0f}"
            + ("" if row["worse"] == "yes" else ", which may be chance")
            + (" (not settled)" if row["run"] in unsettled else "")
            for row in others
        ]
        scored = f"log density {first['log_density']:.1f} ± {first['standard_error']:.1f}"
        said.append(f"{CALLED[name]}: {_model(first)} ({scored}), ahead of {'; '.join(behind)}.")
    return " ".join(said)


def _missed(work: Path) -> str:
    """By the off-lattice model, asked by all its statistics: means and single colonies that it does not predict."""
    said = []
    for name in CALLED:
        folder = work / "offlattice" / name
        if not (folder / MANIFEST).is_file():
            continue
        mean = Predictive.load(folder / "predictive.npz")
        far = [_words(label) for label, inside in zip(mean.labels, mean.inside(0.9), strict=True) if not inside]
        fails = [f"{_words(label)} {what}" for label, what in LeftOut.load(folder / "left_out.npz").failures().items()]
        means = f"means of {', '.join(far)} outside the predicted 90 %" if far else "nothing in its means"
        said.append(f"{CALLED[name]}: {means}; of single colonies {'; '.join(fails) or 'nothing'}.")
    return " ".join(said)


def _changes(rows: Sequence[Row], first: str, second: str) -> str:
    """Parameters of `first` over those of `second`, where the data tell them apart."""
    changes = _between(rows, first, second)
    told = [_change(row) for row in changes if row["told_apart"] == "yes"]
    rest = [_words(row["parameter"]) for row in changes if row["told_apart"] != "yes"]
    of = f"{CALLED[first]} over {CALLED[second]}: "
    return (of + "; ".join(told) + "." if told else "Nothing that these data tell.") + (
        f" Not told apart: {', '.join(rest)}." if told and rest else ""
    )


def _between(rows: Sequence[Row], first: str, second: str) -> list[Row]:
    """Of two conditions, one of them first."""
    return [_turned(row, first) for row in rows if {row["first"], row["second"]} == {first, second}]


def _turned(row: Row, first: str) -> Row:
    """A row of two conditions with this one as the first."""
    if row["first"] == first:
        return row
    low, middle, high = (_inverse(row[name]) for name in ("ratio_q95", "ratio", "ratio_q05"))
    return {**row, "ratio_q05": low, "ratio": middle, "ratio_q95": high, "first_larger": 1 - row["first_larger"]}


def _inverse(ratio: float) -> float:
    return 1 / ratio if ratio else float("inf")


def _change(row: Row) -> str:
    name, larger = _words(row["parameter"]), float(row["first_larger"])
    sure = f"with probability {max(larger, 1 - larger):.3f}"
    if not row["ratio"] > 0:  # nan where one of them may be 0
        return f"{name} is {'larger' if larger > 0.5 else 'smaller'}, {sure}"
    return f"{name} × {row['ratio']:.2f} ({row['ratio_q05']:.2f} to {row['ratio_q95']:.2f}), {sure}"


def _nitrogen(found: Any) -> str:
    (row,) = (one for one in _between(found["conditions"], RICH, POOR) if one["parameter"] == "nitrogen")
    yes = row["ratio_q05"] <= MEDIA <= row["ratio_q95"]
    return (
        f"{'Yes' if yes else 'No'}: {CALLED[RICH]} has {row['ratio']:.1f} times the nitrogen of {CALLED[POOR]} "
        f"({row['ratio_q05']:.1f} to {row['ratio_q95']:.1f} with 90 %)."
        + "".join(f" To be doubted: {doubt}." for doubt in found["doubts"])
    )


def _model(row: Row) -> str:
    return MODELS[Path(row["run"]).parent.name]


def _words(name: str) -> str:
    return name.replace("_", " ")
