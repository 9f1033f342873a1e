"""Does the comparison of models tell which one made a set of colonies?

Ten sets of 14 colonies are made by either model, each at parameters drawn from that model's prior, measured on masks
with the pixels of photographs, and compared by four statistics without a unit. Colonies of the algebraic model grow for
21.7 hours and cover 3000 to 45 000 µm². Every set of the off-lattice model is drawn at the mean area of one of the
other ten, so that size does not tell. Of each set both models' posteriors are sampled, its colonies are left out in
four groups and predicted by the others, and the densities are compared as `yeastfit compare` does
(`yeastfit.ModelComparison`). The model with the larger density is the verdict; it is sure where the difference is
beyond chance. A model that makes no colonies like the set's has no posterior, and the other one is the verdict, surely.

The algebraic model's first 1024 simulations are the same for all sets. Posteriors are allowed one further round of 128,
those of the off-lattice model two of 512, and need not settle.

Target: 20 of 20 sets are told right.

    python -m benchmarks.comparison [--quick] [--json FILE] [--docs DIR] [--work DIR]

Simulations and verdicts are kept in the folder given by --work, out/comparison by default; an interrupted run goes on
there. --quick: two sets by either model, four younger colonies each, tiny networks, no target.
"""

import argparse
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property, partial
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
from jaxtyping import Float

from benchmarks.lines import append_line, read_lines
from benchmarks.report import Report, code, command
from yeastfit.errors import InputError
from yeastfit.inference.colony_simulator import ColonySimulator
from yeastfit.inference.comparison.cross_validation import cross_validate
from yeastfit.inference.comparison.left_out import LeftOut
from yeastfit.inference.comparison.models import ModelComparison
from yeastfit.inference.imaging import Imaging
from yeastfit.inference.models.algebraic import Algebraic
from yeastfit.inference.models.algebraic_settings import PHOTOGRAPHED
from yeastfit.inference.models.forward_model import ForwardModel
from yeastfit.inference.models.offlattice import Offlattice
from yeastfit.inference.neural_likelihood.network import TrainingSettings
from yeastfit.inference.neural_likelihood.sequential import SequentialEmulator
from yeastfit.inference.posterior.problem import Problem
from yeastfit.inference.resolution import Resolution
from yeastfit.inference.samplers import sample
from yeastfit.inference.simulator import Simulator, labels_of, seed_of
from yeastfit.inference.store.simulations import Simulations
from yeastfit.inference.targets import Targets
from yeastfit.measure.statistics.registry import STATISTICS
from yeastfit.model.parameters import Scales
from yeastfit.offlattice.masks.ellipse_mask import Ellipses
from yeastfit.offlattice.simulator import OfflatticeSimulator
from yeastfit.progress import silent
from yeastfit.seeds import Stream, stream_of

COMPARED = ("filament_area_index", "filament_radius_index", "compactness", "angular_index")
MEASURED = (*COMPARED, "area", "max_radius")
EXTENT = 25.0  # L0, beyond which hardly a colony reaches
AREAS = (3000.0, 45_000.0)  # µm²: from a hundred cells of the off-lattice model on, within EXTENT
AREA_OF_CELL, ROOM = 30.6, 1.3  # µm² that a cell covers in Li et al.'s colonies; so many times as many grow as cover it
SEED = 2026
Row = dict[str, Any]


