"""How well colonies are outlined: python -m benchmarks.segmentation RAW_DIR MASK_DIR [--quick] [--json FILE].

RAW_DIR holds photographs, MASK_DIR masks, paired by file name; masks without a photograph are allowed. For each pair
the table has the intersection over union with the mask, the same for Otsu's threshold, processor seconds and warnings.
Statistics of all masks are compared with the published means of their conditions, which the first two parts of a file
name give (`awri796_50um_s01`). A published mean is over N colonies, of which n are available here; the mean of these n
is compared with it in units of its sampling error s / √n · √(1 − n / N).

Then the photographs of data/synthetic are compared with their true masks, and so are hard cases drawn from the masks
(`hard_cases`): uneven light, shadows, bands, tiles, frames, other objects, faint and noisy colonies; one of each with
--quick.
"""

import time
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from math import sqrt
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Bool
from skimage.filters import threshold_otsu

from benchmarks.hard_cases import CASES, photograph
from benchmarks.report import Report, command
from yeastfit.errors import InputError
from yeastfit.measure.outlining.segmentation import Segmentation, segment
from yeastfit.measure.reading.dataset import read_dataset
from yeastfit.measure.reading.images import read_image
from yeastfit.measure.statistics.measure_mask import measure_mask

Mask = Bool[np.ndarray, "row column"]

SYNTHETIC = Path(__file__).parents[1] / "data" / "synthetic"
STANDARD = 1600 * 1200  # px of an image that may take at most `SECONDS`
SECONDS = 2.0
MEDIAN, LOWEST = 0.975, 0.90  # of intersection over union


@dataclass(frozen=True)
class Published:
    """Means over `count` colonies of one condition."""

    count: int
    filament_area_index: float
    filament_radius_index: float
    area: float  # px


# Li et al. 2024 (docs/model.md), repository kaili2019/Li2024-off-lattice: means over all 41 colonies, and the areas in
# px at which their simulations aim
PUBLISHED = {
    "awri796_50um": Published(14, 0.2126, 0.1642, 573_920),
    "awri796_500um": Published(13, 0.1768, 0.1118, 1_052_300),
    "simiwhite_50um": Published(14, 0.1992, 0.1715, 825_329),
}
INDICES = ("filament_area_index", "filament_radius_index", "area")


def overlap(one: Mask, other: Mask) -> float:
    """Intersection over union."""
    return float((one & other).sum() / (one | other).sum())


def images(folder: Path) -> Iterator[Path]:
    """Image files of a folder, by name."""
    yield from sorted(path for path in folder.iterdir() if path.suffix.lower() in (".tif", ".tiff", ".png"))


def timed(pixels: Any, name: str) -> tuple[Segmentation, float]:
    """A segmentation and the processor time it took, in seconds per 1600 x 1200 px."""
    begin = time.process_time()
    found = segment(pixels, name=name)
    return found, (time.process_time() - begin) * STANDARD / pixels.size


def real(report: Report, raw: Path, masks: dict[str, Mask]) -> None:
    """Compare photographs with their masks."""
    rows = []
    for path in images(raw):
        if path.name not in masks:
            continue
        pixels, truth = read_image(path), masks[path.name]
        found, seconds = timed(pixels, path.name)
        rows.append(
            {
                "file": path.name,
                "IoU": overlap(found.mask, truth),
                "Otsu's IoU": overlap(pixels < threshold_otsu(pixels), truth),
                "of the mask found": float((found.mask & truth).sum() / truth.sum()),
                "seconds": seconds,
                "warnings": "; ".join(found.warnings),
            }
        )
    if not rows:
        raise InputError(f"{raw}: no image there has a mask of the same name")
    report.table("photographs beside the authors' masks (seconds of one core per 1600 x 1200 px)", rows)
    ours = np.array([row["IoU"] for row in rows])
    otsu = np.array([row["Otsu's IoU"] for row in rows])
    worst = rows[int(ours.argmin())]
    report.add("median IoU", np.median(ours), "", MEDIAN, note=f"{len(rows)} pairs; Otsu {np.median(otsu):.3f}")
    note = f"{worst['file']}, {worst['of the mask found']:.1%} of whose mask is found; Otsu's lowest {otsu.min():.3f}"
    report.add("lowest IoU", ours.min(), "", LOWEST, note=note)
    others = np.delete(ours, ours.argmin())
    report.add("lowest IoU but one", others.min() if others.size else np.nan, "")
    taken = np.array([row["seconds"] for row in rows])
    report.add("longest, 1600 x 1200 px", taken.max(), "s", SECONDS, False, f"median {np.median(taken):.2f}")


