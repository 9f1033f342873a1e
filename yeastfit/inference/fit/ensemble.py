"""What simulations of all conditions say about a point θ: means, derivatives, and the covariance of the comparison.

For each condition an ensemble is simulated in pairs around the point (`paired_regression`), with the same seeds
wherever it is, so that two points are compared by the same chance. One simulation has the covariance S. The data, means
over R replicates, scatter with S too, scaled statistic by statistic to the measured scatter where that is known. So

    Σ = h (S_scaled / R + cov m) + measurement error,

h for S being an estimate (`curve_covariance.mean_covariance`), cov m the Monte-Carlo error of the ensemble's mean.
Where the ensemble is too small to tell correlations, and to begin with, `screening_covariance` stands for Σ: variances
only, with a tolerance proportional to the mean, under which the problem is less curved.

**Refinement.** Ensembles are of a coarse simulator, and around θ, not at it. Simulations of the fine one at θ, each
with the seed of a pair, tell what both change: d = mean of (fine − the pair's mean) is a second level of the ensemble's
mean (multilevel Monte Carlo: Giles 2008, doi:10.1287/opre.1070.0496), which takes out the shift of ½ s² tr H, too. Its
covariance joins Σ.
"""

import zlib
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from jaxtyping import Float, Shaped
from scipy.linalg import block_diag

from yeastfit.errors import InputError, SimulationError
from yeastfit.inference.curve_covariance import Square, mean_covariance, measurement_covariance
from yeastfit.inference.fit.settings import FitSettings
from yeastfit.inference.paired_regression import (
    LocalModel,
    Reach,
    Units,
    beyond_range,
    hadamard_design,
    hadamard_order,
    paired_points,
    reaches,
    regress_averaged,
    sample_scatter,
)
from yeastfit.inference.parameter_space import ParameterSpace, Points, Vector
from yeastfit.inference.simulator import (
    Counted,
    Rows,
    Simulator,
    Tally,
    labels_of,
    member_seeds,
    problems_of,
    same_observables,
    stream_seeds,
)
from yeastfit.inference.targets import Targets
from yeastfit.seeds import Stream, stream_of

SCATTER = 0.2  # of the mean: scatter of one replicate where nobody knows it, at screening only
TOLERANCE = 0.05  # of the mean, at screening: the error of a mean of 16 with that scatter, those of the first stage
FEWEST_FINE = 4  # fine simulations that tell a covariance at all


@dataclass(frozen=True)
class EnsembleRows:
    """Rows of one ensemble's simulations, the rows of the design that its pairs were simulated at, and how far out."""

    rows: Rows
    units: Units
    reach: Reach


@dataclass(frozen=True)
class JointModel:
    """Means of all conditions around a point, one condition after the other.

    Attributes:
        theta: The point.
        mean: The means.
        jacobian: Their derivatives.
        error: Standard errors of these.
        correlation: Of these errors, over the means.
        conditions: By condition.
        ensembles: That it was made from, by condition.
    """

    theta: Vector
    mean: Float[np.ndarray, " observable"]
    jacobian: Float[np.ndarray, "observable entry"]
    error: Float[np.ndarray, "observable entry"]
    correlation: Square
    conditions: dict[str, LocalModel]
    ensembles: dict[str, EnsembleRows]


@dataclass(frozen=True)
class Correction:
    """What the fine simulators change in the means, and the covariance of that."""

    mean: Float[np.ndarray, " observable"]
    covariance: Square


