"""How nodes move in a time step, given their velocity (source 2.10; docs/model.md, section 3.7)."""

from typing import ClassVar

from jaxtyping import Array, Float

from yeastfit.model.rules import Context, MotionRule


class DrivenMotion(MotionRule):
    """By forces alone, x_i + Δt v_i, one step of forward Euler, as in the original model."""

    name: ClassVar[str] = "driven"

    def moved(self, context: Context, velocity: Float[Array, "node 2"]) -> Float[Array, "node 2"]:
        """Places after the step."""
        return context.colony.positions + context.numerics.dt * velocity
