"""What finished colonies of `nitrogen` say: tables, verdicts and the picture of its page."""

from pathlib import Path

import numpy as np
from matplotlib.colors import ListedColormap
from matplotlib.figure import Figure
from scipy.stats import ttest_ind

from benchmarks.nitrogen_colonies import INDICES, Dish, Record, Study
from yeastfit.plot.style import COLONY, CONDITIONS

REAL = {  # means of data/real/*/measurements.csv by ammonium sulphate, of AWRI 796, 8 colonies each
    "50 µM": {"compactness": 96.0, "filament_area_index": 0.209, "filament_radius_index": 0.164, "area": 25_280.0},
    "500 µM": {"compactness": 21.0, "filament_area_index": 0.177, "filament_radius_index": 0.111, "area": 45_670.0},
}

ALIKE = 2.0
MOST_BEYOND = 1.0  # I_F: 65 % of the pixels beyond r_CSR


def at_end(records: list[Record], name: str) -> np.ndarray:
    """A statistic of the colonies at the end, as `seen_at` has it."""
    return seen_at(records, name, [-1] * len(records))


def seen_at(records: list[Record], name: str, samples: list[int]) -> np.ndarray:
    """A statistic of the colonies at a sample each; filament indices of those alone whose r_CSR is the core's edge."""

    def taken(name: str) -> np.ndarray:
        return np.array([record["statistics"][name][k] for record, k in zip(records, samples, strict=True)])

    found = taken(name)
    return found[taken("filament_area_index") <= MOST_BEYOND] if name.startswith("filament") else found


def stopped(record: Record) -> int:
    """Number of the sample by which all cells of the end were born."""
    cells = record["statistics"]["cell_count"]
    return next(k for k, count in enumerate(cells) if count == cells[-1])


def record_stopped(record: Record) -> bool:
    """Whether nobody was born in the last interval."""
    return stopped(record) < len(record["times"]) - 1


def answer(study: Study) -> str:
    """What the finished colonies say to the question of the study."""
    parts = []
    for dish in study.dishes:
        of = [record for key, record in study.done.items() if key[0] == dish.name]
        ended = sum(map(record_stopped, of))
        if not of:
            parts.append(f"{dish.name} dish: no colony has been grown, the question is open.")
        elif ended < len(of):
            left = 100 * np.mean([record["nitrogen left"] for record in of])
            parts.append(
                f"{dish.name} dish: cells are still born at the end in {len(of) - ended} of {len(of)} colonies, and "
                f"{left:.0f} % of the nitrogen is left: it is scarce around cells, but the dish has not run out, and "
                "the question is open. The table says what the amount of nitrogen does before."
            )
        else:
            said = [f"{row['statement']}: {row['verdict']}" for row in statements(study, dish)[2:]]
            parts.append(f"{dish.name} dish: births have stopped; {'; '.join(said)}.")
    parts += beside_photographs(study)
    return "\n".join(f"- {part[0].upper()}{part[1:]}" for part in parts)


def beside_photographs(study: Study) -> list[str]:
    """How often as large the indices of the largest colonies are as those of photographs, and what that means."""
    least, most = (study.of(study.dishes[-1], amount) for amount in (study.amounts[0], study.amounts[-1]))
    if not least or not most:
        return []
    ratios = {
        symbol: [
            float(np.mean(at_end(of, name))) / real[name] if len(at_end(of, name)) else np.nan
            for of, real in zip((least, most), REAL.values(), strict=True)
        ]
        for name, symbol in INDICES.items()
    }
    alike = all(1 / ALIKE < ratio < ALIKE for pair in ratios.values() for ratio in pair)
    said = ", ".join(f"{symbol} is {few:.2g} and {many:.2g} times theirs" for symbol, (few, many) in ratios.items())
    return [
        f"{study.dishes[-1].name} dish beside photographs at {' and '.join(REAL)}: {said}. With these cells, a dish "
        f"that runs out of nitrogen {'makes' if alike else 'does not make'} the colonies that photographs show "
        f"(within a factor of {ALIKE:g} in each index)."
    ]


def verdict(low: np.ndarray, high: np.ndarray) -> str:
    """Whether the mean of `low` lies below that of `high`."""
    if min(len(low), len(high)) < 2:
        return "not resolved: fewer than two colonies"
    if not low.std() and not high.std():  # numbers of cells that nitrogen decides, all alike
        return "holds" if high[0] > low[0] else "does not hold"
    interval = ttest_ind(high, low, equal_var=False).confidence_interval(0.95)
    return "holds" if interval.low > 0 else "does not hold" if interval.high < 0 else "not resolved"


