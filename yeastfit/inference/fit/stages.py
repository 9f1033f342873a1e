"""The stages of a fit, as `fit` describes them: steps of ensembles that grow, the estimate, a second look."""

import time as clock
from collections import Counter
from dataclasses import dataclass, field, replace

import numpy as np

from yeastfit.errors import SimulationError
from yeastfit.inference.curve_covariance import Square, whitened
from yeastfit.inference.fit.descent import Descent, are_different
from yeastfit.inference.fit.ensemble import Ensembles, JointModel
from yeastfit.inference.fit.evaluations import Start, Step
from yeastfit.inference.fit.final_estimate import conditions, last_step, verdict
from yeastfit.inference.fit.optimiser import Optimiser
from yeastfit.inference.fit.result import Fit
from yeastfit.inference.fit.simulators import Rules
from yeastfit.inference.fit.starting_points import along_unseen, put_ends_together, screened
from yeastfit.inference.information.fisher import information
from yeastfit.inference.information.result import Information
from yeastfit.inference.parameter_space import Points, Vector
from yeastfit.inference.resolution import Resolution
from yeastfit.progress import Progress

NEAR_AT_FIRST = 9.0  # of χ², three standard errors: what a start may lag behind the best and still go on
NEAR_LATER = 4.0  # two standard errors
WITHIN_NOISE = 1.0  # of χ²: a fall by less is one standard error in one direction, at most
CARRIED = 2  # starts that go on, at most: a second one tells of another minimum, more would cost as much again
NOWHERE = 1e6  # a residual where simulations failed: every optimiser rejects such a step
BENT = 1.0  # errors of a datum by which the mean of an ensemble may differ from that at its centre
LOST = 0.01  # of the simulations: as many may fail far from the estimate, where a fit looks first, without a word
CONVERGED = "converged"


