"""What `simulate` returns: everything about a run."""

from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from yeastfit.errors import InputError
from yeastfit.measure.statistics.model_as_mask import mask_of
from yeastfit.measure.statistics.registry import STATISTICS, most_telling_first
from yeastfit.model.colony import PROBLEMS, Colony, Problems
from yeastfit.model.model import Model
from yeastfit.model.numerics import Numerics
from yeastfit.model.parameters import Parameters, Scales
from yeastfit.model.relaxation import Relaxation
from yeastfit.panel import Panel
from yeastfit.storage import as_json, from_json, reads_saved, written_whole

_COLONY_ARRAYS = ("positions", "parents", "weights", "lineages", "count", "nutrient", "step")


@dataclass(frozen=True)
class Simulation:
    """Result of `simulate`. Arrays have the keys' batch axis first, if there was one, then the sample times.

    Attributes:
        times: Model time, in 1/μ*.
        statistics: By name, lengths in L0.
        colony: The last state of every member.
        parameters: Values of all parameters of the model.
        relaxation: Smoothing widths.
        numerics: Grid, time step and capacity.
        model: The rules.
        scales: Units of tables.
        seconds: What it took, compiling included.
        until: What ended growth, if it was not a time: names and their values, the first that is reached.
        reached: Then the model time at which each member came so far; nan where it had not by the last of `times`.
    """

    times: Float[np.ndarray, " sample"]
    statistics: dict[str, np.ndarray]
    colony: Colony
    parameters: Parameters
    relaxation: Relaxation
    numerics: Numerics
    model: Model
    scales: Scales
    seconds: float
    until: dict[str, float] | None = None
    reached: np.ndarray | None = None

    @property
    def problems(self) -> dict[str, int]:
        """How many members ran into each of `Problems`; empty when all went well."""
        counts = {name: int(np.asarray(getattr(self.colony.problems, name)).sum()) for name in PROBLEMS}
        return {name: count for name, count in counts.items() if count}

    @property
    def capacity_reached(self) -> np.ndarray:
        """Whether births were cut because every node slot was taken, per member."""
        return np.asarray(self.colony.problems.capacity_reached)

    @property
    def clock(self) -> Float[np.ndarray, " sample"]:
        """Times for plots, in hours; of colonies that ended at a size, the mean of their ends."""
        return self.scales.hours(self.times if self.until is None else self.ends.mean(keepdims=True))

    @property
    def clock_label(self) -> str:
        """What `clock` counts."""
        return "hours"

    @property
    def length_unit(self) -> str:
        """Of the statistics."""
        return "L0"

    def sentence(self) -> str:
        """What has been grown, in words."""
        count = np.atleast_1d(np.asarray(self.colony.count)) - 1
        if "cell_count" in self.statistics:
            count = np.atleast_2d(self.statistics["cell_count"])[:, -1]  # newborn cells count in part
        grown = "1 colony" if len(count) == 1 else f"{len(count)} colonies"
        ends = self.ends
        at = f"{ends.min():g}" if np.ptp(ends) == 0 else f"{ends.min():g} to {ends.max():g}"
        hours = self.scales.hours(float(ends.mean()))
        return f"{grown} to t = {at} ({hours:.1f} h): {count.mean():.1f} cells on average, in {self.seconds:.1f} s"

    @property
    def ends(self) -> Float[np.ndarray, " member"]:
        """Model time of each member's last state, earlier than the last of `times` where growth ended before."""
        return np.atleast_1d(np.asarray(self.colony.step)) * self.numerics.dt

    def panels(self, member: int = 0, width: float | None = None) -> list[Panel]:
        """Cells and nutrient of one colony at its end.

        Arguments:
            member: Which colony of the ensemble.
            width: Of the part shown, in L0; by default twice the colony's reach.

        Returns:
            Two panels.
        """
        state, parameters = self.colony, self.parameters
        if state.count.ndim:
            state = jax.tree.map(lambda leaf: np.asarray(leaf)[member], state)  # JAX would compile it
        parameters = jax.tree.map(lambda leaf: leaf if leaf.ndim == 0 else np.asarray(leaf)[member], parameters)
        reach = float(np.abs(np.asarray(state.positions)[: int(state.count)]).max(initial=0.0)) + 2.0
        width = min(self.numerics.domain, width or 2 * reach)
        mask = mask_of(state, parameters, self.relaxation, width, 801, self.model)
        time = float(state.step) * self.numerics.dt
        cells = max(int(state.count) - 1, 0)
        title = f"{cells} cell{'s' * (cells != 1)} at {self.scales.hours(time):.1f} h (t = {time:.4g})"
        half, edge = (0.5 * one * self.scales.length for one in (width, self.numerics.domain))
        return [
            Panel(title, mask, half, kinds=("nothing", "cells")),
            Panel("nutrient", np.asarray(state.nutrient), edge, "nutrient c / c0"),
        ]

    def masks(self) -> None:
        """None: `yeastfit synthesize` photographs colonies of this model."""

    def warnings(self) -> list[str]:
        """The problems in words."""
        members = int(np.size(self.capacity_reached))
        met = [f"{count} of {members} colonies: {PROBLEMS[name]}" for name, count in self.problems.items()]
        if self.until is not None and self.reached is not None and (short := int(np.isnan(self.reached).sum())):
            below = " and ".join(f"{name} was below {value:g}" for name, value in self.until.items())
            met.append(f"{short} of {members} colonies: {below} at t = {self.times[-1]:g}: end later")
        return met

    def rows(self) -> list[dict[str, Any]]:
        """Tidy table: one row per member and sample time, lengths in L0 and in µm."""
        powers = {name: STATISTICS[name].unit_power for name in most_telling_first(self.statistics)}
        in_um = sorted((name for name, power in powers.items() if power), key=powers.__getitem__)
        columns = {name: f"{name}_um{'2' * (powers[name] == 2)}" for name in in_um}
        curves = {name: np.atleast_2d(values) for name, values in self.statistics.items()}
        table = []
        for member in range(next(iter(curves.values())).shape[0]):
            for k, time in enumerate(self.times if self.until is None else self.ends[[member]]):
                row: dict[str, Any] = {"member": member, "time": float(time), "hours": self.scales.hours(float(time))}
                row |= {name: float(values[member, k]) for name, values in curves.items()}
                row |= {column: row[name] * self.scales.length ** powers[name] for name, column in columns.items()}
                table.append(row)
        return table

    def save(self, path: str | Path) -> None:
        """Save as a NumPy archive: curves, last states, parameters and configuration, with the names of the rules."""
        arrays: dict[str, Any] = {f"statistics/{name}": values for name, values in self.statistics.items()}
        arrays |= {f"colony/{name}": getattr(self.colony, name) for name in _COLONY_ARRAYS}
        arrays |= {f"problems/{name}": getattr(self.colony.problems, name) for name in PROBLEMS}
        arrays |= {f"node_state/{name}": values for name, values in self.colony.node_state.items()}
        arrays |= {f"medium/{name}": values for name, values in self.colony.medium.items()}
        arrays |= {f"parameters/{name}": value for name, value in self.parameters.values.items()}
        names = ("union", "contact", "boundary", "turning", "overhang")
        widths = {name: _number(getattr(self.relaxation, name)) for name in names}
        configuration = {
            "model": self.model.asdict(),
            "numerics": asdict(self.numerics),
            "scales": asdict(self.scales),
            "relaxation": {**widths, "births": self.relaxation.births},
            "seconds": self.seconds,
            "until": self.until,
        }
        if self.reached is not None:
            arrays["reached"] = self.reached
        with written_whole(path) as temporary, temporary.open("wb") as file:  # a file keeps its name as given
            np.savez_compressed(file, times=self.times, configuration=as_json(configuration), **arrays)

    @staticmethod
    @reads_saved("simulation")
    def load(path: str | Path, model: Model | None = None) -> "Simulation":
        """What `save` wrote.

        Arguments:
            path: The file.
            model: The model itself where it holds rules that are not registered (`yeastfit.RULES`).

        Raises:
            InputError: The file is something else, or damaged; it names a rule that is unknown, or `model` has other
                rules than the file names.
        """
        with Path(path).open("rb") as opened, np.load(opened) as archive:
            groups: dict[str, dict[str, np.ndarray]] = {}
            for key in archive.files:
                group, _, name = key.partition("/")
                groups.setdefault(group, {})[name] = archive[key]
        if "about" in groups:
            raise InputError(
                "holds colonies of the off-lattice model, which yeastfit.offlattice.OfflatticeSimulation.load reads"
            )
        configuration = from_json(str(groups["configuration"][""]))
        if model is None:
            model = Model.of(configuration["model"])
        elif from_json(as_json(model.asdict())) != configuration["model"]:
            raise InputError(f"{path}: model has the rules {model.asdict()}, the file's are {configuration['model']}")
        nothing = np.zeros_like(groups["problems"]["not_finite"])  # of what older files do not know
        problems = Problems(**{name: jnp.asarray(groups["problems"].get(name, nothing)) for name in PROBLEMS})
        states = {name: jnp.asarray(values) for name, values in groups["colony"].items()}
        medium = {name: jnp.asarray(values) for name, values in groups.get("medium", {}).items()}
        node_state = {name: jnp.asarray(values) for name, values in groups.get("node_state", {}).items()}
        return Simulation(
            times=groups["times"][""],
            statistics=groups["statistics"],
            colony=Colony(**states, problems=problems, node_state=node_state, medium=medium),
            parameters=model.complete(Parameters(**groups["parameters"])),
            relaxation=Relaxation(**configuration["relaxation"]),
            numerics=Numerics(**configuration["numerics"]),
            model=model,
            scales=Scales(**configuration["scales"]),
            seconds=configuration["seconds"],
            until=configuration.get("until"),
            reached=groups["reached"][""] if "reached" in groups else None,
        )


def _number(width: Array | None) -> float | None:
    return None if width is None else float(width)
