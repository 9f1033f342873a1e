"""The questions that a colony model answers, one rule object each, and what a rule is given to answer it.

    question       asked                             default
    births         who buds in this step, and when   `growth.GlobalBirths`
    budding        in which direction                `budding.UniformBudding`
    contact        how nodes push each other         `contact.NodeContact`
    uptake         how fast cells eat                `uptake.BiomassUptake`
    death          what becomes of nodes             `death.NoDeath`
    motion         where a step takes a node         `motion.DrivenMotion`
    fluctuations   what disturbs the nutrient        `fluctuations.NoFluctuation`
    detachment     which cells let go                `detachment.NoDetachment`
    shape          what outline a cell has           `shape.EllipticalCells`
    medium         what cells live on                `medium.OneNutrient`
    springs        which nodes cells hold together   `forces.TreeSprings`

A new mechanism is a subclass of one of the bases below, with the method of its question and the parameters it brings;
`Model(budding=MyRule())` is then simulated, fitted, inferred and synthesised like any other. Methods are traced by JAX:
they use `jax.numpy`, draw random numbers only from lineages, and compute with weights, which are fractional in the
relaxed model. A rule's own fields are settings, fixed while a model runs; what is to be fitted is a parameter.
"""

from abc import abstractmethod
from collections.abc import Mapping
from dataclasses import fields
from typing import ClassVar

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int, UInt32

from yeastfit.errors import InputError
from yeastfit.model.cells import Cells
from yeastfit.model.colony import Colony
from yeastfit.model.interpolation import gradient_at, growth_rate, nutrient_at
from yeastfit.model.numerics import Numerics
from yeastfit.model.parameters import Parameters
from yeastfit.model.relaxation import Relaxation
from yeastfit.model.rule_settings import check_settings
from yeastfit.parameter_set import Parameter


class Context(eqx.Module):
    """What a rule may look at.

    Attributes:
        colony: Positions, parents, weights, lineages, `node_state`, the nutrient field and the number of steps done.
        parameters: Values by name: `parameters.mobility`, `parameters["budding_bias"]`.
        relaxation: Smoothing widths; None stands for a hard rule.
        numerics: Grid, Δt and δ.
        living: Weights of nodes as they bud; those of `colony` where nobody dies.
        eating: Their weights in the union of the cells that eat.
        local_nutrient: What nodes grow by: c at the nodes, or what `MediumRule.supply` makes of several nutrients.
        growth_rate: μ, the mean of c over the living nodes.
    """

    colony: Colony
    parameters: Parameters
    relaxation: Relaxation
    numerics: Numerics = eqx.field(static=True)
    living: Float[Array, " node"]
    eating: Float[Array, " node"]
    local_nutrient: Float[Array, " node"]
    growth_rate: Float[Array, ""]

    @staticmethod
    def of(
        colony: Colony,
        parameters: Parameters,
        relaxation: Relaxation,
        numerics: Numerics,
        death: "DeathRule",
        medium: "MediumRule | None" = None,
    ) -> "Context":
        """What there is to see of a colony; without a medium, of one nutrient."""
        living = death.living(colony)
        fed = medium.supply(colony, parameters, relaxation, numerics) if medium else nutrient_at(colony, numerics)
        eating = death.eating(colony, relaxation)
        return Context(colony, parameters, relaxation, numerics, living, eating, fed, growth_rate(fed, living))

    def local_gradient(self) -> Float[Array, "node 2"]:
        """∇c at the nodes."""
        return gradient_at(self.colony, self.numerics)


class Births(eqx.Module):
    """Who is born in one step.

    Attributes:
        parents: Slots of all nodes, in the order in which their children take the next free slots.
        weights: Of the child of each of `parents`; 0 where there is none.
        event: Number of the event, by which the lineages of two children of one parent differ.
        node_state: What budding changes in the state of nodes, by name.
        newborn: State with which the child of each of `parents` starts, by name; else that of `Rule.node_state`.
        refused: Whether somebody was to bud and has nothing left to do it with.
    """

    parents: Int[Array, " node"]
    weights: Float[Array, " node"]
    event: Int[Array, ""]
    node_state: dict[str, Float[Array, " node"]] = eqx.field(default_factory=dict)
    newborn: dict[str, Float[Array, " node"]] = eqx.field(default_factory=dict)
    refused: Bool[Array, ""] | None = None


