"""What all conditions' colonies say about a point θ: mean curves, derivatives, and the covariance of the comparison.

For each condition an ensemble is grown in pairs around the point (`paired_regression`), with the same keys wherever it
is, so that two points are compared by the same chance. One colony's curves have the covariance S. The data, means over
R replicates, scatter with S too, scaled statistic by statistic to the measured scatter, where that is known. So

    Σ = h (S_scaled / R + cov m) + measurement error,

h for S being an estimate (`experiment.curve_covariance`), cov m the Monte-Carlo error of the ensemble's mean. Where the
ensemble is too small to tell correlations, and to begin with, `rough` stands for Σ: variances only, with a twentieth of
the mean as a tolerance, under which the problem is less curved.

**Refinement.** Ensembles are grown with a coarse time step and grid, and around θ, not at it. What both change is told
by colonies of the model that is meant, fine and at θ, each with the key of a pair: d = mean of (fine − the pair's mean)
is a second level of the ensemble's mean (multilevel Monte Carlo: Giles 2008, doi:10.1287/opre.1070.0496), which takes
out the shift of ½ s² tr H, too. Its covariance joins Σ.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field

import jax.numpy as jnp
import numpy as np
from jaxtyping import Float
from scipy.linalg import block_diag

from yeastfit.errors import InputError
from yeastfit.inference.colonies import Colonies
from yeastfit.inference.fit.settings import FitSettings
from yeastfit.inference.information.experiment import curve_covariance, systematic
from yeastfit.inference.paired_regression import CurveSquare, Local, design, of_members, order, paired, regress_together
from yeastfit.inference.parameter_space import Space, Vector
from yeastfit.inference.targets import Targets
from yeastfit.simulation.simulate import member_keys

SCATTER = 0.2  # of the mean: one colony's scatter where nobody knows it, to begin with
ROUGH = 0.05  # of the mean: tolerance of a rough comparison


def measurement_covariance(targets: Targets, settings: FitSettings) -> CurveSquare:
    """Of the measured means' errors that replicates do not average out."""
    error = np.array([[settings.error_of(name)] for name in targets.names])
    measured = targets.measured.ravel()
    return systematic(np.nan_to_num(targets.mean), error)[np.ix_(measured, measured)]


@dataclass(frozen=True)
class Grown:
    """Curves of the colonies of one ensemble, and the rows of the design that its pairs were grown at."""

    curves: Float[np.ndarray, "colony curve"]
    units: Float[np.ndarray, "pair entry"]


@dataclass(frozen=True)
class Joint:
    """Curves of all conditions around a point, one condition after the other. locals, grown: by condition."""

    theta: Vector
    mean: Float[np.ndarray, " curve"]
    jacobian: Float[np.ndarray, "curve entry"]
    error: Float[np.ndarray, "curve entry"]
    correlation: CurveSquare
    locals: dict[str, Local]
    grown: dict[str, Grown]


@dataclass(frozen=True)
class Defect:
    """What finer numerics change in the mean curves, and the covariance of that."""

    mean: Float[np.ndarray, " curve"]
    covariance: CurveSquare