@dataclass
class Fitter:
    """The stages of one fit.

    Attributes:
        ensembles: Data and simulators.
        priors: Centre and width in θ, by entry.
        progress: Called with what is being done and the share that is done.
        colonies: Resolutions and rules, for the result; see `Fit`.
        history: All evaluations.
        starts: Where it began.
        notes: What went wrong on the way, in words.
        roots: L of Σ = L Lᵀ by stage, one for all starts, so that their χ² can be compared.
    """

    ensembles: Ensembles
    priors: dict[str, tuple[float, float]]
    progress: Progress
    colonies: tuple[tuple[Resolution, Resolution] | None, Rules | None] = (None, None)
    history: list[Step] = field(default_factory=list)
    starts: tuple[Start, ...] = ()
    notes: list[str] = field(default_factory=list)
    roots: dict[int, Square] = field(default_factory=dict)

    def __post_init__(self) -> None:
        space = self.ensembles.space
        self.settings, self.space, self.y = self.ensembles.settings, space, self.ensembles.values
        self.centre = np.array([self.priors.get(name, (0.0, 1.0))[0] for name in space.names])
        self.pull = np.array([1.0 / self.priors[name][1] if name in self.priors else 0.0 for name in space.names])

    def run(self, start: Vector | None) -> Fit:
        """Go through all stages.

        Arguments:
            start: θ to begin from; by default the best of some points of the box.

        Raises:
            SimulationError: No start led anywhere.
        """
        began = clock.perf_counter()
        if start is None:
            self.progress("trying starting points", 0.0)
        places = screened(self.ensembles, self._prior_costs) if start is None else [start]
        descents, met = self._stages(places, CARRIED)
        result = self._result(descents, met, clock.perf_counter() - began)
        if not result.information.blind.any():
            return result
        self.progress("looking along what the data do not see", 0.5)
        again = along_unseen(self.ensembles, self._prior_costs, result.theta, result.information)
        if not again:
            return result
        try:
            others, met_again = self._stages(again, len(again))  # the first stage hardly tells places of a valley apart
        except SimulationError as error:
            self.notes.append(f"along what the data do not see: {error}")
            others, met_again = [], Counter[str]()
        descents = self._best([*descents, *others], NEAR_LATER)
        return self._result(descents, met + met_again, clock.perf_counter() - began)

    def _stages(self, places: list[Vector], carried: int) -> tuple[list[Descent], Counter[str]]:
        """All stages from some places: the descents that are left at the end, and problems of the last stage.

        At most so many are `carried` beyond the first stage.
        """
        descents = [Descent(number, place) for number, place in enumerate(places, start=len(self.starts) + 1)]
        met = Counter[str]()
        for stage in range(len(self.settings.members)):
            met = self.ensembles.problems
            self._stage(descents, stage)
            if not stage:
                number = 1 + len(self.starts) + len(descents)
                further = [
                    Descent(number, one) for one in put_ends_together(self.ensembles, self._prior_costs, descents)
                ]
                places = [*places, *(one.theta for one in further)]
                self._stage(further, stage)
                descents = [*descents, *further]
            kept = self._best(descents, NEAR_LATER) if stage else self._best(descents, NEAR_AT_FIRST, carried)
            if not stage:
                self.starts += tuple(
                    Start(one.number, place, one.theta, one.cost, one.ended, one in kept)
                    for one, place in zip(descents, places, strict=True)
                )
            descents = kept
        return descents, self.ensembles.problems - met

    def _prior_costs(self, points: Points) -> np.ndarray:
        """What Gaussian priors add to χ², entry by entry."""
        return np.asarray(((points - self.centre) * self.pull) ** 2)

    def _stage(self, descents: list[Descent], stage: int) -> None:
        """Steps of every descent until each has ended, in batches. The weights are those of the first point of all."""
        settings = self.settings
        members, spread, last = settings.members[stage], settings.spreads[stage], self._is_last(stage)
        size = len(self.y) + len(self.pull)
        optimisers = {
            one.number: Optimiser(settings.method, self.space.z_of(one.theta), size, not stage) for one in descents
        }
        for one in descents:
            one.ended, one.seen, one.model, one.cost = "", [], None, np.inf
        for step in range(settings.max_steps):
            active = [one for one in descents if not one.ended]
            if not active:
                return
            self.progress(f"stage {stage + 1} of {len(settings.members)}, step {step + 1}", self._share(stage, step))
            places = [self.space.theta_of(optimisers[one.number].trial) for one in active]
            models = self.ensembles.local_models(places, members, spread, full=last)
            for one, model in zip(active, models, strict=True):
                found = self._corrected(one, model) if last else model
                if isinstance(found, SimulationError):
                    self._lost(one, optimisers[one.number], found)
                    continue
                if stage not in self.roots:
                    self.roots[stage] = self._root(one, found, stage)
                self._evaluated(one, optimisers[one.number], found, self.roots[stage], stage)
            for one in active:
                optimiser = optimisers[one.number]
                one.failed = bool(optimiser.failure)
                one.ended = one.ended or self._ended(optimiser, settings.tolerance if last else WITHIN_NOISE)
        for one in descents:
            one.ended = one.ended or f"the limit of {settings.max_steps} steps was reached"

    def _corrected(self, descent: Descent, model: JointModel | SimulationError) -> JointModel | SimulationError:
        """The model, once the descent has a correction by fine simulations."""
        if isinstance(model, JointModel) and descent.correction is None:
            try:
                descent.correction = self.ensembles.correction(model)
            except SimulationError as error:
                return error
        return model

    def _root(self, descent: Descent, model: JointModel, stage: int) -> Square:
        """L of Σ = L Lᵀ, with correlations where the ensembles are large enough to tell them."""
        known = stage > 0 and all(
            local.scatter.freedom > 2 * len(local.mean) + 10 for local in model.conditions.values()
        )  # so that h of `mean_covariance` is below 2
        members = self.settings.members[stage]
        return np.linalg.cholesky(
            self._covariance(descent, model) if known else self.ensembles.screening_covariance(members)
        )

    def _evaluated(self, descent: Descent, optimiser: Optimiser, model: JointModel, root: Square, stage: int) -> None:
        """Tell the optimiser what a model says, and keep it."""
        residuals, jacobian = self._whitened(descent, model, root)
        taken = optimiser.tell(residuals, jacobian * self.space.slope(model.theta))
        descent.seen.append(model)
        if taken:
            descent.theta, descent.model, descent.cost = model.theta, model, optimiser.cost
        values = dict(zip(self.space.names, np.exp(model.theta).tolist(), strict=True))
        name, members, made = f"stage {stage + 1}", self.settings.members[stage], self.ensembles.tally.simulated
        cost = float(residuals @ residuals)
        self.history.append(Step(name, descent.number, members, made, cost, taken, values))

    def _lost(self, descent: Descent, optimiser: Optimiser, error: SimulationError) -> None:
        """A point where simulations failed costs as good as infinitely much; a start there ends."""
        self.notes.append(f"start {descent.number}: {error}")
        if descent.model is None:
            descent.ended = str(error)
        else:
            optimiser.tell(np.full(optimiser.size, NOWHERE), np.zeros((optimiser.size, len(self.pull))))

    def _covariance(self, descent: Descent, model: JointModel) -> Square:
        """Σ, with the error of the correction."""
        correction = descent.correction
        return self.ensembles.covariance(model) + (0.0 if correction is None else correction.covariance)

    def _whitened(self, descent: Descent, model: JointModel, root: Square) -> tuple[np.ndarray, np.ndarray]:
        """Residuals and their Jacobian in θ, priors included, all of variance 1."""
        change = 0.0 if descent.correction is None else descent.correction.mean
        residuals = whitened(root, model.mean + change - self.y)
        jacobian = whitened(root, model.jacobian)
        pulled = self.pull * (model.theta - self.centre)
        return np.concatenate([residuals, pulled]), np.concatenate([jacobian, np.diag(self.pull)])

    def _ended(self, optimiser: Optimiser, tolerance: float) -> str:
        """How a descent ended, or nothing."""
        if optimiser.failure:
            return optimiser.failure
        if optimiser.predicted_reduction < tolerance:
            return CONVERGED
        if optimiser.rejected >= self.settings.patience:
            return f"{optimiser.rejected} steps in a row were rejected"
        return ""

    def _best(self, descents: list[Descent], margin: float, most: int = CARRIED) -> list[Descent]:
        """The best, and others that are about as good and elsewhere."""
        alive = sorted((one for one in descents if one.model is not None), key=lambda one: one.cost)
        if not alive:
            raise SimulationError("no start led anywhere: " + "; ".join(one.ended for one in descents))
        chosen = alive[:1]
        for one in alive[1:]:
            elsewhere = all(are_different(one.theta, other.theta) for other in chosen)
            if len(chosen) < most and elsewhere and one.cost < alive[0].cost + margin:
                chosen.append(one)
        return chosen

    def _is_last(self, stage: int) -> bool:
        return stage == len(self.settings.members) - 1

    def _share(self, stage: int, step: int) -> float:
        """Of the work: stages count by their members."""
        members = np.array(self.settings.members, dtype=float)
        members[0] *= self.settings.starts
        behind = members[:stage].sum() + members[stage] * min(1.0, step / 4)
        return float(0.05 + 0.95 * behind / members.sum())

    def _result(self, descents: list[Descent], met: Counter[str], seconds: float) -> Fit:
        """The estimate from all models near the best descent's last point."""
        best, ensembles, spread = descents[0], self.ensembles, self.settings.spreads[-1]
        near = [one for one in best.seen if (np.abs(one.theta - best.theta) <= spread).all()]
        model = ensembles.averaged(near)
        sigma = self._covariance(best, model)
        known = information(
            model.jacobian,
            sigma,
            free=self.space.names,
            error=model.error,
            correlation=model.correlation,
            prior={name: width for name, (_, width) in self.priors.items()},
        )
        root = np.linalg.cholesky(sigma)
        residuals, jacobian = self._whitened(best, model, root)
        step = last_step(known, residuals, jacobian, len(self.y), model.theta, self.space)
        theta, rest = model.theta + step, residuals + jacobian @ step
        status, detail = verdict(best.ended == CONVERGED, best.ended, best.failed, theta - best.theta, known)
        fitted = self.y + root @ rest[: len(self.y)]
        result = Fit(
            conditions=conditions(self.space, ensembles.targets, ensembles.simulators, theta, fitted, sigma),
            space=self.space,
            theta=theta,
            information=known,
            jacobian=model.jacobian,
            chi_square=float(rest @ rest),
            status=status,
            detail=detail,
            starts=self.starts,
            history=tuple(self.history),
            simulations=ensembles.tally.simulated,
            seed=ensembles.seed,
            settings=self.settings,
            prior=dict(self.priors),
            resolutions=self.colonies[0],
            rules=self.colonies[1],
            seconds=seconds,
            warnings=(),
        )
        return replace(result, warnings=(*self._warnings(result, known, descents, met), *self._bent(best, sigma)))

    def _bent(self, best: Descent, sigma: Square) -> list[str]:
        """In words, where means bend within the spread of ensembles; only a simulator that has no finer one tells."""
        if best.correction is None or self.ensembles.fine is not self.ensembles.simulators:
            return []
        shift = float(np.max(np.abs(best.correction.mean) / np.sqrt(np.diag(sigma))))
        if shift < BENT:
            return []
        spread = self.settings.spreads[-1]
        return [
            f"means bend within the spread of the last ensembles, {spread:g} of log λ: by {shift:.1f} errors of a "
            "datum, and the fit follows straight lines: give smaller spreads (FitSettings), such as "
            f"{', '.join(f'{one / 4:g}' for one in self.settings.spreads)}"
        ]

    def _warnings(self, result: Fit, known: Information, descents: list[Descent], met: Counter[str]) -> tuple[str, ...]:
        said = self.notes + known.sentences()
        for entry in self.space.at_a_bound(result.theta):
            low, high = entry.bounds
            said.append(f"{entry.name} ran to an end of its range, {low:g} to {high:g}: its error is not to be trusted")
        said += result.misfit()
        for one in descents[1:]:
            if are_different(one.theta, result.theta):
                where, more = self.space.described(one.theta), one.cost - descents[0].cost
                said.append(f"another start ended at {where}, where χ² is only {more:.1f} higher")
        tally = self.ensembles.tally
        if tally.failed > LOST * tally.simulated and not met:
            said.append(
                f"{tally.failed} of {tally.simulated} simulations failed (not finite) and were left out: means are "
                "those of the others"
            )
        return (*said, *(f"{count} simulations of the last stage: {problem}" for problem, count in met.items()))
