"""Masks of real colonies beside those of colonies simulated from a posterior: a picture of both, and their cores.

The core of a colony is what a disc of radius 60 µm, wider than any hair, reaches inside of it (an opening). How far its
edge is off a circle is the standard deviation of its distance from the core's centre over the mean. Circles around the
centre of the largest circle inside, 5 to 30 % wider than that, tell where hairs begin and end: how much of them lies
inside the colony, in how many pieces. How hairs taper tells their width at three distances beyond the core: twice the
distance of their skeletons from the outline.
"""

from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Bool, Float
from matplotlib.figure import Figure
from scipy.ndimage import distance_transform_edt
from skimage.morphology import skeletonize

from benchmarks.real_answers import CALLED
from benchmarks.real_colonies import DATA
from benchmarks.real_run import CELLS, RealRun
from yeastfit import measure_file
from yeastfit.inference.models.offlattice import Offlattice
from yeastfit.inference.prior.variation import Varied
from yeastfit.inference.simulator import member_seeds
from yeastfit.measure.measurements_table import TABLE, read_measurements
from yeastfit.offlattice.masks.ellipse_mask import PIXEL
from yeastfit.offlattice.parameters import GROWING, MARGIN

Mask = Bool[np.ndarray, "row column"]

FREE = (*GROWING, MARGIN.name)
DISC = 60.0  # µm, its radius
WIDER = (1.05, 1.1, 1.2, 1.3)
BEYOND = ((5.0, 20.0), (60.0, 90.0), (130.0, 180.0))  # µm
EACH = 3  # real colonies of a set, and simulated ones, in the picture


def drawn(run: RealRun, names: tuple[str, ...], colonies: int) -> tuple[Varied, Any, Float[np.ndarray, "colony free"]]:
    """The simulator of colonies that differ, the data that it is made for, and draws of a posterior."""
    model = Offlattice(cells=CELLS[run.name], match="each", masks="ellipses")
    table = DATA / run.name / TABLE
    seen = model.seen(read_measurements(table), table.parent, None, names)
    inside = seen.model.simulator(seen.targets, FREE, {})
    draws = run.posterior.flat
    values = draws[np.random.default_rng(0).integers(len(draws), size=colonies)]
    return Varied(inside, run.posterior.varying), seen, values


def real_masks(run: RealRun, images: Path) -> list[Mask]:
    """Of the set's colonies, in the table's order."""
    rows = read_measurements(DATA / run.name / TABLE)
    return [measure_file(images / str(row["file"]), float(row["um_per_pixel"])).segmentation.mask for row in rows]


def simulated_masks(run: RealRun, colonies: int, transition: float | None = None) -> list[Mask]:
    """Of colonies of the posterior, as far as they could be drawn; of another n* where one is given."""
    simulator, seen, values = drawn(run, ("solidity",), colonies)  # any statistic of masks: colonies are the same
    scattered = simulator.scattered(values, member_seeds(0, colonies))
    if transition is not None:
        scattered[:, FREE.index("transition")] = transition
    masks: list[Mask] = seen.model.outlines(simulator.simulator, scattered, seen.targets, 0)[0]
    return masks


def cores(runs: list[RealRun], real: list[list[Mask]]) -> list[dict[str, Any]]:
    """How round cores are and where hairs are, medians of real colonies, simulated ones, and sated cells alone.

    real: The masks of each run's set.
    """
    rows: list[dict[str, Any]] = []
    for run, own in zip(runs, real, strict=True):
        kinds = {
            "real": own,
            "simulated": simulated_masks(run, len(own)),
            "of sated cells alone": simulated_masks(run, len(own), transition=1.0),
        }
        for kind, masks in kinds.items():
            found = [core(mask) for mask in masks]
            medians = {name: median([one[name] for one in found]) for name in found[0]}
            rows.append({"set": CALLED[run.name], "colonies": kind, **medians})
    return rows


def median(values: list[float]) -> float:
    """Of those that are there; nan where none is."""
    known = [one for one in values if np.isfinite(one)]
    return float(np.median(known)) if known else np.nan


def core(mask: Mask) -> dict[str, float]:
    """Of one colony: its core, circles around it, and how wide hairs are, nan where there are none."""
    mask = np.pad(mask, 1)
    depth = distance_transform_edt(mask)
    kept = distance_transform_edt(depth <= DISC / PIXEL) <= DISC / PIXEL
    y, x = np.nonzero(kept & (distance_transform_edt(kept) <= 1))
    from_middle = np.hypot(x - x.mean(), y - y.mean())
    found = {"core off a circle, %": float(100 * from_middle.std() / from_middle.mean())}
    middle, inside = np.unravel_index(depth.argmax(), depth.shape), depth.max()
    for wider in WIDER:
        angle = np.linspace(0, 2 * np.pi, round(2 * np.pi * wider * inside), endpoint=False)
        at = np.rint(np.array(middle)[:, None] + wider * inside * np.array([np.sin(angle), np.cos(angle)])).astype(int)
        within = ((at >= 0) & (at < np.array(mask.shape)[:, None])).all(axis=0)
        reached = within & mask[tuple(np.where(within, at, 0))]
        found[f"inside at {100 * wider - 100:.0f} %, %"] = 100 * float(reached.mean())
        found[f"pieces at {100 * wider - 100:.0f} %"] = float(np.sum(reached & ~np.roll(reached, 1)))
    beyond, hairs = PIXEL * distance_transform_edt(~kept), skeletonize(mask) & ~kept
    for near, far in BEYOND:
        widths = 2 * PIXEL * depth[hairs & (beyond >= near) & (beyond < far)]
        found[f"µm wide {near:.0f} to {far:.0f} µm out"] = float(widths.mean()) if widths.size else np.nan
    return found


def grid(runs: list[RealRun], real: list[list[Mask]]) -> tuple[Figure, str]:
    """Real and simulated colonies of each set, and which are real.

    real: The masks of each run's set.
    """
    rng, said = np.random.default_rng(0), list[str]()
    masks = dict[tuple[int, int], Mask]()
    for line, (run, own) in enumerate(zip(runs, real, strict=True)):
        both = [*own[:EACH], *simulated_masks(run, EACH)]
        order = rng.permutation(len(both)).tolist()
        masks |= {(line, place): both[which] for place, which in enumerate(order)}
        said.append(f"{CALLED[run.name]}: {', '.join(str(k + 1) for k, which in enumerate(order) if which < EACH)}")
    reach = 0.52 * max(max(np.ptp(one) for one in np.nonzero(mask)) for mask in masks.values())
    figure = Figure(figsize=(18, 3.1 * len(runs)), layout="constrained")
    panels = figure.subplots(len(runs), 2 * EACH, squeeze=False)
    for panel in panels.flat:
        panel.set_axis_off()
    for place, mask in masks.items():
        row, column = (0.5 * (one.min() + one.max()) for one in np.nonzero(mask))
        panels[place].imshow(mask, cmap="Greys", interpolation="antialiased")
        panels[place].set(xlim=(column - reach, column + reach), ylim=(row + reach, row - reach))
    return figure, "; ".join(said)
