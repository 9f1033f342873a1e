"""Tables of real colonies: what `measure` and Li et al.'s own statistics find on the masks of Li et al. 2024.

One table for each strain and medium, in the form of `yeastfit measure`, with the statistics of Li et al. in columns
that begin with li2024_, and those of smoothed outlines in columns that begin with smoothed_. Masks are read as they
are: black is colony.

    python -m benchmarks.real_tables MASKS DATA
"""

import re
import sys
from pathlib import Path
from typing import Any

from yeastfit.measure.reading.images import read_image
from yeastfit.measure.statistics.measure_mask import measure_mask
from yeastfit.measure.statistics.registry import names_with
from yeastfit.offlattice.simulator import OF_BINS, statistics_of
from yeastfit.offlattice.statistics.li2024_statistics import PUBLISHED
from yeastfit.offlattice.statistics.smoothed_outline import TEXTURE
from yeastfit.storage import write_table

PIXEL_SIZE = 1.55008  # µm, of the photographs
SETS = {  # folder: what files are called, condition, hours
    "awri796-50um": ("awri796_50um", "AWRI 796, 50 µM", 233),
    "awri796-500um": ("awri796_500um", "AWRI 796, 500 µM", 233),
    "simi-white-50um": ("simiwhite_50um", "Simi White, 50 µM", 237),
}


def row(path: Path, condition: str, hours: float) -> dict[str, Any]:
    """The row of one mask."""
    colony = read_image(path) < 128
    shape = measure_mask(colony, PIXEL_SIZE)
    further = [one.name for one in (*OF_BINS, *TEXTURE) if one.name not in PUBLISHED]
    theirs = statistics_of(colony, PIXEL_SIZE, (*PUBLISHED, *further))
    found = re.search(r"_s(\d+)$", path.stem)
    return {
        "file": path.name,
        "condition": condition,
        "replicate": int(found[1]) if found else path.stem,
        "hours": hours,
        "um_per_pixel": PIXEL_SIZE,
        "mask": "",
        **{name: float(f"{shape[name]:.9g}") for name in names_with("mask") if name in shape},
        **{name: float(f"{value:.9g}") for name, value in theirs.items()},
    }


def main(masks: Path, data: Path) -> None:
    """Write the table of every set."""
    for folder, (stem, condition, hours) in SETS.items():
        paths = sorted(masks.glob(f"{stem}_s*.tif"))
        if not paths:
            raise SystemExit(f"{masks}: no masks called {stem}_s*.tif")
        (data / folder).mkdir(parents=True, exist_ok=True)
        write_table(data / folder / "measurements.csv", [row(path, condition, hours) for path in paths])


if __name__ == "__main__":
    main(Path(sys.argv[1]), Path(sys.argv[2]))
