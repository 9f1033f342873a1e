"""What `yeastfit infer` may be asked for, and what of it each method has by default."""

from dataclasses import dataclass, field, fields
from pathlib import Path
from typing import Any, Literal, get_args

import jax.numpy as jnp
import numpy as np

from yeastfit.errors import InputError
from yeastfit.inference.abc.distances import KernelName
from yeastfit.inference.abc.mcmc_settings import McmcSettings, Move
from yeastfit.inference.abc.pilot import DistanceName
from yeastfit.inference.abc.smc import SmcSettings
from yeastfit.inference.colony_simulator import DEFAULT_FREE, Resolution
from yeastfit.inference.neural_likelihood.emulator import fewest
from yeastfit.inference.neural_likelihood.settings import EmulatedSettings
from yeastfit.inference.posterior.prior import Prior, default_prior
from yeastfit.measure.statistics.registry import known_statistics
from yeastfit.model.numerics import Numerics
from yeastfit.model.nutrient import check_alpha
from yeastfit.model.parameters import PARAMETERS, Scales

Method = Literal["emulator", "abc-mcmc", "abc-smc"]
BATCH = 32  # colonies that are grown together
FAR = 0.999  # of a prior: few draws are beyond
OWN = {  # options that only some methods have
    "steps": ("abc-mcmc",),
    "move": ("abc-mcmc",),
    "kernel": ("abc-mcmc",),
    "share": ("abc-mcmc",),
    "walkers": ("abc-mcmc", "emulator"),
    "simulations": ("abc-smc", "emulator"),
    "population": ("abc-smc",),
    "epsilon": ("abc-mcmc", "abc-smc"),
    "distance": ("abc-mcmc", "abc-smc"),
    "pilot": ("abc-mcmc", "abc-smc"),
    "colonies": ("abc-mcmc", "abc-smc"),
}
NAMES = {"epsilon": "tolerance", "share": "pilot-quantile"}
LI = {"distance": "li", "kernel": "indicator", "move": "gaussian", "colonies": 1, "measurement_error": 0.0}
LI_STATISTICS = ("compactness", "radius", "area")