@dataclass(frozen=True)
class Ensembles:
    """The conditions of a fit: targets and simulators.

    Attributes:
        targets: By condition.
        simulators: Those that ensembles are made of.
        space: Of the free parameters.
        seed: Of all ensembles.
        settings: Of the fit.
        fine: Simulators of the model that is meant, where there are others than `simulators`.
        tally: How many simulations were made.
    """

    targets: dict[str, Targets]
    simulators: dict[str, Simulator]
    space: ParameterSpace
    seed: int
    settings: FitSettings
    fine: dict[str, Simulator] = field(default_factory=dict)
    tally: Tally = field(default_factory=Tally)

    def __post_init__(self) -> None:
        for simulators in (self.simulators, self.fine):
            for name, simulator in simulators.items():
                self._check(name, simulator)

    @property
    def values(self) -> Float[np.ndarray, " observable"]:
        """All data."""
        return np.concatenate([each.values for each in self.targets.values()])

    @property
    def problems(self) -> Counter[str]:
        """What simulations ran into so far."""
        different = {id(one): one for one in (*self.simulators.values(), *self.fine.values())}
        return sum((problems_of(one) for one in different.values()), Counter())

    def pairs(self, condition: str, members: int, full: bool) -> int:
        """Pairs of an ensemble: whole Hadamard matrices, and enough to know the covariance of the data in full."""
        rows = hadamard_order(len(self.space.columns(condition)))
        wanted = max(members // 2, 2 * len(self.targets[condition].values) if full else 0)
        return rows * -(-wanted // rows)

    def single_simulations(
        self, points: Points, stream: Stream, *, refined: bool = False
    ) -> Float[np.ndarray, "point observable"]:
        """One simulation of each condition at each point, each with a seed of its own.

        Arguments:
            points: θ.
            stream: What they are for, which the seeds depend on.
            refined: Whether to take the fine simulators where there are some.
        """
        seeds = stream_seeds(self.seed, stream, len(points))
        chosen = self.simulators | (self.fine if refined else {})
        found = [self._simulate(one, self.space.values(name, points), seeds) for name, one in chosen.items()]
        return np.concatenate(found, axis=1)

    def local_models(
        self, places: Sequence[Vector], members: int, spread: float, full: bool = False
    ) -> "list[JointModel | SimulationError]":
        """The means around several places, whose simulations run in one batch a condition.

        Arguments:
            places: θ.
            members: Simulations around each.
            spread: Of log λ.
            full: Whether to take enough for the covariance of all data.

        Returns:
            For each place its model, or an error where simulations failed.
        """
        found: list[dict[str, EnsembleRows]] = [{} for _ in places]
        for condition, simulator in self.simulators.items():
            columns, count = self.space.columns(condition), self.pairs(condition, members, full)
            units = hadamard_design(count, len(columns), np.random.default_rng(self.seed))
            points = np.repeat(np.stack(places), 2 * count, axis=0)
            values = self.space.values(condition, np.stack(places))
            reach = [reaches(simulator.parameters, row, spread) for row in values]
            points[:, columns] = np.concatenate(
                [paired_points(place[columns], units, one) for place, one in zip(places, reach, strict=True)]
            )
            seeds = np.tile(self._seeds(condition, count), 2 * len(places))
            rows = self._simulate(simulator, self.space.values(condition, points), seeds)
            for each, some, one in zip(found, np.split(rows, len(places)), reach, strict=True):
                each[condition] = EnsembleRows(some, units, one)
        models: list[JointModel | SimulationError] = []
        for place, each in zip(places, found, strict=True):
            try:
                models.append(self._joint(place, [each]))
            except SimulationError as error:
                beyond = [
                    beyond_range(one.parameters, self.space.values(name, place[None])[0], spread)
                    for name, one in self.simulators.items()
                ]
                models.append(SimulationError(f"{self.space.described(place)}: {error}{self._why()}{max(beyond)}"))
        return models

    def _seeds(self, condition: str, members: int) -> Shaped[np.ndarray, " member"]:
        """Of the ensemble of one condition: each has a chance of its own, as Σ takes their errors for independent."""
        if len(self.simulators) == 1:
            return member_seeds(self.seed, members)
        own = stream_of(self.seed, Stream.CONDITIONS, zlib.crc32(condition.encode()))
        return member_seeds(int(own.generate_state(1)[0]), members)

    def averaged(self, models: Sequence[JointModel]) -> JointModel:
        """One model of several whose points are close to each other and whose ensembles have the same size."""
        theta = np.mean([model.theta for model in models], axis=0)
        return self._joint(theta, [model.ensembles for model in models])

    def correction(self, model: JointModel) -> Correction:
        """What the fine simulators change at the point of a model; nothing where there are none.

        Raises:
            SimulationError: Fine simulations failed.
        """
        means, covariances = list[np.ndarray](), list[np.ndarray]()
        for condition, ensemble in model.ensembles.items():
            if condition not in self.fine:
                count = ensemble.rows.shape[1]
                means.append(np.zeros(count))
                covariances.append(np.zeros((count, count)))
                continue
            pairs = np.mean(np.split(ensemble.rows, 2), axis=0)[: self.settings.refined]
            values = self.space.values(condition, np.tile(model.theta, (len(pairs), 1)))
            change = self._simulate(self.fine[condition], values, self._seeds(condition, len(pairs))) - pairs
            known = change[np.isfinite(change).all(axis=1)]
            if len(known) < FEWEST_FINE:
                where = self.space.described(model.theta)
                raise SimulationError(f"{where}: fine simulations failed (not finite){self._why()}")
            means.append(known.mean(axis=0))
            covariances.append(sample_scatter(known).covariance / len(known))
        return Correction(np.concatenate(means), block_diag(*covariances))

    def screening_covariance(self, members: int) -> Square:
        """Variances of data and ensemble, as far as the data alone tell them."""
        parts = []
        for targets in self.targets.values():
            mean, scatter = targets.values, targets.scatter[targets.measured]
            variance = np.where(np.isfinite(scatter), scatter, SCATTER * mean) ** 2
            share = 1.0 / targets.replicates[targets.measured] + 2.0 / members
            total = variance * share + (TOLERANCE * mean) ** 2
            parts.append(np.where(total > 0, total, (TOLERANCE * (np.abs(mean).max() or 1.0)) ** 2))
        return np.diag(np.concatenate(parts))

    def screening_costs(
        self, rows: Float[np.ndarray, "row observable"], members: int
    ) -> Float[np.ndarray, "row condition"]:
        """χ² of each condition with the screening covariance."""
        squares = (rows - self.values) ** 2 / np.diag(self.screening_covariance(members))
        ends = np.cumsum([len(targets.values) for targets in self.targets.values()])
        return np.stack([part.sum(axis=1) for part in np.split(squares, ends[:-1], axis=1)], axis=1)

    def covariance(self, model: JointModel) -> Square:
        """Σ."""
        return block_diag(*(self.condition_covariance(name, model.conditions[name]) for name in self.targets))

    def condition_covariance(self, condition: str, local: LocalModel) -> Square:
        """Σ of one condition."""
        targets, settings = self.targets[condition], self.settings
        replicates = targets.replicates[targets.measured].astype(float)
        freedom = local.scatter.freedom
        data = mean_covariance(self.scaled_scatter(condition, local), replicates=replicates, freedom=freedom)
        monte_carlo = mean_covariance(local.mean_covariance, replicates=1.0, freedom=freedom)
        errors = targets.measurement_errors(settings.measurement_error)
        return data + monte_carlo + measurement_covariance(targets.observables, targets.values, errors)

    def scaled_scatter(self, condition: str, local: LocalModel) -> Square:
        """Covariance of one replicate, scaled statistic by statistic to the measured scatter where that is known."""
        targets, chance = self.targets[condition], local.scatter.covariance
        rows = np.argwhere(targets.measured)[:, 0]
        spread = targets.scatter[targets.measured]
        ratio = np.ones(len(rows))
        for row in range(len(targets.names)):
            known = (rows == row) & np.isfinite(spread)
            if not known.any():
                continue
            own = np.diag(chance)[known].mean()
            if not own > 0:
                raise SimulationError(
                    f"simulated colonies do not differ in {targets.names[row]}, so its errors are not known: give "
                    "another statistic, a later time or a smaller time step"
                )
            ratio[rows == row] = np.sqrt((spread[known] ** 2).mean() / own)
        return chance * np.outer(ratio, ratio)

    def _simulate(self, simulator: Simulator, values: np.ndarray, seeds: np.ndarray) -> Rows:
        return Counted(simulator, self.tally)(values, seeds)

    def _joint(self, theta: Vector, ensembles: Sequence[dict[str, EnsembleRows]]) -> JointModel:
        """Of ensembles at one place, or at several close to θ."""
        entries, conditions = len(self.space.entries), dict[str, LocalModel]()
        jacobians, errors = list[np.ndarray](), list[np.ndarray]()
        for condition in self.targets:
            columns, made = self.space.columns(condition), [each[condition] for each in ensembles]
            local = regress_averaged([one.rows for one in made], made[0].units, [one.reach for one in made])
            for part, whole in ((local.jacobian, jacobians), (local.error, errors)):
                wide = np.zeros((len(part), entries))
                wide[:, columns] = part
                whole.append(wide)
            conditions[condition] = local
        return JointModel(
            theta,
            np.concatenate([local.mean for local in conditions.values()]),
            np.concatenate(jacobians),
            np.concatenate(errors),
            block_diag(*(local.within_pairs.correlation for local in conditions.values())),
            conditions,
            ensembles[0],
        )

    def _why(self) -> str:
        """What simulations ran into, for an error."""
        met = "; ".join(self.problems)
        return f": {met}" if met else ""

    def _check(self, condition: str, simulator: Simulator) -> None:
        """Raise `InputError` where a simulator does not go with the targets or the space."""
        of, targets = f" of {condition!r}" if condition else "", self.targets[condition]
        if not same_observables(simulator.observables, targets.observables):
            raise InputError(
                f"simulator{of} gives {', '.join(labels_of(simulator))}; the targets are "
                f"{', '.join(map(str, targets.observables))}"
            )
        names = tuple(self.space.entries[k].parameter for k in self.space.columns(condition))
        if simulator.parameters.names != names:
            raise InputError(
                f"simulator{of} takes {', '.join(simulator.parameters.names)}; the parameters of the fit are "
                f"{', '.join(names)}"
            )