def statements(study: Study, dish: Dish) -> list[Record]:
    """What the colonies of one dish say."""
    least, most = (study.of(dish, amount) for amount in (study.amounts[0], study.amounts[-1]))
    if not least or not most:
        return []
    ratio = study.amounts[-1] / study.amounts[0]
    cells = [at_end(of, "cell_count") for of in (least, most)]
    early = sum(map(record_stopped, [*least, *most]))
    rows = [
        {
            "statement": "births have stopped before the end",
            "verdict": "holds" if early == len(least) + len(most) else "does not hold",
            "numbers": f"in {early} of {len(least) + len(most)} colonies",
        },
        {
            "statement": f"{ratio:g} times the nitrogen makes more cells",
            "verdict": verdict(*cells),
            "numbers": f"{_spread(cells[0])} and {_spread(cells[1])}",
        },
    ]
    for name, symbol in INDICES.items():
        few, many = (at_end(of, name) for of in (least, most))
        rows.append(
            {
                "statement": f"{ratio:g} times the nitrogen makes the rounder colony, by {symbol}",
                "verdict": verdict(many, few),
                "numbers": f"{_spread(few)} and {_spread(many)}; photographs {_real(name)}",
            }
        )
    ended = [record for record in least if record_stopped(record)]
    for name, symbol in INDICES.items():
        then = seen_at(ended, name, [stopped(record) for record in ended])
        rows.append(
            {
                "statement": f"with the least nitrogen {symbol} rises after the last birth: drift draws out hairs",
                "verdict": verdict(then, at_end(ended, name)) if ended else "not tested: no colony has stopped",
                "numbers": f"{_spread(then)}, then {_spread(at_end(ended, name))}" if ended else "",
            }
        )
    return [{"dish": dish.name, **row} for row in rows]


def _real(name: str) -> str:
    return " and ".join(f"{values[name]:.3g} ({what})" for what, values in REAL.items())


def _spread(values: np.ndarray) -> str:
    if not len(values):
        return "none"
    deviation = f" ± {values.std(ddof=1):.2g}" if len(values) > 1 else ""
    return f"{values.mean():.3g}{deviation}"


def summary(study: Study) -> list[Record]:
    """A row for each dish and amount with finished colonies, means ± standard deviations."""
    rows = []
    for dish in study.dishes:
        for amount in study.amounts:
            of = study.of(dish, amount)
            if of:
                row: Record = {
                    "dish": dish.name,
                    "side": f"{dish.side:g}",
                    "nitrogen ν": f"{amount:g}",
                    "colonies": len(of),
                }
                row |= {symbol: _spread(at_end(of, name)) for name, symbol in INDICES.items()}
                row["of these with I_F and I_R"] = len(at_end(of, "filament_area_index"))
                row |= {"area (L0²)": _spread(at_end(of, "area")), "cells": _spread(at_end(of, "cell_count"))}
                row["nitrogen left"] = f"{100 * np.mean([record['nitrogen left'] for record in of]):.2g} %"
                row["colonies with warnings"] = sum(bool(record["warnings"]) for record in of)
                row["births stopped by"] = f"t = {max(record['times'][stopped(record)] for record in of):g}"
                rows.append(row)
    return rows


def picture(study: Study, path: Path) -> None:
    """Plot the first colony of every dish and amount, and the indices against nitrogen."""
    dishes = [dish for dish in study.dishes if any(study.of(dish, amount) for amount in study.amounts)]
    figure = Figure(figsize=(4.2 * max(3, len(study.amounts)), 4 * (len(dishes) + 1)), layout="constrained")
    lines = figure.subfigures(len(dishes) + 1, 1, squeeze=False)[:, 0]
    for line, dish in zip(lines, dishes, strict=False):
        for panel, amount in zip(line.subplots(1, len(study.amounts)), study.amounts, strict=True):
            panel.axis("off")
            if study.mask(dish, amount).is_file():
                with np.load(study.mask(dish, amount)) as kept:
                    mask, side = kept["mask"], float(kept["side"])
                half = 0.5 * side
                panel.imshow(
                    mask.T, origin="lower", extent=(-half, half, -half, half), cmap=ListedColormap(["white", COLONY])
                )
                cells = study.of(dish, amount)[0]["statistics"]["cell_count"][-1]
                panel.set_title(f"{dish.name} dish ({side:g} L0), ν = {amount:g}: {cells:.0f} cells", fontsize=10)
    for panel, (name, symbol) in zip(lines[-1].subplots(1, 3), INDICES.items(), strict=True):
        for dish, colour in zip(dishes, CONDITIONS, strict=False):
            given = [amount for amount in study.amounts if len(at_end(study.of(dish, amount), name))]
            values = [at_end(study.of(dish, amount), name) for amount in given]
            errors = [one.std(ddof=1) if len(one) > 1 else 0.0 for one in values]
            panel.errorbar(
                given, [one.mean() for one in values], errors, fmt="o-", color=colour, capsize=3, label=dish.name
            )
        for number, (what, real) in enumerate(REAL.items()):
            panel.axhline(real[name], color="0.4", ls=("--", ":")[number], lw=1, label=f"photographs, {what}")
        panel.set(xscale="log", xlabel="nitrogen ν", ylabel=symbol)
        panel.set_xticks(study.amounts, [f"{amount:g}" for amount in study.amounts])
        panel.set_xticks([], minor=True)
    panel.legend(fontsize=8)
    figure.savefig(path, dpi=75)
