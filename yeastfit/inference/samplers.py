"""Methods of sampling posteriors by name, and the one function that runs any of them.

`SAMPLERS` maps names to classes. A new method is one class with settings as fields and a `run` (`Sampler`), and one
entry here or, from outside the package, `yeastfit.SAMPLERS["name"] = Class`; Python and command line then know it.
"""

import time
from collections.abc import Mapping, Sequence
from dataclasses import fields, is_dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float

from yeastfit.errors import InputError
from yeastfit.inference.abc.mcmc import AbcMcmc
from yeastfit.inference.abc.smc import AbcSmc
from yeastfit.inference.neural_likelihood.sequential import SequentialEmulator
from yeastfit.inference.posterior.diagnostics import plain
from yeastfit.inference.posterior.limits import Limits
from yeastfit.inference.posterior.problem import Problem
from yeastfit.inference.posterior.result import Posterior
from yeastfit.inference.posterior.sampler import Sampler
from yeastfit.inference.prior.prior import Prior
from yeastfit.inference.prior.variation import Variation
from yeastfit.inference.simulator import Simulator
from yeastfit.inference.store.simulation_store import opened_store
from yeastfit.inference.store.simulations import Simulations
from yeastfit.inference.targets import Targets
from yeastfit.progress import Progress, progress_or_silent
from yeastfit.storage import as_json
from yeastfit.text import quoted

SAMPLERS: dict[str, type[Sampler]] = {
    "emulator": SequentialEmulator,
    "abc-mcmc": AbcMcmc,
    "abc-smc": AbcSmc,
}


def infer(
    simulator: Simulator,
    prior: Prior,
    observed: Targets | Float[np.ndarray, " statistic"] | Float[np.ndarray, "replicate statistic"] | Sequence[float],
    *,
    method: str | Sampler = "emulator",
    replicates: int = 1,
    noise: Float[np.ndarray, "statistic statistic"] | None = None,
    colony_noise: Float[np.ndarray, "statistic statistic"] | None = None,
    variation: Variation | None = None,
    limits: Limits | None = None,
    seed: int = 0,
    store: Simulations | str | Path | None = None,
    progress: Progress | None = None,
    **settings: Any,
) -> Posterior:
    """Sample the posterior of a simulator's parameters.

        p(λ | o) ∝ π(λ) p(o | λ),    o the mean of `replicates` simulations, with errors of covariance `noise`

    Arguments:
        simulator: Simulates one replicate per row of parameters (`Simulator`).
        prior: Of the simulator's parameters; `Prior.default(simulator.parameters)` covers their plausible ranges.
        observed: Statistics in the order of the simulator's observables; or one row of them for each replicate, nan
            where one is missing; or `Targets`, which bring their own replicates and errors of measurement.
        method: Name in `SAMPLERS` ("emulator", "abc-mcmc", "abc-smc"), or a sampler with its settings.
        replicates: How many replicates `observed` is the mean of. Where it is above 1, ABC by name compares means of as
            many; of targets it compares single replicates by default, which gives a wider posterior: give it here, or
            `replicates` of its settings.
        noise: Covariance of the errors of measurement of `observed`, which replicates do not average out.
        colony_noise: Covariance of the errors of measurement that every replicate has for itself; the likelihood of
            single replicates needs it, in means the scatter of replicates holds them.
        variation: That parameters scatter between replicates, by a τ which is inferred beside them (`Variation`); the
            likelihood is then that of the single replicates. By default all have the same parameters.
        limits: Least and largest value of each statistic, a row each, with all single replicates of the data between
            them. To a likelihood that is learnt, a simulation beyond counts as one that failed, which is exact whatever
            they are, and keeps rare ones far from all others from widening it.
        seed: Same seed, same posterior.
        store: Where simulations are kept: a path, or an open `Store`. A run that was stopped is resumed by repeating it
            with the same store. By default they are kept in memory. A file of another simulator is refused, and so is
            an open store that another one has used, as far as simulators say what decides over a simulation: one of
            your own by an attribute `about`, any text.
        progress: Called with what is being done and the share that is done.
        **settings: Of the method, where it is given by name.

    Returns:
        Draws with their status, diagnostics and warnings. It raises nothing where the posterior has not settled:
        see `Posterior.status`.

    Raises:
        InputError: An argument is wrong, arguments do not belong together, or no simulation succeeds.
    """
    rest: dict[str, Any] = {"colony_noise": colony_noise, "variation": variation, "limits": limits}
    problem = Problem.of(simulator, prior, observed, replicates, noise, **rest)
    sampler = chosen_sampler(method, {**replicates_of(method, replicates), **settings})
    progress = progress_or_silent(progress)
    with opened_store(store, simulator) as simulations:
        return sample(problem, sampler, simulations, seed, progress)


