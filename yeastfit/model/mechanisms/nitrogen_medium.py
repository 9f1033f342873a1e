"""Two nutrients: carbon, along which nodes drift, and nitrogen, which a dish may run out of (source 5.1.2).

    ∂c/∂t = λ1 ∇²c − b c,    c = 1 at the start
    ∂n/∂t = D_N ∇²n − r_N max(−g, 0) n,    n = ν at the start

Growth is by the scarcer of the two (Liebig), min(c, n) at a node; relaxed, the mean of both with weights e^(−c/w) and
e^(−n/w). Drift is λ5 ∇c + γ_N ∇n. The boundary of either is a `dish`, through which nothing passes, so that what is
eaten is gone, or a `reservoir` at c = 1, n = ν: a dish for nitrogen and a reservoir for carbon, unless said otherwise.
Fields hold n / ν, which the amount ν = `nitrogen` does not change. With ν = 1, D_N = λ1, r_N = λ6 and reservoirs, the
two nutrients are one: the source.

A birth takes q_N = `nitrogen_per_birth` from the dish, everywhere in proportion to what is there,

    n ← n (1 − q_N B / ∫n dx),    B ≤ ∫n dx / q_N,

as ammonium spreads by √(4 D t) = 1000 L0 in a cell cycle (D = 1.9e-9 m²/s in water). Children that there is no nitrogen
for are not born, those of the best fed mothers first; their mothers wait. So ∫n dx + q_N (children) is constant where
r_N = 0. With q_N = 0 births are free.

What q_N is: a diploid cell has 20 pg of dry mass (Sherman 2002, Methods Enzymol. 350:3), 8 % of it nitrogen (Lange &
Heijnen 2001, Biotechnol. Bioeng. 75:334), so 0.11 pmol. 50 µM ammonium sulphate has that below 5 L0² of agar 4 mm deep,
or below 15 L0² for a node that stands for three cells above one another. Ammonium limits growth below some 10 µM (Km of
Mep1, Marini et al. 1997, Mol. Cell. Biol. 17:4282): with that for c0, 50 µM are ν = 10, and q_N is 50 to 150.
"""

import dataclasses
from typing import ClassVar

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from yeastfit.model.active_window import extent_of_change, with_window
from yeastfit.model.cells import Cells
from yeastfit.model.colony import Colony
from yeastfit.model.interpolation import gradient_at, nutrient_at
from yeastfit.model.laws.medium import STEPS, Boundary, check_boundary, nutrient_of_step, where_cells_are
from yeastfit.model.laws.uptake import biomass
from yeastfit.model.numerics import Numerics
from yeastfit.model.nutrient import FASTEST
from yeastfit.model.parameters import Parameters
from yeastfit.model.relaxation import Relaxation
from yeastfit.model.rules import Births, Context, MediumRule, UptakeRule
from yeastfit.parameter_set import Parameter

WIDTH = 0.02  # w, of the relaxed minimum
NITROGEN = Parameter("nitrogen", "ν", "nitrogen at the start, in units of c0", (0.01, 100.0), 1.0, positive=True)
NITROGEN_DIFFUSIVITY = Parameter(
    "nitrogen_diffusivity", "D_N", "diffusion of nitrogen, over μ* L0²", (0.01, 10.0), 0.1, largest=FASTEST
)
NITROGEN_UPTAKE = Parameter("nitrogen_uptake", "r_N", "uptake of nitrogen, over μ*", (0.05, 20.0), 1.0)
NITROGEN_MOBILITY = Parameter("nitrogen_mobility", "γ_N", "drift along nitrogen's gradient", (0.02, 20.0), 0.0)
NITROGEN_PER_BIRTH = Parameter("nitrogen_per_birth", "q_N", "nitrogen of a birth, over c0", (1.0, 500.0), 0.0, "L0²")


