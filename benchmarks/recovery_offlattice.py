"""Recovery of the off-lattice model's parameters from photographs of its colonies.

The true parameters are the published posterior means of three sets of colonies (Li et al. 2024). For each, fourteen
colonies of 45 000 cells are grown, drawn as Li et al. draw them when nine tenths of the cells are there, and
photographed: 1.55 µm a pixel, thicker inside, with the light, blur, noise and dust of a micrograph
(`yeastfit.simulation.photograph`). In such masks gaps between cells are filled, as they are in photographs of real
colonies; single ellipses with open gaps look like none of those. `yeastfit measure` outlines and measures the
photographs, and

    yeastfit infer MEASURED --model offlattice --cells 45000

finds the five parameters from I_F, I_R, I_B of smoothed outlines and the angular index, the default; once more without
the last; and from I_F, I_R and I_B as Li et al. have it, by --statistics li2024. A rank is the share of draws below the
true value; a pull is (mean − true value) / standard deviation.

Target, for the default: 90 % intervals contain at least 12 of the 15 true values, which 94 % of calibrated posteriors
would reach. The tables say besides how far outlines of photographs are from the masks that were photographed.

    python -m benchmarks.recovery_offlattice [--quick] [--json FILE] [--docs DIR] [--work DIR]

Photographs, measurements and posteriors are kept in the folder given by --work, out/recovery-offlattice by default; an
interrupted run continues there. --quick: one set of four colonies of 5000 cells, a short emulator and no target. --docs
writes DIR/recovery-offlattice.md.
"""

import argparse
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from scipy import ndimage

from benchmarks.li2024_published import PUBLISHED_POSTERIORS
from benchmarks.report import Report, command
from yeastfit.commands import app as cli
from yeastfit.errors import InputError
from yeastfit.inference.models.last_images import measured as measured_in_um
from yeastfit.inference.models.offlattice import COMPARABLE
from yeastfit.inference.posterior.result import Posterior
from yeastfit.measure.measurements_table import TABLE, read_measurements
from yeastfit.offlattice.colony import OfflatticeColony, grow
from yeastfit.offlattice.masks.li2024_mask import BinnedOutlines
from yeastfit.offlattice.parameters import PARAMETERS
from yeastfit.offlattice.placing import PIXELS_PER_UM
from yeastfit.offlattice.simulator import statistics_of
from yeastfit.offlattice.statistics.li2024_statistics import PUBLISHED
from yeastfit.results.contents import MANIFEST
from yeastfit.seeds import photograph_stream
from yeastfit.simulation.photograph import Optics, photograph, write_micrograph
from yeastfit.storage import write_table

PIXEL = 1 / PIXELS_PER_UM  # µm
SHOWN = 0.9  # of the cells are there when a colony is photographed
MARGIN = 40  # pixels around a colony
LAYER = 4.0  # pixels inwards from the edge for each further layer of cells
MOST_LAYERS = 15.0
OPTICS = Optics(blur=2.0)  # of an objective of four times
STATISTICS = {"default": COMPARABLE, "without angular index": COMPARABLE[:3], "I_B": PUBLISHED}
NAMES = (*PUBLISHED, "smoothed_branch_index", "angular_index", "branch_length", "compactness", "area")
LEAST = 12  # of 15 true values inside 90 % intervals: 94 % of binomial(15, 0.9)
HOURS = 233.0
Record = dict[str, Any]


@dataclass(frozen=True)
class Study:
    """What is recovered: colonies of so many cells, by which statistics, and further options of `infer`."""

    sets: tuple[str, ...] = tuple(PUBLISHED_POSTERIORS)
    colonies: int = 14
    cells: int = 45_000
    by: tuple[str, ...] = tuple(STATISTICS)
    more: tuple[str, ...] = ()


FULL = Study()
QUICK = Study(FULL.sets[:1], 4, 5000, tuple(STATISTICS)[:1], ("--simulations", "256", "--first", "256"))


def truth_of(name: str) -> dict[str, float]:
    """The published posterior means of a set."""
    return dict(zip(PARAMETERS.names, PUBLISHED_POSTERIORS[name].mean, strict=True))


def colony_of(study: Study, name: str, member: int) -> OfflatticeColony:
    """One of a set's colonies, whole."""
    seed = 1000 * (1 + list(PUBLISHED_POSTERIORS).index(name)) + member
    colony = grow(truth_of(name), cells=study.cells, seed=seed)
    if colony.x.size < study.cells:
        raise InputError(f"{name}, colony {member + 1}: {colony.message}")
    return colony


def photographed(study: Study, name: str, folder: Path, report: Report) -> None:
    """Photographs of a set's colonies, and a manifest."""
    images, rows = folder / "images", []
    images.mkdir(parents=True, exist_ok=True)
    for member in range(study.colonies):
        file = images / f"{name}-{member + 1:02}.tif"
        rows.append({"file": f"images/{file.name}", "replicate": member + 1, "hours": HOURS, "um_per_pixel": PIXEL})
        if file.is_file():
            continue
        report.stage(f"{name}: colony {member + 1} of {study.colonies} is photographed")
        pixels = micrograph(colony_of(study, name, member), photograph_stream(study.cells, member, 0))
        write_micrograph(file, pixels, PIXEL)
    write_table(folder / "manifest.csv", rows)