def sample(problem: Problem, sampler: Sampler, store: Simulations, seed: int, progress: Progress) -> Posterior:
    """`infer` for a problem and a sampler that are made already."""
    check_variation(sampler, problem.variation)
    settings = settings_of(sampler)
    began = time.perf_counter()
    posterior = sampler.run(problem, store, seed, progress)
    seconds = time.perf_counter() - began
    if not isinstance(posterior, Posterior):
        raise InputError(
            f"method: {type(sampler).__name__}.run returned {quoted(posterior)}, it must return a Posterior"
        )
    return replace(posterior, method=name_of(sampler), settings=settings, seed=int(seed), seconds=seconds)


def chosen_sampler(method: str | Sampler, settings: Mapping[str, Any]) -> Sampler:
    """A sampler by name with its settings, or the one that is given.

    Raises:
        InputError: It is neither, has no such setting, or settings are given beside a sampler.
    """
    if isinstance(method, str):
        return sampler_of(method, settings)
    if isinstance(method, type) or not callable(getattr(method, "run", None)):
        what = f"the class {method.__name__}: write {method.__name__}()" if isinstance(method, type) else "no sampler"
        raise InputError(f"method is {quoted(method)}, {what}; it must be a name or an object with a method run")
    if settings:
        raise InputError(f"settings {', '.join(settings)} are given beside a sampler, which has its own")
    return method


def replicates_of(method: str | Sampler, replicates: int) -> dict[str, int]:
    """The setting by which a method given by name compares means of so many replicates, where it has one."""
    has = isinstance(method, str) and method in SAMPLERS and is_dataclass(SAMPLERS[method])
    return {"replicates": replicates} if has and replicates > 1 and "replicates" in setting_names(str(method)) else {}


def sampler_of(method: str, settings: Mapping[str, Any]) -> Sampler:
    """A registered sampler with its settings.

    Raises:
        InputError: The method is unknown, or does not have such a setting.
    """
    if method not in SAMPLERS:
        raise InputError(f"method is {method!r}, it must be one of {', '.join(SAMPLERS)}")
    if not isinstance(SAMPLERS[method], type) or not is_dataclass(SAMPLERS[method]):
        raise InputError(f"method {method!r} is registered as {quoted(SAMPLERS[method])}, it must be a dataclass")
    if not callable(getattr(SAMPLERS[method], "run", None)):
        raise InputError(f"method {method!r} is registered as {quoted(SAMPLERS[method])}, which has no method run")
    for name in settings:
        if name not in setting_names(method):
            owners = [other for other in SAMPLERS if name in setting_names(other)]
            if owners:
                raise InputError(f"{name} is a setting of {' and '.join(owners)}, not of {method}: leave it out")
            has = ", ".join(setting_names(method))
            raise InputError(f"{name} is no setting of any method: leave it out, {method} has {has}")
    return SAMPLERS[method](**settings)


def check_variation(sampler: Sampler, variation: Variation | None) -> None:
    """Raise `InputError` where parameters may scatter between colonies and a sampler does not know of that."""
    if variation is not None and not getattr(sampler, "varies", False):
        able = ", ".join(name for name, kind in SAMPLERS.items() if getattr(kind, "varies", False))
        raise InputError(
            f"variation: {name_of(sampler)} takes all colonies for those of one λ: leave it out, or use {able}"
        )


def setting_names(method: str) -> tuple[str, ...]:
    """Names of a registered method's settings."""
    return tuple(one.name for one in fields(SAMPLERS[method]))  # type: ignore[arg-type]


def settings_of(sampler: Sampler) -> dict[str, Any]:
    """A sampler's settings as plain data: its fields, of a sampler that is no dataclass its public attributes.

    Raises:
        InputError: A setting is something that files cannot hold.
    """
    given = [one.name for one in fields(sampler)] if is_dataclass(sampler) else [*getattr(sampler, "__dict__", {})]
    found = {name: plain(getattr(sampler, name)) for name in given if not name.startswith("_")}
    for name, value in found.items():
        try:
            as_json(value)
        except (TypeError, ValueError):
            raise InputError(
                f"method: {name} of {type(sampler).__name__} is {quoted(value)}, which files cannot hold: take numbers "
                "or texts"
            ) from None
    return found


def name_of(sampler: Sampler) -> str:
    """Its name in `SAMPLERS`, or that of its class where it is not registered."""
    names = [name for name, kind in SAMPLERS.items() if kind is type(sampler)]
    return names[0] if names else type(sampler).__name__
