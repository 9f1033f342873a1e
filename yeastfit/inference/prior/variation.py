"""Colonies whose parameters scatter about those of their condition.

    y(λ_r) = y(λ) + τ ξ_r,   ξ_r ~ N(0, 1);   y = log λ, of a parameter between two bounds log (λ − a) / (b − λ)

λ is the condition's, λ_r that of colony r. y is a logarithm where λ is only positive, so that τ is a relative scatter,
and a logit where λ lies between two bounds, as a probability does, so that no λ_r leaves them; a logit is a logarithm
for small probabilities. There is one τ for all free parameters: between-colony covariances of so few colonies do not
tell the parameters' own apart (`docs/variation.md` has the numbers). Where some alone are named (`varying`), it is
theirs, and all others are the condition's. Held parameters do not scatter, nor do those that all colonies share
(`Parameter.shared`): the camera is the same for all.

**Prior of τ.** 0 with probability `zero`, otherwise |N(0, sd²)|: half a chance that colonies differ by the model's own
chance alone, and a scatter of 30 % where they do not (the spike and the slab of Mitchell & Beauchamp 1988,
doi:10.1080/01621459.1988.10478694). Chains walk in z ~ N(0, 1) before the data, of which τ is an increasing function,
0 up to Φ(z) = zero; in z the posterior has a continuous density.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import equinox as eqx
import numpy as np
import scipy
from jaxtyping import Array, Float

from yeastfit.errors import InputError
from yeastfit.inference.prior.distributions import Distribution, SpikeHalfNormal
from yeastfit.inference.prior.places import Places
from yeastfit.inference.prior.prior import Prior, Table
from yeastfit.inference.simulator import Rows, Seeds, Simulator, Values, Wrapper
from yeastfit.kinds import check_list
from yeastfit.parameter_set import Parameter, ParameterSet
from yeastfit.seeds import Stream, stream_of
from yeastfit.text import quoted

NAME = "colony_variation"
LARGEST = 10.0  # standard deviation of log λ that a prior of the scatter may have
TAU = Parameter(
    NAME,
    "τ",
    "standard deviation between colonies of the logarithm of every parameter that varies, of the logit of bounded ones",
    (0.0, 1.0),
    0.0,
)


@dataclass(frozen=True)
class Variation:
    """That λ scatters between colonies, with the prior of its scatter τ.

    Attributes:
        zero: Probability that τ is 0.
        sd: Of the half-normal distribution of τ where it is not.
        varying: Names of the parameters that scatter; by default all free ones that colonies do not share.

    Raises:
        InputError: `zero` is no probability below 1, `sd` not above 0 and at most `LARGEST`, or `varying` is no list.
    """

    zero: float = 0.5
    sd: float = 0.3
    varying: Sequence[str] = ()

    def __post_init__(self) -> None:
        check_list("varying", self.varying)
        object.__setattr__(self, "varying", tuple(self.varying))
        try:
            _ = self.prior
        except InputError as error:
            raise InputError(f"variation: {error}") from None
        if self.sd > LARGEST:
            raise InputError(f"variation: sd is {self.sd:g}, it must be at most {LARGEST:g}, a factor of e^{LARGEST:g}")

    @property
    def prior(self) -> Distribution:
        """Of τ."""
        return Distribution("spike-half-normal", {"zero": self.zero, "sd": self.sd})

    def joined(self, prior: Prior) -> Prior:
        """A prior of λ, and that of τ as the last one."""
        return Prior({**prior.distributions, NAME: self.prior})

    def tau(self, z: Float[np.ndarray, "*any"]) -> Float[np.ndarray, "*any"]:
        """τ of z."""
        return SpikeHalfNormal(self.zero, self.sd).isf(scipy.special.ndtr(-np.asarray(z, dtype=float)))


class ColonyCoordinates(eqx.Module):
    """y of λ, by NumPy or JAX, whichever λ is an array of.

    Attributes:
        low: Smallest admissible λ.
        width: Of the admissible range; inf where there is no largest λ.
        shared: Which λ are the same in all colonies.
    """

    low: Float[np.ndarray | Array, " free"]
    width: Float[np.ndarray | Array, " free"]
    shared: tuple[bool, ...] = eqx.field(static=True)

    @staticmethod
    def of(parameters: ParameterSet, varying: Sequence[str] = ()) -> "ColonyCoordinates":
        """Of the free parameters.

        Arguments:
            parameters: In order.
            varying: Names of those that scatter; all that colonies do not share where there are none.

        Raises:
            InputError: One that scatters may be negative and has no bounds on both sides; none scatters; or a name is
                of no free parameter, or of one that all colonies share.
        """
        own = [one.name for one in parameters.values() if not one.shared]
        for name in varying:
            if name not in parameters:
                raise InputError(f"varying names {quoted(name)}, which is not free: need some of {', '.join(own)}")
            if name not in own:
                raise InputError(f"varying names {name}, which all colonies share: need some of {', '.join(own)}")
        scattering = [parameters[name] for name in varying or own]
        if not scattering:
            raise InputError(
                f"variation: all colonies share {', '.join(parameters.names)}: free a parameter of growth, too, or "
                "leave it out"
            )
        for one in scattering:
            if not (one.smallest >= 0 or (math.isfinite(one.smallest) and math.isfinite(one.largest))):
                raise InputError(
                    f"variation: {one.name} may be {one.limits}: need parameters that are above 0 or between two "
                    "bounds, hold it"
                )
        low, high = np.array([(one.smallest, one.largest) for one in parameters.values()]).T
        return ColonyCoordinates(low, high - low, tuple(one not in scattering for one in parameters.values()))

    @property
    def pairs(self) -> int:
        """q: places `around` λ lie at most √q τ from it in each y, each with the share 1 / 2 q of its colonies."""
        return max(self.shared.count(False), 3)

    def moved(self, values: Float[Table, "*row free"], step: Float[Table, "*rows free"]) -> Float[Table, "*rows free"]:
        """λ of y + step; what lies on a bound, or is shared, stays there."""
        library, above = values.__array_namespace__(), values - self.low
        with np.errstate(over="ignore", invalid="ignore"):  # of steps beyond 709, which no density allows
            part = above / self.width  # 0 where there is no largest λ
            moved = self.low + above * library.exp(step) / (1.0 - part + part * library.exp(step))
        return library.where(np.array(self.shared), values, moved) if any(self.shared) else moved

    def around(self, values: Float[Table, "row free"], tau: Float[Table, " row"]) -> Places[Table]:
        """Places around each λ, over which any cubic in y has the mean that it has over colonies of this scatter.

        They are y ± √q τ e_k of the d parameters that scatter, with a share of 1 / 2 q each, and y itself with the rest
        of 1 − d / q where that is something; q = max(d, 3). From three parameters on that is spherical cubature
        (Arasaratnam & Haykin 2009, doi:10.1109/TAC.2009.2019800). Of fewer, it is the unscented transform (Julier &
        Uhlmann 2004, doi:10.1109/JPROC.2003.823141), and the mean of each y⁴ is right, too. The prior of a share may
        end before the places do: an emulator takes it for that at the prior's end.
        """
        axes = math.sqrt(self.pairs) * np.eye(len(self.shared))[~np.array(self.shared)]
        steps, shares = np.concatenate([axes, -axes]), np.full(2 * len(axes), 0.5 / self.pairs)
        if len(axes) < self.pairs:
            steps = np.concatenate([steps, np.zeros((1, len(self.shared)))])
            shares = np.append(shares, 1.0 - len(axes) / self.pairs)
        return Places(self.moved(values[:, None], tau[:, None, None] * steps), shares)


@dataclass(frozen=True)
class Varied(Wrapper):
    """A simulator of colonies whose λ scatter; the last of its parameters is τ.

    Attributes:
        varying: Names of the parameters that scatter; all that colonies do not share where there are none.
    """

    varying: tuple[str, ...] = ()

    @property
    def parameters(self) -> ParameterSet:
        """The free parameters, and τ."""
        return ParameterSet((*self.simulator.parameters.parameters, TAU))

    @property
    def names(self) -> tuple[str, ...]:
        """All parameters, free and held, and τ."""
        return (*super().names, NAME)

    def scattered(self, values: Float[np.ndarray, "row free_and_tau"], seeds: Seeds) -> Float[np.ndarray, "row free"]:
        """λ_r of every row of λ and τ, by the seed of the row."""
        streams = [np.random.default_rng(stream_of(int(seed), Stream.COLONIES, 0)) for seed in seeds]
        normal = np.array([one.standard_normal(values.shape[1] - 1) for one in streams])
        coordinates = ColonyCoordinates.of(self.simulator.parameters, self.varying)
        return coordinates.moved(values[:, :-1], values[:, -1:] * normal.reshape(len(values), -1))

    def __call__(self, values: Values, seeds: Seeds) -> Rows:
        """Rows of the simulator inside, at the scattered λ."""
        return self.simulator(self.scattered(values, seeds), seeds)


def simulator_of_draws(simulator: Simulator, free: Sequence[str], varying: tuple[str, ...] = ()) -> Simulator:
    """The simulator that takes draws of a posterior: with colonies that scatter where τ is one of its parameters.

    Arguments:
        simulator: Of one colony.
        free: Names of the posterior's parameters.
        varying: Names of those that scatter, as of `Varied`.

    Raises:
        InputError: The simulator has other parameters.
    """
    names, found = simulator.parameters.names, tuple(free)
    if found not in (names, (*names, NAME)):
        raise InputError(f"simulator is of {', '.join(names)}, the posterior of {', '.join(found)}")
    return simulator if found == names else Varied(simulator, varying)


def absent(posterior: Any) -> float | None:
    """Probability that τ is 0, of a posterior; None where τ is no parameter of it."""
    if NAME not in posterior.free:
        return None
    return float(posterior.weights.ravel() @ (posterior.flat[:, posterior.free.index(NAME)] == 0.0))
