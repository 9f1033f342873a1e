"""The stages of a fit, as `fit` describes them: screening, steps of ensembles that grow, the estimate."""

import time as clock
from dataclasses import dataclass, field

import numpy as np
from scipy.linalg import solve_triangular

from yeastfit.errors import InputError
from yeastfit.inference.fit.ensemble import Defect, Ensembles, Joint
from yeastfit.inference.fit.final_estimate import conditions, last_step, verdict
from yeastfit.inference.fit.optimiser import Search
from yeastfit.inference.fit.result import Fit, Start, Step
from yeastfit.inference.information.fisher import information
from yeastfit.inference.information.result import Information
from yeastfit.inference.parameter_space import Vector
from yeastfit.model.colony import PROBLEMS
from yeastfit.progress import Progress

APART = 0.3  # of log λ, in one entry at least, between two places that are not the same
ABOUT_AS_GOOD = 9.0  # of the rough χ²: what a start may lag behind the best and still go on; later, of χ²,
NEARLY_AS_GOOD = 4.0
WITHIN_NOISE = 1.0  # of χ²: a fall by less is one standard error in one direction, at most
CARRIED = 2  # starts that go on, at most


@dataclass
class Run:
    """One start on its way. joint: at the best point of its stage; seen: all of its stage's."""

    number: int
    theta: Vector
    cost: float = np.inf
    ended: str = ""
    joint: Joint | None = None
    seen: list[Joint] = field(default_factory=list)
    failed: bool = False
    defect: Defect | None = None