@dataclass(frozen=True)
class Ensembles:
    """The conditions of a fit: their targets and their colonies, coarse and, where they are refined, fine."""

    targets: dict[str, Targets]
    colonies: dict[str, Colonies]
    space: Space
    seed: int
    settings: FitSettings
    fine: dict[str, Colonies] = field(default_factory=dict)

    @staticmethod
    def of(targets: Mapping[str, Targets], space: Space, seed: int, settings: FitSettings) -> "Ensembles":
        """Colonies for each condition's targets."""

        def colonies(dt: float, spacing: float) -> dict[str, Colonies]:
            room = settings.capacity
            return {name: Colonies.of(each, dt=dt, spacing=spacing, capacity=room) for name, each in targets.items()}

        coarse = colonies(settings.dt, settings.spacing)
        fine = colonies(settings.fine_dt, settings.fine_spacing) if settings.refined else {}
        return Ensembles(dict(targets), coarse, space, seed, settings, fine)

    @property
    def values(self) -> Float[np.ndarray, " curve"]:
        """All data."""
        return np.concatenate([each.values for each in self.targets.values()])

    @property
    def everyone(self) -> tuple[Colonies, ...]:
        """All conditions' colonies, coarse and fine."""
        return (*self.colonies.values(), *self.fine.values())

    @property
    def grown(self) -> int:
        """Colonies so far."""
        return sum(each.grown for each in self.everyone)

    def pairs(self, condition: str, members: int, full: bool) -> int:
        """Pairs of an ensemble: whole Hadamard matrices, and enough to know the covariance of the curves in full."""
        rows = order(len(self.space.columns(condition)))
        wanted = max(members // 2, 2 * len(self.targets[condition].values) if full else 0)
        return rows * -(-wanted // rows)

    def alone(
        self, points: Float[np.ndarray, "point entry"], *, refined: bool = False
    ) -> Float[np.ndarray, "point curve"]:
        """One colony at each point, each with a key of its own; fine ones where the fit is refined, if asked for."""
        keys = member_keys(self.seed + 1, len(points))
        chosen = self.colonies | (self.fine if refined else {})
        grown = [colonies.grow(self.space.log_parameters(name, points), keys) for name, colonies in chosen.items()]
        return np.concatenate(grown, axis=1)

    def around(
        self, places: list[Vector], members: int, spread: float, full: bool = False
    ) -> "list[Joint | InputError]":
        """A `Joint` for each place, in one batch a condition; an error where colonies came to nothing."""
        found: list[dict[str, Grown]] = [{} for _ in places]
        for condition, colonies in self.colonies.items():
            columns, count = self.space.columns(condition), self.pairs(condition, members, full)
            units = design(count, len(columns), np.random.default_rng(self.seed))
            points = np.repeat(np.stack(places), 2 * count, axis=0)
            points[:, columns] = np.concatenate([paired(place[columns], units, spread) for place in places])
            keys = jnp.concatenate([member_keys(self.seed, count)] * (2 * len(places)))
            grown = colonies.grow(self.space.log_parameters(condition, points), keys)
            for each, curves in zip(found, np.split(grown, len(places)), strict=True):
                each[condition] = Grown(curves, units)
        joints: list[Joint | InputError] = []
        for place, each in zip(places, found, strict=True):
            try:
                joints.append(self._joint(place, [each], spread))
            except InputError as error:
                joints.append(InputError(f"{self.described(place)}: {error}"))
        return joints

    def together(self, joints: list[Joint], spread: float) -> Joint:
        """One `Joint` of several, whose points are close to each other and whose ensembles have the same size."""
        theta = np.mean([joint.theta for joint in joints], axis=0)
        return self._joint(theta, [joint.grown for joint in joints], spread)

    def defect(self, joint: Joint) -> Defect:
        """Of refinement at a point around which an ensemble has been grown; nothing where the fit is not refined."""
        means, covariances = list[np.ndarray](), list[np.ndarray]()
        for condition, grown in joint.grown.items():
            if condition not in self.fine:
                count = grown.curves.shape[1]
                means.append(np.zeros(count))
                covariances.append(np.zeros((count, count)))
                continue
            pairs = np.mean(np.split(grown.curves, 2), axis=0)[: self.settings.refined]
            points = np.tile(joint.theta, (len(pairs), 1))
            keys = member_keys(self.seed, len(pairs))
            change = self.fine[condition].grow(self.space.log_parameters(condition, points), keys) - pairs
            known = change[np.isfinite(change).all(axis=1)]
            if len(known) < 4:
                raise InputError(f"{self.described(joint.theta)}: refined colonies came to nothing: lower fine_dt")
            means.append(known.mean(axis=0))
            covariances.append(of_members(known).covariance / len(known))
        return Defect(np.concatenate(means), block_diag(*covariances))

    def described(self, theta: Vector) -> str:
        """A point in words."""
        return ", ".join(f"{name} {value:.3g}" for name, value in zip(self.space.names, np.exp(theta), strict=True))

    def rough(self, members: int) -> CurveSquare:
        """Variances of data and ensemble, as far as the data alone tell them."""
        parts = []
        for targets in self.targets.values():
            mean, scatter = targets.values, targets.scatter[targets.measured]
            variance = np.where(np.isfinite(scatter), scatter, SCATTER * mean) ** 2
            share = 1.0 / targets.replicates[targets.measured] + 2.0 / members
            parts.append(variance * share + (ROUGH * mean) ** 2)
        return np.diag(np.concatenate(parts))

    def sigma(self, joint: Joint) -> CurveSquare:
        """Σ (see above)."""
        return block_diag(*(self.sigma_of(name, joint.locals[name]) for name in self.targets))

    def sigma_of(self, condition: str, local: Local) -> CurveSquare:
        """Σ of one condition."""
        targets = self.targets[condition]
        chance, replicates = self.scatter_of(condition, local), targets.replicates[targets.measured].astype(float)
        freedom = float(local.scatter.freedom)
        data = curve_covariance(chance, replicates=replicates, freedom=freedom)
        monte_carlo = curve_covariance(local.mean_covariance, replicates=1.0, freedom=freedom)
        return data + monte_carlo + measurement_covariance(targets, self.settings)

    def scatter_of(self, condition: str, local: Local) -> CurveSquare:
        """One colony's covariance, scaled statistic by statistic to the measured scatter where that is known."""
        targets, chance = self.targets[condition], local.scatter.covariance
        rows = np.argwhere(targets.measured)[:, 0]
        spread = targets.scatter[targets.measured]
        ratio = np.ones(len(rows))
        for row in range(len(targets.names)):
            known = (rows == row) & np.isfinite(spread)
            if known.any():
                ratio[rows == row] = np.sqrt((spread[known] ** 2).mean() / np.diag(chance)[known].mean())
        return chance * np.outer(ratio, ratio)

    def _joint(self, theta: Vector, grown: list[dict[str, Grown]], spread: float) -> Joint:
        """Of ensembles at one place, or at several close to θ."""
        entries, locals_ = len(self.space.entries), dict[str, Local]()
        jacobians, errors = list[np.ndarray](), list[np.ndarray]()
        for condition in self.targets:
            columns, units = self.space.columns(condition), grown[0][condition].units
            local = regress_together([each[condition].curves for each in grown], units, spread)
            for part, whole in ((local.jacobian, jacobians), (local.error, errors)):
                wide = np.zeros((len(part), entries))
                wide[:, columns] = part
                whole.append(wide)
            locals_[condition] = local
        return Joint(
            theta,
            np.concatenate([local.mean for local in locals_.values()]),
            np.concatenate(jacobians),
            np.concatenate(errors),
            block_diag(*(local.apart.correlation for local in locals_.values())),
            locals_,
            grown[0],
        )