class Rule(eqx.Module):
    """One mechanism. Its fields are its settings; a field may be another rule that it builds on, none is called `rule`.

    Attributes:
        question: Which of a model's questions it answers; a base class says so.
        name: As in a recipe or on the command line.
        parameters: Those that it brings.
        idle: Names of the model's own parameters that have no effect with it.
        from_start: Whether a colony must have grown by it from the start: what it keeps tells where nodes came from.
    """

    question: ClassVar[str]
    name: ClassVar[str]
    parameters: ClassVar[tuple[Parameter, ...]] = ()
    idle: ClassVar[tuple[str, ...]] = ()
    from_start: ClassVar[bool] = False

    def __post_init__(self) -> None:
        check_settings(self)

    def node_state(self) -> dict[str, float]:
        """What it keeps for each node, by name, and the value that a newborn starts with; nothing by default."""
        return {}

    def advance(self, context: Context) -> dict[str, Float[Array, " node"]]:
        """The state of all nodes one time step later; by default unchanged. Asked after the nutrient's step."""
        return {name: context.colony.node_state[name] for name in self.node_state()}

    def objection(self, rules: Mapping[str, "Rule"]) -> str | None:
        """Why it cannot be in one model with some of these rules, by question; None where it can."""
        return None

    def answered(self, found: Array, shape: tuple[int, ...]) -> Array:
        """What one of its methods found; raises `InputError` where it is of another shape."""
        if jnp.shape(found) != shape:
            raise InputError(
                f"{self.question}: rule {self.name!r} gave an array of shape {jnp.shape(found)}, not {shape}"
            )
        return found

    @property
    def parts(self) -> tuple["Rule", ...]:
        """Itself and the rules it builds on, each of which brings its parameters and keeps its state."""
        held = (getattr(self, each.name) for each in fields(self))
        return (self, *(part for rule in held if isinstance(rule, Rule) for part in rule.parts))


class BirthRule(Rule):
    """Who buds, and when."""

    question: ClassVar[str] = "births"
    doublings: ClassVar[float] = 1.0  # of a colony, in a unit of time, that fits and posteriors leave room for

    @abstractmethod
    def due(self, context: Context) -> Bool[Array, ""]:
        """Whether anybody may bud in this step; only then is `births` computed."""

    @abstractmethod
    def births(self, context: Context) -> Births:
        """Parents in order, and the weights of their children."""


class BuddingRule(Rule):
    """In which direction a child appears."""

    question: ClassVar[str] = "budding"

    @abstractmethod
    def angles(
        self, context: Context, parents: Int[Array, " node"], lineages: UInt32[Array, "node 2"]
    ) -> Float[Array, " node"]:
        """Direction φ of each child from its parent, in radians.

        Arguments:
            context: The colony before the births.
            parents: Slots of the parents.
            lineages: Data of the children's random keys (`jax.random.wrap_key_data`), whose draws are their own.
        """


class ContactRule(Rule):
    """How nodes, or cells, that touch move apart."""

    question: ClassVar[str] = "contact"

    @abstractmethod
    def velocity(self, context: Context, motion: Float[Array, "node 2"]) -> Float[Array, "node 2"]:
        """What contact adds to the velocity of each node.

        Arguments:
            context: The colony after the births.
            motion: Velocity by springs and along the gradient alone, which a constraint works against.
        """


class UptakeRule(Rule):
    """How fast cells take up nutrient."""

    question: ClassVar[str] = "uptake"

    @abstractmethod
    def rate(
        self, context: Context, level_set: Float[Array, "x y"], nutrient: Float[Array, "x y"]
    ) -> Float[Array, "x y"]:
        """b ≥ 0 in ∂c/∂t = λ1 ∇²c − b c, frozen over a time step.

        Arguments:
            context: The colony before the step.
            level_set: g of the living cells on a square window of the grid; negative inside.
            nutrient: c on the same window.
        """


