"""How wide are the gaps that an outline of a photograph closes?

Cells of a simulated colony leave gaps between them, thousands of which an outline drawn in a photograph does not show.
Ellipses are therefore drawn with all gaps closed that are narrower than a width, `--gap`. Here that width is found by
what real masks show, the 8 of each set of `data/real`: how many holes they have and, of smoothed outlines, as real ones
have bumps, how rough they are (compactness), how long their skeletons are and how many ends these have (smoothed I_B).
Colonies are simulated at the means of Li et al.'s published posteriors, which were inferred from other drawings, of
bins of 4 pixels, and drawn at the areas of the real ones. Where a statistic of them falls as wider gaps are closed, it
agrees with the real one at some width, found on a line between two widths by the statistic's logarithm. Two cells in
yeast form are 12 µm wide together.

    python -m benchmarks.gaps [--quick] [--json FILE] [--docs DIR]
"""

from typing import Any

import numpy as np
from jaxtyping import Float

from benchmarks.offlattice import SETS
from benchmarks.offlattice_runs import real_colonies
from benchmarks.real_answers import CALLED
from benchmarks.report import Report, command
from yeastfit.offlattice.colony import grow, in_threads
from yeastfit.offlattice.masks.area_matching import match_exactly
from yeastfit.offlattice.masks.ellipse_mask import GAP, Ellipses
from yeastfit.offlattice.masks.li2024_mask import BinnedOutlines
from yeastfit.offlattice.placing import PIXELS_PER_UM
from yeastfit.offlattice.simulator import Picture, statistics_of

FALLING = ("hole_count", "smoothed_compactness", "smoothed_branch_length", "smoothed_branch_index")  # with the width
SHOWN = (*FALLING, "li2024_filament_area_index", "li2024_filament_radius_index")
WIDTHS = (0.0, 3.0, 6.0, 9.0, 12.0, 15.0, 18.0, 24.0)  # µm
MORE = 1.2  # times as many cells grow as in Li et al.'s colonies, for their area


def run(report: Report, quick: bool) -> None:
    """Draw colonies with gaps of every width closed, and compare them with real ones."""
    widths = list[float]()
    drawings = [*(f"ellipses, {width:g} µm" for width in WIDTHS), "bins", "**real**"]
    for key, name in CALLED.items():
        real = real_colonies(key, (*SHOWN, "area"))[: 2 if quick else None]
        means = np.vstack([drawn(name, real[:, -1]).mean(axis=0), real[:, :-1].mean(axis=0)])
        rows: list[dict[str, Any]] = [
            {"drawn as": drawing, **dict(zip(SHOWN, mean, strict=True))}
            for drawing, mean in zip(drawings, means.tolist(), strict=True)
        ]
        report.table(name, rows)
        for k, statistic in enumerate(FALLING):
            widths.append(width_at(means[: len(WIDTHS), k], means[-1, k]))
            report.add(f"{name}: {statistic} agrees at", widths[-1], "µm")
    note = f"of {len(widths)}; the default is {GAP:g} µm"
    report.add("median of these widths", float(np.nanmedian(widths)), "µm", note=note)
    if report.docs is not None:
        report.docs.mkdir(parents=True, exist_ok=True)
        page = "\n\n".join([report.head(__doc__), *report.sections()])
        (report.docs / "gaps.md").write_text(page, encoding="utf-8")


def drawn(name: str, areas: Float[np.ndarray, " colony"]) -> Float[np.ndarray, "colony drawing statistic"]:
    """Statistics of colonies of these areas, in µm², drawn with gaps of each width closed and of bins."""
    values, cells, of_theirs = SETS[name]

    def measured(item: tuple[int, float]) -> list[list[float]]:
        seed, area = item
        colony = grow(values, cells=int(MORE * cells * area * PIXELS_PER_UM**2 / of_theirs), seed=seed)
        pictures: list[Picture] = [Ellipses.of(colony, gap=width) for width in WIDTHS]
        pictures.append(BinnedOutlines.whole(colony))
        found = []
        for picture in pictures:
            mask = match_exactly(picture.mask, colony.x.size, area / picture.pixel_size**2).mask
            values_of = statistics_of(mask, picture.pixel_size, SHOWN)
            found.append([values_of[one] for one in SHOWN])
        return found

    return np.array(in_threads(measured, list(enumerate(areas.tolist())), None))


def width_at(found: Float[np.ndarray, " width"], wanted: float) -> float:
    """Where a statistic that falls with the width is as wanted; nan where it nowhere is, or has no logarithm."""
    if not (0 < found[-1] <= wanted <= found[0]):
        return float("nan")
    return float(np.interp(np.log(wanted), np.log(found[::-1]), WIDTHS[::-1]))


if __name__ == "__main__":
    command("gaps", run)
