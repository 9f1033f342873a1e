"""What `yeastfit infer` may be asked for, and what of it each method has by default."""

from dataclasses import dataclass, field, fields
from pathlib import Path
from typing import Any, Literal, get_args

from yeastfit.errors import InputError
from yeastfit.infer.abc_smc import SmcSettings
from yeastfit.infer.distances import KernelName
from yeastfit.infer.emulated_settings import EmulatedSettings
from yeastfit.infer.fit import DEFAULT_FREE
from yeastfit.infer.mcmc_settings import McmcSettings, Move
from yeastfit.infer.pilot import DistanceName
from yeastfit.infer.priors import Prior, default_prior
from yeastfit.infer.settings import MEASUREMENT_ERROR, FitSettings
from yeastfit.infer.space import check_free
from yeastfit.model.parameters import Scales

Method = Literal["emulator", "abc-mcmc", "abc-smc"]
BATCH = 32  # colonies that are grown together
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
    means; None as `FitSettings` has it. reuse: another run's folder, whose colonies serve again: the emulator learns
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
    dt: float = FitSettings.fine_dt
    spacing: float = FitSettings.fine_spacing
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
        return Request(**{"statistics": LI_STATISTICS, **options, **LI, "method": "abc-mcmc", "li": True})

    def the_prior(self) -> Prior:
        """As the file says, or over the plausible ranges."""
        free = check_free(self.free)
        return Prior.read(self.prior, free) if self.prior else default_prior(free, bounded=self.bounded)

    @property
    def bounded(self) -> str:
        """Law of parameters that have a largest value, by default."""
        return "beta" if self.li else "log-uniform"

    def settled(self) -> "dict[str, Any]":
        """The method's settings, by name, with its defaults."""
        chosen = {name: value for name in OWN if (value := getattr(self, name)) is not None}
        return {**DEFAULTS[self.method], **chosen}

    def numerics(self) -> FitSettings:
        """How colonies are grown, and what errors their measured means have."""
        error = MEASUREMENT_ERROR if self.measurement_error is None else self.measurement_error
        return FitSettings(dt=self.dt, spacing=self.spacing, measurement_error=error)

    def configuration(self) -> dict[str, Any]:
        """What makes the run what it is, plain data."""
        other = {*OWN, "seed", "prior", "reuse"}
        plain = {one.name: getattr(self, one.name) for one in fields(self) if one.name not in other}
        fixed = {name: value for name, value in self.fixed.items() if name not in self.free}
        reuse = None if self.reuse is None else str(self.reuse)
        return {**plain, **self.settled(), "fixed": fixed, "prior": self.the_prior().asdict(), "reuse": reuse}


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
