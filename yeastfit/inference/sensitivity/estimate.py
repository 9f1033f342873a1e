"""`sensitivity`: how the mean of an ensemble answers to λ, and how far that answer can be trusted.

Colonies are chaotic and divide: what one colony does when λ changes a little says nothing about another, and after a
while nothing about itself. What a fit needs is J = ∂E[y] / ∂log λ, the derivative of the mean. Two estimators:

**Regression** (`paired_regression`) runs the model away from λ, in pairs at log λ ± spread · ε, and needs no
derivative, so the model may be the hard one. Its bias, of order spread², is two or three standard errors of 256 runs at
spread 0.2 and a fraction of one at 0.1. Were all colonies independent, n runs would tell seven parameters apart with a
seventh of the variance of n runs of central differences; common keys help those more.

**Pathwise** is forward mode through the relaxed model, a mean over members that outliers cannot carry away
(`robust_mean`). Exact derivatives of single colonies explode with the number of contacts; taming them
(`Relaxation.turning`) makes them quiet and biased, and none sees how λ changes the order of parents. No number of
members tells by how much. So they are taken of a model close to the hard one, half tamed, and only up to `PATH_NODES`
nodes, where they cost little and a few of them are as quiet as hundreds of runs.

**Combined** shrinks the first towards the second, the more the quieter the second is and the better they agree
(`shrinkage`).

**Scatter**, the covariance S of one colony's curves, comes of the same runs: of the pairs, and of the colonies at λ
itself (`regression.pooled`).
"""

import time as clock
from collections import Counter
from collections.abc import Sequence
from dataclasses import replace
from typing import get_args

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from yeastfit.errors import InputError
from yeastfit.inference.curves import Curves, robust_mean, without_problems
from yeastfit.inference.paired_regression import design, of_members, paired, pooled, regress
from yeastfit.inference.sensitivity.result import Estimate, Method, Sensitivity
from yeastfit.inference.sensitivity.shrinkage import combine
from yeastfit.measure.statistics.registry import names_with
from yeastfit.measure.statistics.smooth_statistics import SmoothStatistics
from yeastfit.model.colony import PROBLEMS
from yeastfit.model.numerics import Numerics
from yeastfit.model.parameters import NAMES, Parameters
from yeastfit.model.relaxation import Relaxation
from yeastfit.progress import Progress, silent
from yeastfit.simulation.simulate import member_keys, schedule_of

STATISTICS = ("compactness", "mean_radius", "radius", "area", "cell_count")
COUNT = "cell_count"
PATH_NODES = 64  # of the mean colony, up to which pathwise derivatives are of use
EXPLODED = 3.0  # times the scatter of the members left as they are: the tails would decide a plain mean