class NitrogenMedium(MediumRule):
    """Carbon and nitrogen. Differentiable in all parameters.

    Attributes:
        boundary: What is at the edge for nitrogen: the wall of a "dish", or a "reservoir" that never runs out.
        carbon_boundary: What is at the edge for carbon, a "dish" or a "reservoir".

    Raises:
        InputError: A boundary is neither of the two.
    """

    name: ClassVar[str] = "nitrogen"
    parameters: ClassVar[tuple[Parameter, ...]] = (
        NITROGEN,
        NITROGEN_DIFFUSIVITY,
        NITROGEN_UPTAKE,
        NITROGEN_MOBILITY,
        NITROGEN_PER_BIRTH,
    )
    boundary: Boundary = eqx.field(static=True, default="dish")
    carbon_boundary: Boundary = eqx.field(static=True, default="reservoir")

    def __check_init__(self) -> None:
        check_boundary("boundary", self.boundary)
        check_boundary("carbon_boundary", self.carbon_boundary)

    def fields(self) -> dict[str, float]:
        """Nitrogen, as a share of that at the start."""
        return {"nitrogen": 1.0}

    def stepped(self, context: Context, cells: Cells, uptake: UptakeRule) -> Colony:
        """Both nutrients one step later."""
        colony, spacing = context.colony, context.numerics.spacing

        def law(window: slice, g: Array, carbon: Array, nitrogen: Array) -> tuple[Array, Array]:
            fed = nutrient_of_step(context, uptake, g, carbon[window, window], STEPS[self.carbon_boundary])
            left = self._left(context, g, nitrogen[window, window])
            return with_window(carbon, window, fed), with_window(nitrogen, window, left)

        fields = colony.nutrient, colony.medium["nitrogen"]
        change = jnp.maximum(jnp.abs(1.0 - fields[0]), jnp.abs(eaten_nitrogen(context)))
        carbon, nitrogen = where_cells_are(context, cells, extent_of_change(change, spacing), law, *fields)
        return dataclasses.replace(colony, nutrient=carbon, medium={**colony.medium, "nitrogen": nitrogen})

    def nitrogen_left(self, context: Context, cells: Cells) -> Float[Array, "x y"]:
        """Nitrogen alone one step later."""

        def law(window: slice, g: Array, nitrogen: Array) -> Array:
            return with_window(nitrogen, window, self._left(context, g, nitrogen[window, window]))

        extent = extent_of_change(eaten_nitrogen(context), context.numerics.spacing)
        return where_cells_are(context, cells, extent, law, context.colony.medium["nitrogen"])

    def _left(self, context: Context, g: Float[Array, "w w"], nitrogen: Float[Array, "w w"]) -> Float[Array, "w w"]:
        """n on a window one step later, given the level set there."""
        rate = biomass(g, context.parameters["nitrogen_uptake"])
        return STEPS[self.boundary](nitrogen, rate, context.parameters["nitrogen_diffusivity"], context.numerics)

    def supply(
        self, colony: Colony, parameters: Parameters, relaxation: Relaxation, numerics: Numerics
    ) -> Float[Array, " node"]:
        """The scarcer one."""
        carbon, nitrogen = nutrient_at(colony, numerics), nutrient_at(with_nitrogen_alone(colony), numerics)
        return scarcer(carbon, parameters["nitrogen"] * nitrogen, relaxation)

    def afforded(self, context: Context, births: Births) -> tuple[Colony, Births]:
        """Births for which the dish holds nitrogen, in order, and the dish without it."""
        colony, parameters, cost = context.colony, context.parameters, context.parameters["nitrogen_per_birth"]
        field, edge = colony.medium["nitrogen"], 0 if self.boundary == "dish" else 1
        inside = slice(edge, context.numerics.points - edge)
        share = field[inside, inside]
        far = share[0, 0]  # by differences, as a sum of a million equal numbers has their last bits wrong
        mean = far + jnp.mean(share - far)
        held = parameters["nitrogen"] * share.size * context.numerics.spacing**2 * mean
        enough = held / jnp.where(cost > 0, cost, 1.0)
        enough = jnp.floor(enough) if context.relaxation.births == "whole" else enough
        before = jnp.cumsum(births.weights) - births.weights
        weights = jnp.where(cost > 0, jnp.clip(enough - before, 0.0, births.weights), births.weights)
        births = _without(births, colony, weights)
        room = colony.parents.shape[0] - colony.count
        born = jnp.sum(jnp.where(jnp.cumsum(weights > 0) <= room, weights, 0.0))
        left = with_window(field, inside, share * (1.0 - cost * born / jnp.where(held > 0, held, 1.0)))
        return dataclasses.replace(colony, medium={**colony.medium, "nitrogen": left}), births

    def drift(self, context: Context) -> Float[Array, "node 2"]:
        """λ5 ∇c + γ_N ∇n."""
        parameters = context.parameters
        along = gradient_at(with_nitrogen_alone(context.colony), context.numerics)
        strength = parameters["nitrogen_mobility"] * parameters["nitrogen"]
        return parameters.mobility * context.local_gradient() + strength * along


def eaten_nitrogen(context: Context) -> Float[Array, "x y"]:
    """By how much cells have lowered nitrogen: births lower it where no cells are, too, and everywhere alike."""
    nitrogen = context.colony.medium["nitrogen"]
    return jnp.where(context.parameters["nitrogen_per_birth"] > 0, nitrogen[0, 0], 1.0) - nitrogen


def scarcer(
    carbon: Float[Array, " node"], nitrogen: Float[Array, " node"], relaxation: Relaxation
) -> Float[Array, " node"]:
    """The smaller of both."""
    if relaxation.births == "whole":
        return jnp.minimum(carbon, nitrogen)
    share = jax.nn.sigmoid((nitrogen - carbon) / WIDTH)
    return share * carbon + (1.0 - share) * nitrogen


def with_nitrogen_alone(colony: Colony) -> Colony:
    """The colony as if nitrogen were its nutrient."""
    return dataclasses.replace(colony, nutrient=colony.medium["nitrogen"])


def _without(births: Births, colony: Colony, weights: Float[Array, " node"]) -> Births:
    """Births of other weights; who is refused a child keeps its state."""
    waits = jnp.zeros_like(weights, bool).at[births.parents].set((births.weights > 0) & (weights <= 0))
    state = {name: jnp.where(waits, colony.node_state[name], after) for name, after in births.node_state.items()}
    return dataclasses.replace(births, weights=weights, node_state=state)
