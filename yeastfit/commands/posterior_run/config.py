"""What `yeastfit infer` is asked for."""

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, fields
from pathlib import Path
from typing import Any

import numpy as np

from yeastfit.errors import InputError
from yeastfit.inference.models.forward_model import ForwardModel
from yeastfit.inference.models.registry import DEFAULT, model_named
from yeastfit.inference.neural_likelihood.sequential import SequentialEmulator
from yeastfit.inference.neural_likelihood.training import fewest
from yeastfit.inference.posterior.predictive_check import FEWEST
from yeastfit.inference.posterior.sampler import Sampler
from yeastfit.inference.prior.prior import Bounded, Prior
from yeastfit.inference.prior.variation import ColonyCoordinates, Variation
from yeastfit.inference.samplers import SAMPLERS, check_variation, name_of, sampler_of, settings_of
from yeastfit.memory import check_count
from yeastfit.parameter_set import ParameterSet

FAR = 0.999  # cumulative probability of a prior beyond which there are few draws
MADE_LAST = ("draws", "prior_draws", "leave_out")  # say what is made of a posterior, and leave it as it is
LI = {"distance": "li", "kernel": "indicator", "move": "gaussian", "replicates": 1}  # settings of Li et al. 2024


@dataclass(frozen=True)
class Request:
    """What is asked for, checked.

    Attributes:
        sampler: Method, with its settings.
        model: Name in `FORWARD_MODELS`.
        forward_model: The model with its settings; by default with those that `infer` has by default.
        free: Names of the free parameters; by default the model's.
        fixed: Values of others, by name.
        statistics: Curves of the data; by default the model's.
        condition: Whose replicates are the data; may be left out where there is one.
        prior: File; by default the plausible ranges.
        bounded: Distribution of parameters that have a largest value, in the default prior.
        draws: Of the posterior predictive check.
        prior_draws: Data sets predicted from the prior, for ArviZ's file.
        measurement_error: Relative, of the means; by default as the registry of statistics has it.
        variation: That parameters scatter between colonies.
        leave_out: Groups into which colonies are dealt, each left out once and predicted by the others; 0 for none.
        reuse: Folder of another run whose simulations are used again.
        seed: Same seed, same posterior.

    Raises:
        InputError: A name is unknown, or a value not admissible.
    """

    sampler: Sampler = field(default_factory=lambda: SAMPLERS["emulator"]())
    model: str = DEFAULT
    forward_model: ForwardModel = None  # type: ignore[assignment]
    free: tuple[str, ...] = ()
    fixed: Mapping[str, float] = field(default_factory=dict)
    statistics: tuple[str, ...] = ()
    condition: str | None = None
    prior: Path | None = None
    bounded: Bounded = "log-uniform"
    draws: int = 40
    prior_draws: int = 40
    measurement_error: float | None = None
    variation: Variation | None = None
    leave_out: int = 0
    reuse: Path | None = None
    seed: int = 0

    def __post_init__(self) -> None:
        check_count("draws", self.draws)
        check_count("prior_draws", self.prior_draws)
        try:
            check_variation(self.sampler, self.variation)
        except InputError as error:
            raise InputError(f"--{error}") from None
        if self.prior_draws and self.prior_draws < FEWEST:
            raise InputError(f"--prior-draws is {self.prior_draws}, it must be 0 or at least {FEWEST}")
        if self.leave_out < 0 or self.leave_out == 1:
            raise InputError(f"--leave-out is {self.leave_out}, it must be 0, or 2 groups of colonies at least")
        kind = model_named(self.model)
        forward = kind() if self.forward_model is None else self.forward_model
        object.__setattr__(self, "forward_model", forward)
        object.__setattr__(self, "statistics", forward.statistics_named(self.statistics or forward.statistics))
        forward.parameters.check(self.fixed)
        forward.parameters.subset(self.free or forward.free)
        if self.variation is not None:
            try:
                ColonyCoordinates.of(self.parameters, self.variation.varying)
            except InputError as error:
                raise InputError(f"--{error}") from None
        self.check_sampler(len(self.statistics))

    def check_sampler(self, values: int) -> None:
        """Check that the method can do with so many parameters and compared values, before there are any.

        Raises:
            InputError: A setting of it does not suit them.
        """
        free, check = len(self.parameters), getattr(self.sampler, "check", None)
        if check is not None and self.reuse is None:  # how many simulations another run has is not known yet
            check(free, free + (self.variation is not None), values)
        most = getattr(self.sampler, "simulations_at_most", None)
        if self.leave_out and most is not None and not getattr(self.sampler, "learns", False):
            least = fewest(free, values, SequentialEmulator().training)
            if most < least:
                raise InputError(
                    f"--leave-out trains an emulator, of at least {least} simulations, and {name_of(self.sampler)} "
                    f"makes at most {most}: allow more, or leave it out"
                )

    @staticmethod
    def of(method: str, settings: Mapping[str, Any], **rest: Any) -> "Request":
        """With a method by name and its settings."""
        return Request(sampler=sampler_of(method, settings), **rest)

    @staticmethod
    def of_li(method: str | None, settings: Mapping[str, Any], **rest: Any) -> "Request":
        """With the settings of Li et al. 2024, beside which no others may be given.

        Unless `statistics` says otherwise, area is one of them, so that simulations must come near the last area
        observed. Without a file of priors, parameters that have a largest value have a beta prior.

        Raises:
            InputError: Another method or another value of one of these settings is asked for.
        """
        if method not in (None, "abc-mcmc"):
            raise InputError(f"--li is a way of --method abc-mcmc, not of {method}")
        if rest.get("variation") is not None:
            raise InputError("--variation is given, with --li all colonies have the same parameters: leave out one")
        for name, value in {**LI, "measurement_error": 0.0}.items():
            other = rest.get(name, settings.get(name))
            if other not in (None, value):
                raise InputError(f"{name} is {other}, with --li it is {value}: leave out one of the two")
        chosen = {**rest, "measurement_error": 0.0, "bounded": "beta"}
        model = model_named(rest.get("model", DEFAULT))
        chosen["statistics"] = rest.get("statistics") or model.of_li or model.designed
        return Request(sampler=sampler_of("abc-mcmc", {**settings, **LI}), **chosen)

    @property
    def parameters(self) -> ParameterSet:
        """The free parameters."""
        return self.forward_model.parameters.subset(self.free or self.forward_model.free)

    @property
    def held(self) -> dict[str, float]:
        """Values of all parameters that act and are not free."""
        return self.forward_model.held(self.statistics, self.parameters.names, self.fixed)

    def the_prior(self) -> Prior:
        """As the file says, or over the plausible ranges."""
        if self.prior:
            return Prior.read(self.prior, self.parameters)
        return self.forward_model.prior(self.parameters, bounded=self.bounded)

    def largest(self) -> dict[str, float]:
        """All parameters, those that are free as large as few draws of the prior are."""
        prior = self.the_prior()
        far = prior.quantile(np.full((1, len(prior.free)), FAR))[0]
        return self.held | dict(zip(prior.free, far.tolist(), strict=True))

    def resolved_sampler(self) -> Sampler:
        """The sampler with all its settings."""
        resolved = getattr(self.sampler, "resolved", None)
        return self.sampler if resolved is None else resolved(len(self.parameters))

    @property
    def open_settings(self) -> tuple[str, ...]:
        """Settings that were left open and that the sampler decides; a resumed run keeps them."""
        before, after = settings_of(self.sampler), settings_of(self.resolved_sampler())
        return tuple(name for name in before if before[name] is None and after[name] is not None)

    def configuration(self) -> dict[str, Any]:
        """What makes the run what it is, plain data."""
        named = ("model", "statistics", "condition", "draws", "prior_draws", "measurement_error", "leave_out")
        return {
            "method": name_of(self.sampler),
            **{one.name: getattr(self, one.name) for one in fields(self) if one.name in named},
            "free": self.parameters.names,
            "settings": settings_of(self.resolved_sampler()),
            "fixed": self.held,
            "prior": self.the_prior().asdict(),
            **self.forward_model.settings("infer"),
            **({} if self.variation is None else {"variation": _plain(self.variation)}),
            "reuse": None if self.reuse is None else str(self.reuse),
        }


def _plain(variation: Variation) -> dict[str, Any]:
    """Its attributes; names of what scatters where some parameters alone do."""
    return {name: one for name, one in asdict(variation).items() if one != ()}
