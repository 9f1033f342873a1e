"""Errors of outlines: statistics of photographs beside those of masks of the same colonies.

For n colonies, each with a photograph p and a mask q made by others, a statistic S has

    bias  b = mean of S(p) − S(q), its standard error s / √n,    s = standard deviation of S(p) − S(q),

all over |mean of S(q)|. The bias is common to all colonies and does not average out; s is what every colony has for
itself. s over the standard deviation of S(q) between colonies of a condition says how much of what tells them apart an
outline hides. √(b² + s²/n) is the error of a mean over these n, beside the relative error that `fit`, `infer` and
`design` of the off-lattice model take (`yeastfit.measure.outlining.outline_errors`). So does `infer --match area`. Both
take s / √2, the error of one of two outlines that are alike, for single colonies whose parameters may differ.
Colonies of the algebraic model over time take what synthetic micrographs show, 2 % for compactness and 1 % for others;
give `--measurement-error` for photographs of filamentous colonies. Neither outline is the truth: others drew the masks.

    python -m benchmarks.outline_errors RAW_DIR MASK_DIR [--docs docs]

The photographs and masks are those of Li et al. 2024 (`model.md`), paired by file name.
"""

from pathlib import Path

import numpy as np

from benchmarks.report import Report, command
from yeastfit.measure.outlining.outline_errors import COLONY_ERRORS, OUTLINE_ERRORS
from yeastfit.measure.outlining.segmentation import segment
from yeastfit.measure.reading.images import read_image
from yeastfit.measure.statistics.pixels import Pixels
from yeastfit.measure.statistics.registry import STATISTICS, most_telling_first, names_with
from yeastfit.offlattice.simulator import known_statistics
from yeastfit.offlattice.statistics.li2024_statistics import PUBLISHED
from yeastfit.offlattice.statistics.smoothed_branch_index import SMOOTHED
from yeastfit.offlattice.statistics.smoothed_outline import TEXTURE

FEWEST = 3  # pairs


def measured(path: Path, mask: Path) -> tuple[dict[str, float], dict[str, float], float]:
    """Statistics of a photograph and of a mask, and the intersection over union."""
    photographed = segment(read_image(path), name=path.name).mask
    given = read_image(mask) < 128
    known, names = known_statistics(), _names()
    both = [{name: known[name].mask(Pixels.of(one)) for name in names} for one in (photographed, given)]  # type: ignore[misc]
    return both[0], both[1], float((photographed & given).sum() / (photographed | given).sum())


def _names() -> tuple[str, ...]:
    comparable = [name for name in names_with("mask") if STATISTICS[name].comparable]
    return (*most_telling_first(tuple(comparable)), *PUBLISHED, SMOOTHED.name, *(one.name for one in TEXTURE))


def compare(report: Report, quick: bool) -> None:
    """Measure all pairs, or the first of them."""
    raw, masks = report.folders
    paths = [path for path in sorted(raw.glob("*.tif")) if (masks / path.name).is_file()][: FEWEST if quick else None]
    if len(paths) < FEWEST:
        raise SystemExit(f"{raw}, {masks}: {len(paths)} photographs with a mask of the same name, need {FEWEST}")
    found = []
    for path in paths:
        found.append(report.part(path.name, lambda path=path: measured(path, masks / path.name)))  # type: ignore[misc]
        report.stage(path.name)
    report.add("pairs", len(found), "")
    report.add("intersection over union, median", float(np.median([one[2] for one in found])), "")
    conditions = [path.name.rsplit("_", 1)[0] for path in paths]
    known, rows = known_statistics(), []
    for name in _names():
        of_photographs, of_masks = (np.array([one[k][name] for one in found]) for k in (0, 1))
        size, off = abs(of_masks.mean()), of_photographs - of_masks
        if not np.isfinite(off).all() or size == 0:
            continue
        spread = off.std(ddof=1)
        apart = [of_masks[[one == other for other in conditions]] for one in set(conditions)]
        squares = sum(float(np.sum((one - one.mean()) ** 2)) for one in apart)
        between = np.sqrt(squares / max(len(found) - len(apart), 1))
        rows.append(
            {
                "statistic": name,
                "mean of masks, pixels": float(of_masks.mean()),
                "bias b, %": 100 * float(off.mean() / size),
                "its error, %": 100 * float(spread / np.sqrt(len(found)) / size),
                "scatter s, %": 100 * float(spread / size),
                "s over sd between colonies": float(spread / between) if between > 0 else float("nan"),
                "error of the mean, %": 100 * float(np.hypot(off.mean(), spread / np.sqrt(len(found))) / size),
                "inference takes, %": 100 * OUTLINE_ERRORS.get(name, known[name].measurement_error),
                "of single colonies, %": 100 * COLONY_ERRORS.get(name, 0.0),
            }
        )
    report.table("photographs against masks", rows)
    if report.docs is not None:
        (report.docs / "outlines.md").write_text("\n\n".join([report.head(__doc__), *report.sections()]) + "\n")


if __name__ == "__main__":
    command("outline_errors", compare, folders=("RAW_DIR", "MASK_DIR"))