def published(report: Report, masks: dict[str, Mask]) -> None:
    """Compare means per condition with the published ones."""
    rows, ratios = [], []
    for condition, there in PUBLISHED.items():
        shapes = [measure_mask(mask) for name, mask in masks.items() if name.startswith(condition + "_")]
        if len(shapes) < 2:
            continue
        for index in INDICES:
            values = np.array([getattr(shape, index) for shape in shapes])
            error = values.std(ddof=1) / sqrt(values.size) * sqrt(max(0.0, 1 - values.size / there.count))
            mean, expected = float(values.mean()), float(getattr(there, index))
            ratios.append(abs(mean - expected) / error if error else np.nan)
            rows.append(
                {
                    "condition": condition,
                    "statistic": index,
                    "n": values.size,
                    "N": there.count,
                    "mean here": mean,
                    "published": expected,
                    "difference %": 100 * (mean / expected - 1),
                    "sampling error %": 100 * float(error) / expected,
                }
            )
    if rows:
        report.table("masks beside the published means", rows)
        note = f"of {len(rows)}; 3 allows for that many"
        report.add("published means, furthest", max(ratios), "errors", 3.0, False, note)


def synthetic(report: Report, every: int) -> None:
    """Compare photographs of simulated colonies with their true masks."""
    rows = []
    for folder in sorted(path.parent for path in SYNTHETIC.glob("*/manifest.csv")):
        overlaps, compactness, doubts = [], [], Counter[str]()
        for frame in read_dataset(folder).frames[::every]:
            found = segment(read_image(frame.path), name=frame.path.name)
            truth = segment(read_image(folder / "truth" / "masks" / f"{frame.path.stem}.png")).mask
            overlaps.append(overlap(found.mask, truth))
            compactness.append(measure_mask(found.mask).compactness / measure_mask(truth).compactness - 1)
            doubts.update(found.warnings)
        bias = 100 * np.array(compactness)
        rows.append(
            {
                "set": folder.name,
                "images": len(overlaps),
                "IoU median": float(np.median(overlaps)),
                "IoU lowest": min(overlaps),
                "compactness mean %": float(bias.mean()),
                "compactness furthest %": float(np.abs(bias).max()),
                "warnings": "; ".join(f"{doubt}: {count}" for doubt, count in doubts.items()),
            }
        )
        report.add(f"{folder.name}: median IoU", np.median(overlaps), "", 0.97)
        report.add(f"{folder.name}: mean compactness", abs(float(bias.mean())), "% off", 5.0, False)
        report.add(f"{folder.name}: warnings", doubts.total(), "", 0, False, "all are clean")
    report.table("synthetic sets beside their true masks", rows)


def hard_cases(report: Report, masks: dict[str, Mask], quick: bool) -> None:
    """Photograph every mask in some of the hard cases, in turn; `--quick`: every case once."""
    names, cases = list(masks), list(CASES)
    pairs = [(names[k % len(names)], cases[k % len(cases)]) for k in range(len(cases) * (1 if quick else 4))]
    rows = []
    for number, (name, case) in enumerate(pairs):
        pixels = photograph(np.random.default_rng(number), masks[name], CASES[case])
        row: dict[str, Any] = {"case": case, "mask": name, "IoU": 0.0, "warnings": ""}
        try:
            found = segment(pixels, name=name)
            row |= {"IoU": overlap(found.mask, masks[name]), "warnings": "; ".join(found.warnings)}
        except InputError as error:
            row["warnings"] = str(error)
        rows.append(row)
    rows.sort(key=lambda row: cases.index(row["case"]))
    report.table("hard cases drawn from the masks", rows)
    overlaps = np.array([row["IoU"] for row in rows])
    report.add("hard cases: median IoU", np.median(overlaps), "", MEDIAN, note=f"{len(rows)} images")
    lowest = rows[int(overlaps.argmin())]
    report.add("hard cases: lowest IoU", overlaps.min(), "", LOWEST, note=f"{lowest['case']}, {lowest['mask']}")


def run(report: Report, quick: bool) -> None:
    """Run all four parts."""
    raw, folder = report.folders
    masks = {path.name: segment(read_image(path), name=path.name).mask for path in images(folder)}
    if not masks:
        raise InputError(f"{folder}: holds no TIFF or PNG file, need masks")
    report.stage("photographs")
    real(report, raw, masks)
    report.stage("published means")
    published(report, masks)
    report.stage("synthetic sets")
    synthetic(report, every=5 if quick else 1)
    report.stage("hard cases")
    hard_cases(report, masks, quick)


if __name__ == "__main__":
    command("segmentation", run, folders=("RAW_DIR", "MASK_DIR"))