@dataclass(frozen=True)
class Study:
    """How many sets there are, of what colonies, and how posteriors are sampled.

    Attributes:
        sets: Made by each model.
        colonies: Of a set.
        time: For which colonies of the algebraic model grow, in 1/μ*.
        groups: In which colonies are left out.
        samplers: By model.
        work: Where simulations are kept.
    """

    NAMES: ClassVar = ("algebraic", "offlattice")
    sets: int
    colonies: int
    time: float
    groups: int
    samplers: Mapping[str, SequentialEmulator]
    work: Path

    @cached_property
    def hours(self) -> float:
        """At which colonies are measured."""
        return float(Scales().hours(self.time))

    def algebraic(self, statistics: tuple[str, ...]) -> ColonySimulator:
        """Colonies of the algebraic model in one dish, whatever set they are compared with."""
        imaging = Imaging(EXTENT, "mask", PHOTOGRAPHED / Scales().length, 0.0)
        seen = Targets.from_means({name: np.ones(1) for name in statistics}, (self.time,), imaging=imaging)
        return ColonySimulator.of(seen, Algebraic.free, resolution=Resolution(dt=0.025, spacing=0.4))

    def offlattice(self, area: float) -> OfflatticeSimulator:
        """Colonies of the off-lattice model at an area in µm²."""
        draw = partial(Ellipses.of, pixel_size=PHOTOGRAPHED)
        return OfflatticeSimulator.of(MEASURED, cells=cells_for(area), area=area / PHOTOGRAPHED**2, draw=draw)

    def made(self, by: str, number: int) -> Float[np.ndarray, "colony statistic"]:
        """A set of `MEASURED`, in µm; the first draw from the prior whose colonies have the wanted area."""
        rng = np.random.default_rng(stream_of(SEED, Stream.TRUTH, self.NAMES.index(by), number))
        model: ForwardModel = Algebraic()
        simulator: Simulator = self.algebraic(MEASURED)
        unit = np.array([Scales().length ** STATISTICS[name].unit_power for name in MEASURED])
        least, most = AREAS
        if by == "offlattice":
            model, simulator = Offlattice(), self.offlattice(mean_area(self.made("algebraic", number)))
            unit, least, most = np.ones(len(MEASURED)), 0.0, np.inf
        prior = model.prior(simulator.parameters)
        while True:
            values = np.repeat(prior.sample(1, rng), self.colonies, axis=0)
            rows = unit * simulator(values, rng.integers(2**32, size=self.colonies, dtype=np.uint64))
            if np.isfinite(rows).all() and least <= mean_area(rows) <= most:
                return rows

    def verdict(self, by: str, number: int) -> Row:
        """What the comparison says of a set."""
        rows, found = self.made(by, number), dict[str, LeftOut]()
        about: Row = {"made by": by, "set": number, "mean area, µm²": mean_area(rows)}
        for name in self.NAMES:
            try:
                found[name] = self._left_out(name, rows)
            except InputError as error:
                about["note"] = f"{name}: {error}"
        if len(found) < 2:
            name = next(iter(found), "neither")
            return about | {"verdict": name, "sure": "yes", "right": "yes" if name == by else "no"}
        best, other = ModelComparison.of(found).runs
        return {
            **about,
            "verdict": best.name,
            "sure": "yes" if other.told_apart else "no",
            "right": "yes" if best.name == by else "no",
            "log density": best.left_out.total,
            "ahead by": other.behind,
            "error": other.error,
        }

    def _left_out(self, name: str, rows: Float[np.ndarray, "colony statistic"]) -> LeftOut:
        """Colonies left out under one model, by the steps of `yeastfit infer --leave-out`."""
        table = [self._row(number, row) for number, row in enumerate(rows, 1)]
        small = Offlattice(cells=cells_for(mean_area(rows)), masks="ellipses")
        model: ForwardModel = small if name == "offlattice" else Algebraic()
        seen = model.seen(table, self.work, None, COMPARED)
        simulator: Simulator = self.algebraic(COMPARED)
        if name == "offlattice":
            simulator = seen.model.simulator(seen.targets, model.free, {})
        prior, limits = model.prior(simulator.parameters), seen.model.limits(seen.targets)
        problem = Problem.of(simulator, prior, seen.targets, limits=limits)
        store, settings = Simulations(simulator.parameters.names, labels_of(simulator)), self.samplers[name]
        if name == "algebraic":
            store.append(*self._first(simulator, problem))
        posterior = sample(problem, settings, store, SEED, silent)
        values, _, statistics = store.all()
        assert seen.targets.curves is not None
        colonies = seen.targets.curves[:, seen.targets.measured]
        how: dict[str, Any] = {"groups": self.groups, "labels": seen.targets.points, "settings": settings}
        return cross_validate(posterior, problem, colonies, (values, statistics), seed=SEED, **how)

    def _row(self, number: int, values: Float[np.ndarray, " statistic"]) -> Row:
        """Of a table of measurements."""
        found = dict(zip(MEASURED, values.tolist(), strict=True))
        where = {"file": f"colony {number}", "condition": "", "replicate": str(number), "mask": ""}
        return {**where, "hours": self.hours, "um_per_pixel": PHOTOGRAPHED, **found}

    def _first(self, simulator: Simulator, problem: Problem) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """The algebraic model's first round, which is kept."""
        first = self.samplers["algebraic"].first
        assert first is not None
        values, seeds, file = problem.prior_values(first, SEED), seed_of(SEED, range(first)), self.work / "first.npz"
        if not file.is_file():
            self.work.mkdir(parents=True, exist_ok=True)
            batches = np.split(np.arange(first), max(1, first // 32))
            np.savez(file, rows=np.concatenate([simulator(values[one], seeds[one]) for one in batches]))
        return values, seeds, np.load(file)["rows"]


def mean_area(rows: Float[np.ndarray, "colony statistic"]) -> float:
    """Of a set of `MEASURED`, in µm²."""
    return float(rows[:, MEASURED.index("area")].mean())


def cells_for(area: float) -> int:
    """How many cells of the off-lattice model grow for colonies of an area in µm²."""
    return round(ROOM * area / AREA_OF_CELL)


def study_of(work: Path, quick: bool) -> Study:
    """In full, or for a quick look."""
    if not quick:
        samplers = {
            "algebraic": SequentialEmulator(simulations=1152, first=1024, each=128),
            "offlattice": SequentialEmulator(simulations=1536, first=512, each=512),
        }
        return Study(10, 14, 10.0, 4, samplers, work / "full")
    tiny = SequentialEmulator(
        128, first=128, most_steps=500, batch=64, training=TrainingSettings(members=2, width=16, steps=100)
    )
    samplers = {"algebraic": tiny, "offlattice": replace(tiny, simulations=512, first=256)}
    return Study(2, 4, 8.0, 2, samplers, work / "quick")


def main(arguments: list[str] | None = None) -> None:
    """Run the command: parse the options of this benchmark, then those of every benchmark."""
    parser = argparse.ArgumentParser(add_help=False, allow_abbrev=False)
    parser.add_argument("--work", type=Path, default=Path("out/comparison"))
    own, others = parser.parse_known_args(arguments)

    def run(report: Report, quick: bool) -> None:
        study = study_of(own.work, quick)
        kept = study.work / f"verdicts-{code()}.jsonl"
        records = read_lines(kept)
        done = {(one["made by"], one["set"]) for one in records}
        for number in range(1, study.sets + 1):
            for by in study.NAMES:
                if (by, number) not in done:
                    report.stage(f"set {number} made by the {by} model")
                    records.append(study.verdict(by, number))
                    append_line(kept, records[-1])
        judge(report, records)
        if report.docs is not None:
            report.docs.mkdir(parents=True, exist_ok=True)
            page = "\n\n".join([report.head(__doc__), *report.sections()])
            (report.docs / "comparison.md").write_text(page, encoding="utf-8")

    command("comparison", run, others)


def judge(report: Report, records: list[Row]) -> None:
    """Figures and the table of all verdicts."""
    right = [one for one in records if one["right"] == "yes"]
    sure = [one for one in records if one["sure"] == "yes"]
    note = f"{sum(one['right'] == 'yes' for one in sure)} of them right"
    report.add("sets told right", len(right), f"of {len(records)}", None if report.quick else float(len(records)))
    report.add("sets told apart beyond chance", len(sure), f"of {len(records)}", note=note)
    columns = list(dict.fromkeys(name for one in records for name in one))
    columns.sort(key="note".__eq__)
    report.table("Verdicts, set by set", [{name: one.get(name) for name in columns} for one in records])


if __name__ == "__main__":
    main()