def sensitivity(
    parameters: Parameters | None = None,
    *,
    times: Sequence[float] | np.ndarray,
    statistics: Sequence[str] = STATISTICS,
    free: Sequence[str] = NAMES,
    method: Method = "combined",
    runs: int = 256,
    paths: int = 8,
    spread: float = 0.1,
    seed: int = 0,
    numerics: Numerics | None = None,
    relaxation: Relaxation | None = None,
    path_numerics: Numerics | None = None,
    path_relaxation: Relaxation | None = None,
    observe: SmoothStatistics | None = None,
    progress: Progress | None = None,
) -> Sensitivity:
    """Mean of an ensemble of colonies and its derivative in log λ at `parameters`, with standard errors.

    statistics: of `SmoothStatistics`. free: with respect to which parameters. method: "combined", "regression" or
    "pathwise" (see above); what is not asked for is not run, but the mean is always that of `relaxation` at λ, from a
    quarter as many colonies as the regression has. runs: colonies for the regression, a multiple of 16. paths: colonies
    for the pathwise part; each costs six to seven plain runs of its model. "combined" grows them to `PATH_NODES` at
    most, "pathwise" to the end. spread: of log λ in the regression, whose bias grows as spread² and whose variance
    falls as 1/spread². relaxation, numerics: of the model that is meant, by default `hard_but_smoothly_measured` at
    Δt = 0.005. path_relaxation, path_numerics: of the one that is differentiated, by default `tame` at Δt = 0.01.

    Same seed, same result. Regression steps a little beyond the largest admissible repulsion_radius or aspect_ratio
    where λ lies there. Raises `InputError`. Costs nothing to be asked again for other statistics of the same run: ask
    for all at once.
    """
    began = clock.perf_counter()
    parameters = parameters or Parameters()
    numerics = numerics or Numerics(dt=0.005)
    path_numerics = path_numerics or _of_paths(numerics, parameters)
    relaxation = hard_but_smoothly_measured() if relaxation is None else relaxation
    path_relaxation = tame() if path_relaxation is None else path_relaxation
    _check(parameters, statistics, free, method, runs, paths, spread)
    log_values = np.log([float(getattr(parameters, name)) for name in NAMES])
    chosen = np.array([NAMES.index(name) for name in free])
    times = np.atleast_1d(np.asarray(times, dtype=float))
    shape = len(statistics), len(times)
    recorded = tuple(statistics) + (() if COUNT in statistics else (COUNT,))
    observe = replace(observe or SmoothStatistics(numerics.domain, 0.1), statistics=recorded)
    say = progress or silent

    def curves(numerics: Numerics, relaxation: Relaxation, times: np.ndarray) -> Curves:
        return Curves(recorded, numerics, observe, relaxation, schedule_of(times, numerics))

    model = curves(numerics, relaxation, times)
    parts: dict[str, Estimate] = {}
    seconds: dict[str, float] = {}
    spent = {"mean": max(8, runs // 4)}
    tails, warnings = np.ones(shape), list[str]()
    say("the mean", 0.0)
    problems: dict[str, Counter[str]] = {"regression and mean": Counter(), "pathwise": Counter()}

    def at(points: np.ndarray) -> np.ndarray:
        """All seven log λ of points in the chosen ones."""
        whole = np.tile(log_values, (len(points), 1))
        whole[:, chosen] = points
        return whole

    def grow(log_values: np.ndarray, keys: Array) -> np.ndarray:
        found, met = without_problems(model.members(jnp.asarray(log_values, jnp.result_type(float)), keys))
        problems["regression and mean"] += met
        return found.reshape(-1, len(recorded), len(times))

    centre = grow(log_values, member_keys(jax.random.fold_in(jax.random.key(seed), 1), spent["mean"]))
    nodes = centre[:, recorded.index(COUNT)].mean(axis=0) + 1
    centre = centre[:, : shape[0]]
    alone = of_members(centre.reshape(len(centre), -1))
    scatter, correlation = alone.covariance, alone.correlation
    seconds["mean"] = clock.perf_counter() - began
    if method != "pathwise":
        say("regression", 0.1)
        began = clock.perf_counter()
        keys = member_keys(jax.random.fold_in(jax.random.key(seed), 0), runs // 2)
        units = design(len(keys), len(chosen), np.random.default_rng(seed))
        grown = grow(at(paired(log_values[chosen], units, spread)), jnp.concatenate([keys, keys]))
        local = regress(grown[:, : shape[0]].reshape(runs, -1), units, spread)
        parts["regression"] = Estimate(local.jacobian.reshape(*shape, -1), local.error.reshape(*shape, -1))
        scatter, correlation = pooled(alone, local.common, local.apart), local.apart.correlation
        spent["regression"], seconds["regression"] = runs, clock.perf_counter() - began
    sampled = len(times) if method == "pathwise" else int(np.sum(nodes <= PATH_NODES))  # from the first on
    if method != "regression" and sampled:
        say("pathwise", 0.7)
        began = clock.perf_counter()
        keys = member_keys(jax.random.fold_in(jax.random.key(seed), 2), paths)
        differentiated = curves(path_numerics, path_relaxation, times[:sampled])
        z = jnp.asarray(log_values, jnp.result_type(float))
        values, tangents = differentiated.members_with_tangents(z, keys)
        problems["pathwise"] = without_problems(values)[1]
        of_curves = np.asarray(tangents)[..., : len(recorded) * sampled].reshape(*tangents.shape[:2], -1, sampled)
        parts["pathwise"], tails = _pathwise(of_curves[:, chosen, : shape[0]], len(times))
        spent["pathwise"], seconds["pathwise"] = paths, clock.perf_counter() - began
        warnings += _doubts(tails, statistics, times, method)
    for part, counts in problems.items():
        warnings += [f"{part}: {count} colonies: {PROBLEMS[name]}" for name, count in counts.items()]
    if method == "combined" and "pathwise" in parts:
        jacobian, error, share = combine(parts["regression"], parts["pathwise"])
    elif method == "combined":
        jacobian, error, share = parts["regression"].jacobian, parts["regression"].error, np.zeros(shape)
    else:
        jacobian, error = parts[method].jacobian, parts[method].error
        share = np.full(shape, float(method == "pathwise"))
    return Sensitivity(
        parameters=parameters,
        free=tuple(free),
        statistics=tuple(statistics),
        times=times,
        method=method,
        mean=centre.mean(axis=0),
        mean_error=centre.std(axis=0, ddof=1) / np.sqrt(len(centre)),
        jacobian=jacobian,
        error=error,
        pathwise_share=share,
        parts=parts,
        tails=tails,
        scatter=scatter,
        correlation=correlation,
        runs=spent,
        seconds=seconds,
        seed=seed,
        spread=spread,
        warnings=warnings,
    )


def hard_but_smoothly_measured() -> Relaxation:
    """The hard model, its outline seen as that of the relaxed one, so that the two have the same statistics."""
    return Relaxation(union=None, contact=None, boundary=0.2, births="whole")


def tame() -> Relaxation:
    """The model that is differentiated: a contact to both sides of its radius, whose direction is half held fixed."""
    return Relaxation(contact=0.1, overhang=0.25, turning=0.5)


def _pathwise(
    tangents: Float[np.ndarray, "member free statistic sampled"], times: int
) -> tuple[Estimate, Float[np.ndarray, "statistic time"]]:
    """The estimate and its tails; NaN and 1 from where on paths do not go."""
    robust = robust_mean(jnp.moveaxis(jnp.asarray(tangents), 1, -1))
    beyond = times - tangents.shape[-1]

    def at_all_times(values: Array, rest: float) -> np.ndarray:
        return np.pad(np.asarray(values, float), ((0, 0), (0, beyond), (0, 0))[: values.ndim], constant_values=rest)

    estimate = Estimate(at_all_times(robust.mean, np.nan), at_all_times(robust.error, np.nan))
    return estimate, at_all_times(jnp.nan_to_num(robust.spread, nan=jnp.inf).max(axis=-1), 1.0)


def _of_paths(numerics: Numerics, parameters: Parameters) -> Numerics:
    """Δt of 0.01 at most, and such that no step throws two nodes across half the ramp of `tame`."""
    stiffest = max(float(parameters.elasticity), float(parameters.repulsivity))
    return replace(numerics, dt=min(0.01, 0.05 / stiffest))


def _doubts(tails: np.ndarray, statistics: Sequence[str], times: np.ndarray, method: Method) -> list[str]:
    """Where outliers would have carried the mean of the pathwise derivatives away."""
    found = []
    for name, values in zip(statistics, tails, strict=True):
        bad = times[values > EXPLODED]
        if bad.size:
            found.append(
                f"{name} from t = {bad[0]:g}: a few colonies' derivatives are larger than all the others together, "
                "their mean without outliers is biased by an unknown amount"
                + ("; the regression carries these entries" if method == "combined" else ": use the regression")
            )
    return found


def _check(
    parameters: Parameters,
    statistics: Sequence[str],
    free: Sequence[str],
    method: str,
    runs: int,
    paths: int,
    spread: float,
) -> None:
    """Raises `InputError` where an argument makes no sense."""
    for name in free:
        if name not in NAMES:
            raise InputError(f"free holds {name!r}, expected any of {', '.join(NAMES)}")
    if len(set(free)) != len(free) or not free:
        raise InputError(f"free is {list(free)}, it must name at least one parameter, each once")
    for name in NAMES:
        value = getattr(parameters, name)
        if value.shape != () or not value > 0:
            raise InputError(f"{name} is {value}, derivatives in log λ need one number above 0")
    if method not in get_args(Method):
        raise InputError(f"method is {method!r}, it must be one of {', '.join(get_args(Method))}")
    if runs < 16 or runs % 16:
        raise InputError(f"runs is {runs}, it must be a multiple of 16")
    if paths < 4:
        raise InputError(f"paths is {paths}, it must be at least 4")
    if not 0 < spread < 1:
        raise InputError(f"spread is {spread}, it must lie between 0 and 1")
    known = names_with("smooth", "nodes")
    for name in statistics:
        if name not in known:
            raise InputError(f"statistics holds {name!r}, expected any of {', '.join(known)}")