class DeathRule(Rule):
    """What becomes of nodes."""

    question: ClassVar[str] = "death"

    @abstractmethod
    def living(self, colony: Colony) -> Float[Array, " node"]:
        """Weights with which nodes bud; less than `colony.weights` for the dead that stay where they are."""

    def eating(self, colony: Colony, relaxation: Relaxation) -> Float[Array, " node"]:
        """Weights of nodes in the union of the cells that eat; those of `living` by default."""
        return self.living(colony)

    def shown(self, cells: Cells, colony: Colony, relaxation: Relaxation) -> Cells:
        """Cells as they cover the plane; by default as they are."""
        return cells

    @abstractmethod
    def deaths(self, context: Context) -> Colony:
        """The colony after this step's deaths. Asked after the nutrient's step and before births."""


class MotionRule(Rule):
    """Where a node is after a time step, given its velocity."""

    question: ClassVar[str] = "motion"

    @abstractmethod
    def moved(self, context: Context, velocity: Float[Array, "node 2"]) -> Float[Array, "node 2"]:
        """Positions after the step; those of empty slots do not matter.

        Arguments:
            context: The colony after the births.
            velocity: By springs, contact and drift; 0 in empty slots.
        """


class FluctuationRule(Rule):
    """What disturbs the nutrient."""

    question: ClassVar[str] = "fluctuations"

    @abstractmethod
    def shaken(self, context: Context) -> Float[Array, "x y"]:
        """The nutrient after this step's fluctuations. Asked after cells have eaten."""


class DetachmentRule(Rule):
    """Which cells let go of their mothers."""

    question: ClassVar[str] = "detachment"

    @abstractmethod
    def detached(self, context: Context, newborn: Mapping[str, float | Array]) -> Colony:
        """The colony after this step's detachments; asked after births.

        Arguments:
            context: The colony.
            newborn: State of a new node, by name; of what differs from cell to cell that of every slot's.
        """


class ShapeRule(Rule):
    """What outline a cell has."""

    question: ClassVar[str] = "shape"

    @abstractmethod
    def cells(self, colony: Colony, parameters: Parameters) -> Cells:
        """The cells of a colony, one for each node but the first."""


class MediumRule(Rule):
    """What cells live on: a nutrient, and what else diffuses."""

    question: ClassVar[str] = "medium"
    keeps: ClassVar[tuple[str, ...]] = ()  # names of what `store` returns

    def fields(self) -> dict[str, float]:
        """Further fields on the nutrient's grid, by name, and their uniform value at the start; none by default."""
        return {}

    def store(self, key: Array, numerics: Numerics) -> dict[str, Array]:
        """What else it keeps in `Colony.medium`, as it is at the start; nothing by default."""
        return {}

    @abstractmethod
    def stepped(self, context: Context, cells: Cells, uptake: UptakeRule) -> Colony:
        """The colony whose medium has diffused and was eaten for one time step. Asked first of all."""

    def supply(
        self, colony: Colony, parameters: Parameters, relaxation: Relaxation, numerics: Numerics
    ) -> Float[Array, " node"]:
        """What nodes grow by; by default the nutrient where they are."""
        return nutrient_at(colony, numerics)

    def afforded(self, context: Context, births: Births) -> tuple[Colony, Births]:
        """The colony whose medium has paid for births, and those that it had enough for; by default all are free."""
        return context.colony, births

    def drift(self, context: Context) -> Float[Array, "node 2"]:
        """Velocity of nodes along gradients; by default λ5 ∇c."""
        return context.parameters.mobility * context.local_gradient()


class SpringRule(Rule):
    """Which nodes cells hold together."""

    question: ClassVar[str] = "springs"

    @abstractmethod
    def pull(self, colony: Colony) -> Float[Array, "node 2"]:
        """Σ_j A_ij w_j (1 − r_ij) e_ij of each node; times λ2 a velocity."""

    @abstractmethod
    def stiffness(self, colony: Colony) -> Float[Array, ""]:
        """Euler's method needs Δt λ2 times this below 2."""