@dataclass(frozen=True)
class Request:
    """What is asked for. Options that are None have the method's default, `settled`.

    li: as Li et al. 2024 did it, see `of`. statistics: curves of the data. fixed: λ of those that are not free.
    epsilon: or else the quantile `share` of the pilot. steps: of each chain, in all; simulations: at most. colonies:
    whose mean is one simulated data set, of ABC; the emulator learns single colonies and takes R of them for the R
    replicates. draws: of the posterior predictive check. dt, spacing: of the model that is meant, as the data sets of
    data/synthetic are made; a coarser one is off in compactness by up to 5 %. measurement_error: relative, of the
    means; None as the registry has it. reuse: another run's folder, whose colonies serve again: the emulator learns
    from all of them, ABC takes those it would grow.
    """

    method: Method = "emulator"
    li: bool = False
    free: tuple[str, ...] = DEFAULT_FREE
    statistics: tuple[str, ...] = ("compactness", "radius")
    condition: str | None = None
    prior: Path | None = None
    fixed: dict[str, float] = field(default_factory=dict)
    distance: DistanceName | None = None
    epsilon: float | None = None
    share: float | None = None
    kernel: KernelName | None = None
    move: Move | None = None
    pilot: int | None = None
    steps: int | None = None
    walkers: int | None = None
    population: int | None = None
    simulations: int | None = None
    colonies: int | None = None
    draws: int = 40
    dt: float = Resolution.dt
    spacing: float = Resolution.spacing
    measurement_error: float | None = None
    reuse: Path | None = None
    rate: float = Scales.rate
    length: float = Scales.length
    seed: int = 0

    def __post_init__(self) -> None:
        if self.method not in get_args(Method):
            raise InputError(f"--method is {self.method!r}, it must be one of {', '.join(get_args(Method))}")
        if self.distance is not None and self.distance not in get_args(DistanceName):
            raise InputError(f"--distance is {self.distance!r}, it must be one of {', '.join(get_args(DistanceName))}")
        for name, methods in OWN.items():
            if getattr(self, name) is not None and self.method not in methods:
                option = NAMES.get(name, name)
                raise InputError(
                    f"--{option} is of --method {' or '.join(methods)}, not of {self.method}: leave it out"
                )
        if self.epsilon is not None and self.share is not None:
            raise InputError("--tolerance and --pilot-quantile are given, need one of the two")
        if self.steps is not None and self.steps < 4:
            raise InputError(f"--steps is {self.steps}, a chain needs at least 4 to be judged")
        for name, least in (("colonies", 1), ("pilot", 2)):
            value = getattr(self, name)
            if value is not None and value < least:
                raise InputError(f"--{name} is {value}, it must be at least {least}")
        known = {*known_statistics("smooth"), *known_statistics("mask")}
        for name in self.statistics:
            if name not in known:
                raise InputError(f"--statistics: {name!r} is unknown, expected some of {', '.join(sorted(known))}")
        self.plan()

    @staticmethod
    def of(li: bool, options: dict[str, Any]) -> "Request":
        """Of options by name. li: with the settings of Li et al. 2024, beside which no others may be given.

        Without statistics in the options, area is one of them, so that colonies must come near the last area observed.
        Without a file of priors, parameters between 0 and 1 have theirs.
        """
        if not li:
            return Request(**options)
        if options["method"] not in (None, "abc-mcmc"):
            raise InputError(f"--li is a way of --method abc-mcmc, not of {options['method']}")
        for name, value in LI.items():
            if options.get(name) not in (None, value):
                raise InputError(f"--{name} is {options[name]}, with --li it is {value}: leave out one of the two")
        chosen: dict[str, Any] = {"statistics": LI_STATISTICS, **options, **LI, "method": "abc-mcmc", "li": True}
        return Request(**chosen)

    def the_prior(self) -> Prior:
        """As the file says, or over the plausible ranges."""
        free = PARAMETERS.subset(self.free).names
        return Prior.read(self.prior, free) if self.prior else default_prior(free, bounded=self.bounded)

    @property
    def bounded(self) -> str:
        """Law of parameters that have a largest value, by default."""
        return "beta" if self.li else "log-uniform"

    def settled(self) -> "dict[str, Any]":
        """The method's settings, by name, with its defaults."""
        chosen = {name: value for name in OWN if (value := getattr(self, name)) is not None}
        settled = {**DEFAULTS[self.method], **chosen}
        if self.method == "emulator":
            settled["first"] = first_round(settled["simulations"], len(self.free))
        return settled

    def plan(self, first: int | None = None) -> EmulatedSettings | McmcSettings | SmcSettings:
        """The sampler's own. first: simulations of the emulator's first round, where it is not the one of `settled`."""
        settings = self.settled()
        if self.method == "emulator":
            first = first or settings["first"]
            most, walkers = settings["simulations"], settings["walkers"]
            return EmulatedSettings(first=first, each=first, most=most, walkers=walkers, batch=min(128, first))
        if self.method == "abc-mcmc":
            other = ("distance", "colonies")
            return McmcSettings(**{name: value for name, value in settings.items() if name not in other})
        chosen = {name: settings[name] for name in ("population", "simulations", "epsilon") if name in settings}
        return SmcSettings(**chosen, batch=BATCH)

    def check_numerics(self) -> None:
        """Raises `InputError` where the prior reaches a diffusivity for which the time step is too long."""
        free, numerics = PARAMETERS.subset(self.free).names, Resolution(self.dt, self.spacing)
        largest = self.fixed.get("diffusivity", PARAMETERS["diffusivity"].default)
        if "diffusivity" in free:
            largest = self.the_prior().quantile(np.full((1, len(free)), FAR))[0, free.index("diffusivity")]
        step = Numerics(domain=100 * numerics.spacing, spacing=numerics.spacing, dt=numerics.dt)
        check_alpha(jnp.asarray(largest, jnp.result_type(float)), step)

    def configuration(self) -> dict[str, Any]:
        """What makes the run what it is, plain data."""
        other = {*OWN, "seed", "prior", "reuse", "li"}
        plain = {one.name: getattr(self, one.name) for one in fields(self) if one.name not in other}
        fixed = {name: value for name, value in self.fixed.items() if name not in self.free}
        reuse = None if self.reuse is None else str(self.reuse)
        return {**plain, **self.settled(), "fixed": fixed, "prior": self.the_prior().asdict(), "reuse": reuse}


def first_round(simulations: int, free: int) -> int:
    """`EmulatedSettings.first`; where few are allowed, half of them, or more where a quadratic needs more."""
    most = 2 ** int(np.log2(max(simulations, 4)))  # powers of two, all of them
    needed = 2 ** int(np.ceil(np.log2(2 * fewest(free, 0, EmulatedSettings().emulator))))
    return min(EmulatedSettings.first, max(most // 2, min(most, needed)))


DEFAULTS: dict[str, dict[str, Any]] = {
    "emulator": {"simulations": EmulatedSettings.most, "walkers": EmulatedSettings.walkers},
    "abc-mcmc": {
        **{"distance": "mahalanobis", "share": McmcSettings.share, "kernel": "indicator", "move": "gaussian"},
        **{"pilot": McmcSettings.pilot, "steps": McmcSettings.steps, "walkers": BATCH, "colonies": 1},
    },
    "abc-smc": {
        **{"distance": "mahalanobis", "pilot": McmcSettings.pilot, "colonies": 1},
        **{"population": SmcSettings.population, "simulations": 20_000},
    },
}