def mask_of(colony: OfflatticeColony) -> np.ndarray:
    """What is photographed, with a margin."""
    mask = BinnedOutlines.of(colony).mask(round(SHOWN * colony.x.size))
    inside = tuple(slice(np.flatnonzero(one)[0], np.flatnonzero(one)[-1] + 1) for one in (mask.any(1), mask.any(0)))
    return np.pad(mask[inside], MARGIN)


def micrograph(colony: OfflatticeColony, rng: np.random.Generator) -> np.ndarray:
    """The photograph of a colony's first cells."""
    mask = mask_of(colony)
    layers = np.minimum(1.0 + ndimage.distance_transform_edt(mask) / LAYER, MOST_LAYERS)
    return photograph(mask.astype(float), np.where(mask, layers, 0.0), PIXEL, rng, OPTICS)


def true_statistics(study: Study, name: str, member: int) -> dict[str, float]:
    """What `measure` finds on the mask itself."""
    return statistics_of(mask_of(colony_of(study, name, member)), PIXEL, NAMES)


def recovered(folder: Path, name: str, by: str) -> list[Record]:
    """A row for each parameter of one posterior."""
    posterior, rows = Posterior.load(folder / "posterior.npz"), []
    values, ends = posterior.flat, posterior.interval(0.9)
    for k, (parameter, true) in enumerate(truth_of(name).items()):
        low, high = ends[k].tolist()
        mean, sd = float(posterior.mean[k]), float(posterior.sd[k])
        below = float((values[:, k] < true).mean())  # an emulator's draws have no weights
        rows.append(
            {
                **{"by": by, "set": name, "parameter": parameter, "true": true, "mean": mean, "sd": sd},
                **{"5 %": low, "95 %": high, "inside": "yes" if low <= true <= high else "no"},
                **{"rank": below, "pull": (mean - true) / sd, "settled": "yes" if posterior.settled else "no"},
            }
        )
    return rows


def outlines(study: Study, name: str, measured: Path) -> list[Record]:
    """A row for each statistic: photographs beside masks, their difference in standard deviations of colonies."""
    table = read_measurements(measured / TABLE)
    photographs = [measured_in_um(row, measured, NAMES) for row in table]
    true = [true_statistics(study, name, int(row["replicate"]) - 1) for row in table]
    rows: list[Record] = []
    for statistic in NAMES:
        of_photographs, of_masks = (np.array([one[statistic] for one in each]) for each in (photographs, true))
        scatter = float(of_masks.std(ddof=1))
        difference = of_photographs - of_masks
        rows.append(
            {
                **{"set": name, "statistic": statistic, "photographs": float(of_photographs.mean())},
                **{"masks": float(of_masks.mean()), "sd of colonies": scatter},
                **{"bias, sd": float(difference.mean()) / scatter, "scatter, sd": float(difference.std()) / scatter},
            }
        )
    return rows


def _run(arguments: list[str], folder: Path, fine: tuple[int, ...]) -> None:
    if (folder / MANIFEST).is_file():
        return
    code = cli.run([*arguments, "--out", str(folder)])
    if code not in fine:
        raise InputError(f"yeastfit {arguments[0]} for {folder} ended with exit code {code}")


def recover(report: Report, work: Path, study: Study) -> None:
    """Make what is missing, and report on all."""
    rows, seen = [], []
    for name in study.sets:
        photographed(study, name, work / name, report)
        measured = work / f"{name}-measured"
        report.stage(f"{name}: measured")
        _run(["measure", str(work / name)], measured, (0,))
        seen += outlines(study, name, measured)
        for by in study.by:
            report.stage(f"{name}: posterior by {by}")
            folder = work / f"{name}-{by.replace(' ', '-')}"
            asked = ["--model", "offlattice", "--cells", str(study.cells), "--statistics", ",".join(STATISTICS[by])]
            _run(["infer", str(measured), *asked, *study.more, "--resume"], folder, (0, 1))
            rows += recovered(folder, name, by)
    for by in study.by:
        of = [row for row in rows if row["by"] == by]
        inside = sum(row["inside"] == "yes" for row in of)
        target = LEAST if study is FULL and STATISTICS[by] == COMPARABLE else None
        report.add(f"{by}: true values in 90 % intervals", inside, "", target, note=f"of {len(of)}")
        report.add(f"{by}: rms pull", np.sqrt(np.mean([row["pull"] ** 2 for row in of])), "", note="1 if sd are right")
        unsettled = sorted({row["set"] for row in of if row["settled"] == "no"})
        report.add(f"{by}: posteriors not settled", len(unsettled), "", note=", ".join(unsettled))
    report.table("true and found", rows)
    report.table("means over colonies: outlines of photographs, and the masks that were photographed", seen)
    if report.docs is not None:
        report.docs.mkdir(parents=True, exist_ok=True)
        (report.docs / "recovery-offlattice.md").write_text("\n\n".join([report.head(__doc__), *report.sections()]))


def main(arguments: list[str] | None = None) -> None:
    """Run the command: parse the options of this benchmark, then those of every benchmark."""
    parser = argparse.ArgumentParser(add_help=False, allow_abbrev=False)
    parser.add_argument("--work", type=Path, default=Path("out/recovery-offlattice"))
    own, others = parser.parse_known_args(arguments)

    def run(report: Report, quick: bool) -> None:
        recover(report, own.work / ("quick" if quick else "full"), QUICK if quick else FULL)

    command("recovery_offlattice", run, others)


if __name__ == "__main__":
    main()