@dataclass
class Fitter:
    """The stages of one fit."""

    ensembles: Ensembles
    pulls: dict[str, tuple[float, float]]
    progress: Progress
    history: list[Step] = field(default_factory=list)
    starts: tuple[Start, ...] = ()
    notes: list[str] = field(default_factory=list)

    def __post_init__(self) -> None:
        space = self.ensembles.space
        self.settings, self.space, self.y = self.ensembles.settings, space, self.ensembles.values
        self.centre = np.array([self.pulls.get(name, (0.0, 1.0))[0] for name in space.names])
        self.pull = np.array([1.0 / self.pulls[name][1] if name in self.pulls else 0.0 for name in space.names])

    def run(self, start: Vector | None) -> Fit:
        """All stages."""
        began, settings = clock.perf_counter(), self.settings
        runs = self._screened() if start is None else [Run(1, start)]
        begun, members = [run.theta for run in runs], settings.members
        for stage, (count, spread) in enumerate(zip(members, settings.spreads, strict=True)):
            last = stage == len(members) - 1
            if last:
                for colonies in self.ensembles.everyone:
                    colonies.problems.clear()
            self._stage(runs, stage, count, spread, last)
            kept = self._best(runs, NEARLY_AS_GOOD if stage else ABOUT_AS_GOOD)
            if not stage:
                self.starts = tuple(
                    Start(run.number, place, run.theta, run.cost, run.ended, run in kept)
                    for run, place in zip(runs, begun, strict=True)
                )
            runs = kept
        return self._result(runs, seconds=clock.perf_counter() - began)

    def _screened(self) -> list[Run]:
        """The best of some points of the box, apart from each other."""
        settings = self.settings
        self.progress("looking at the box", 0.0)
        points = self.space.scattered(settings.screened, self.ensembles.seed)
        curves = self.ensembles.alone(points)
        sigma = np.diag(self.ensembles.rough(members=2))
        cost = ((curves - self.y) ** 2 / sigma).sum(axis=1) + self._prior_cost(points)
        ranked = points[np.argsort(np.where(np.isfinite(cost), cost, np.inf))][: int(np.isfinite(cost).sum())]
        chosen: list[Vector] = []
        for point in ranked:
            if len(chosen) < settings.starts and all((np.abs(point - other) > APART).any() for other in chosen):
                chosen.append(point)
        if not chosen:
            raise InputError(f"{len(points)} colonies all over the box came to nothing (not finite): lower dt")
        return [Run(number, point) for number, point in enumerate(chosen, start=1)]

    def _stage(self, runs: list[Run], stage: int, members: int, spread: float, last: bool) -> None:
        """Steps of every run until each has ended, in batches. The weights are those of the first point."""
        settings, factor = self.settings, None
        size = len(self.y) + len(self.pull)
        searches = {run.number: Search(settings.method, self.space.to_z(run.theta), size, not stage) for run in runs}
        for run in runs:
            run.ended, run.seen, run.joint, run.cost = "", [], None, np.inf
        for step in range(settings.max_steps):
            active = [run for run in runs if not run.ended]
            if not active:
                return
            self.progress(f"stage {stage + 1} of {len(settings.members)}, step {step + 1}", self._share(stage, step))
            places = [self.space.of_z(searches[run.number].trial) for run in active]
            joints = self.ensembles.around(places, members, spread, full=last)
            for run, place, joint in zip(active, places, joints, strict=True):
                if isinstance(joint, InputError):
                    self._refused(run, searches[run.number], joint)
                    continue
                if last and run.defect is None:
                    try:
                        run.defect = self.ensembles.defect(joint)
                    except InputError as error:
                        self._refused(run, searches[run.number], error)
                        continue
                if factor is None:
                    known = self._knows_scatter(joint, stage)
                    factor = np.linalg.cholesky(self._sigma(run, joint) if known else self.ensembles.rough(members))
                self._tell(run, searches[run.number], joint, factor, place, f"stage {stage + 1}", members)
            for run in active:
                run.failed = bool(searches[run.number].failure)
                run.ended = run.ended or self._ended(searches[run.number], settings.tolerance if last else WITHIN_NOISE)
        for run in runs:
            run.ended = run.ended or f"the limit of {settings.max_steps} steps was reached"

    def _tell(
        self, run: Run, search: Search, joint: Joint, factor: np.ndarray, place: Vector, stage: str, members: int
    ) -> None:
        residuals, jacobian = self._whitened(run, joint, factor)
        cost = float(residuals @ residuals)
        taken = search.tell(residuals, jacobian * self.space.slope(place))
        run.seen.append(joint)
        if taken:
            run.theta, run.joint, run.cost = place, joint, search.cost
        values = dict(zip(self.space.names, np.exp(place).tolist(), strict=True))
        self.history.append(Step(stage, run.number, members, self.ensembles.grown, cost, taken, values))

    def _refused(self, run: Run, search: Search, error: InputError) -> None:
        """A point without colonies is one of endless cost; a start there ends."""
        self.notes.append(f"start {run.number}: {error}")
        if run.joint is None:
            run.ended = str(error)
        else:
            search.tell(np.full(search.size, 1e6), np.zeros((search.size, len(self.pull))))

    def _sigma(self, run: Run, joint: Joint) -> np.ndarray:
        """Σ, with the refinement's error."""
        return self.ensembles.sigma(joint) + (0.0 if run.defect is None else run.defect.covariance)

    def _whitened(self, run: Run, joint: Joint, factor: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Residuals and their Jacobian in θ, priors included, all of variance 1."""
        change = 0.0 if run.defect is None else run.defect.mean
        residuals = solve_triangular(factor, joint.mean + change - self.y, lower=True)
        jacobian = solve_triangular(factor, joint.jacobian, lower=True)
        pulled = self.pull * (joint.theta - self.centre)
        return np.concatenate([residuals, pulled]), np.concatenate([jacobian, np.diag(self.pull)])

    def _ended(self, search: Search, tolerance: float) -> str:
        """How a run ended, or nothing."""
        if search.failure:
            return search.failure
        if search.promise < tolerance:
            return "converged"
        if search.refused >= self.settings.patience:
            return f"{search.refused} steps in a row were refused"
        return ""

    def _knows_scatter(self, joint: Joint, stage: int) -> bool:
        """Whether the ensembles are large enough for Σ with its correlations."""
        return stage > 0 and all(local.scatter.freedom > 2 * len(local.mean) + 10 for local in joint.locals.values())

    def _best(self, runs: list[Run], margin: float) -> list[Run]:
        """The best, and another one that is about as good and elsewhere."""
        alive = sorted((run for run in runs if run.joint is not None), key=lambda run: run.cost)
        if not alive:
            raise InputError("no start led anywhere: " + "; ".join(run.ended for run in runs))
        chosen = alive[:1]
        for run in alive[1:]:
            apart = all((np.abs(run.theta - other.theta) > APART).any() for other in chosen)
            if len(chosen) < CARRIED and apart and run.cost < alive[0].cost + margin:
                chosen.append(run)
        return chosen

    def _prior_cost(self, points: np.ndarray) -> np.ndarray:
        return (((points - self.centre) * self.pull) ** 2).sum(axis=1)

    def _share(self, stage: int, step: int) -> float:
        """Of the work: stages count by their members."""
        members = np.array(self.settings.members, dtype=float)
        members[0] *= self.settings.starts
        behind = members[:stage].sum() + members[stage] * min(1.0, step / 4)
        return float(0.05 + 0.95 * behind / members.sum())

    def _result(self, runs: list[Run], seconds: float) -> Fit:
        best, ensembles, spread = runs[0], self.ensembles, self.settings.spreads[-1]
        joint = ensembles.together(
            [one for one in best.seen if (np.abs(one.theta - best.theta) <= spread).all()], spread
        )
        sigma = self._sigma(best, joint)
        widths = {name: width for name, (_, width) in self.pulls.items()}
        known = information(
            joint.jacobian,
            sigma,
            free=self.space.names,
            error=joint.error,
            correlation=joint.correlation,
            prior=widths,
        )
        factor = np.linalg.cholesky(sigma)
        residuals, jacobian = self._whitened(best, joint, factor)
        step = last_step(known, residuals, jacobian, len(self.y), joint.theta, self.space)
        theta, rest = joint.theta + step, residuals + jacobian @ step
        converged, status = verdict(best.ended, best.failed, theta - best.theta, known)
        result = Fit(
            conditions=conditions(self.space, ensembles.targets, theta, self.y + factor @ rest[: len(self.y)], sigma),
            space=self.space,
            theta=theta,
            information=known,
            jacobian=joint.jacobian,
            chi_square=float(rest @ rest),
            converged=converged,
            status=status,
            starts=self.starts,
            history=tuple(self.history),
            simulations=ensembles.grown,
            seed=ensembles.seed,
            settings=self.settings,
            prior=dict(self.pulls),
            seconds=seconds,
            warnings=(),
        )
        return result.with_warnings(self._warnings(result, known, runs))

    def _warnings(self, result: Fit, known: Information, runs: list[Run]) -> list[str]:
        said = self.notes + known.sentences()
        for entry in self.space.at_a_bound(result.theta):
            low, high = entry.bounds
            said.append(f"{entry.name} ran to an end of its range, {low:g} to {high:g}: its error is not to be trusted")
        said += result.misfit()
        for run in runs[1:]:
            if (np.abs(run.theta - result.theta) > APART).any():
                where = self.ensembles.described(run.theta)
                said.append(f"another start ended at {where}, where χ² is only {run.cost - runs[0].cost:.1f} higher")
        for colonies in self.ensembles.everyone:
            said += [
                f"{count} colonies of the last stage: {PROBLEMS[name]}" for name, count in colonies.problems.items()
            ]
        return said
