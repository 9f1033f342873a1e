"""A linearly implicit step of springs and contact, beside substeps of forward Euler, on one disc.

The disc of `benchmarks.large` grows to t = 24, relaxed, by plain sums, which have derivatives. Implicit, nodes move by

    (1 − Δt J) v = f,    x ← x + Δt v,

f the velocity by springs, contact and drift and J the derivative of the first two, in as many iterations of conjugate
residuals (J is symmetric where all weights are 1) as given. An iteration takes one derivative of the sums along a
direction, which costs about as much as the sums themselves: three are as dear as four substeps. The reference is
Δt = 0.00625, a quarter of the default for wide dishes. Were the implicit step worth it, it would come as near to the
reference as substeps do, at a larger Δt or in less time.

    python -m benchmarks.implicit_step [--quick] [--json FILE]

--quick: to t = 6.
"""

import time
from dataclasses import replace
from typing import Any, ClassVar

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from benchmarks.large import LARGE
from benchmarks.report import Report, command
from yeastfit.measure.statistics.model_as_mask import HardStatistics
from yeastfit.model.laws.contact import NodeContact
from yeastfit.model.laws.forces import TreeSprings
from yeastfit.model.model import Model
from yeastfit.model.numerics import Numerics
from yeastfit.model.relaxation import Relaxation
from yeastfit.model.rules import Context, MotionRule
from yeastfit.simulation.simulate import member_keys, simulate

SIDE, PIXEL, STEP = 120.0, 0.3, 0.025
NAMES = {"cell_count": "N", "area": "area", "compactness": "C"}
Vectors = Float[Array, "node 2"]


class ImplicitMotion(MotionRule):
    """Linearly implicit in springs and contact.

    Attributes:
        iterations: Of conjugate residuals.
    """

    name: ClassVar[str] = "implicit"
    iterations: int = eqx.field(static=True, default=3)

    def moved(self, context: Context, velocity: Vectors) -> Vectors:
        """x + Δt v."""
        colony, dt, alive = context.colony, context.numerics.dt, context.colony.alive[:, None]

        def pushed(positions: Vectors) -> Vectors:
            here = replace(context, colony=replace(colony, positions=positions))
            pull = context.parameters.elasticity * TreeSprings().pull(here.colony)
            return jnp.where(alive, pull + NodeContact().velocity(here, pull), 0.0)

        _, derivative = jax.linearize(pushed, colony.positions)
        going = conjugate_residuals(lambda v: v - dt * derivative(v), velocity, self.iterations)
        return colony.positions + dt * going


def conjugate_residuals(operator: Any, right: Vectors, iterations: int) -> Vectors:
    """Solve A v = b for a symmetric A, from v = b (Stiefel 1955, Comment. Math. Helv. 29:157)."""
    v = right
    r = right - operator(v)
    p, image = r, operator(r)
    of_p, gain = image, jnp.sum(r * image)
    for left in reversed(range(iterations)):
        length = gain / jnp.maximum(jnp.sum(of_p**2), jnp.finfo(right.dtype).tiny)
        v = v + length * p
        if left:
            r = r - length * of_p
            image, before = operator(r), gain
            gain = jnp.sum(r * image)
            share = gain / jnp.where(before == 0, 1.0, before)
            p, of_p = r + share * p, image + share * of_p
    return v


SETTINGS: dict[str, tuple[float, int, Model]] = {
    "Δt 0.00625": (STEP / 4, 1, Model()),
    "Δt 0.025": (STEP, 1, Model()),
    "Δt 0.025 in 4 substeps": (STEP, 4, Model()),
    "Δt 0.025, implicit, 3 iterations": (STEP, 1, Model(motion=ImplicitMotion(3))),
    "Δt 0.025, implicit, 8 iterations": (STEP, 1, Model(motion=ImplicitMotion(8))),
    "Δt 0.05 in 8 substeps": (2 * STEP, 8, Model()),
    "Δt 0.05, implicit, 8 iterations": (2 * STEP, 1, Model(motion=ImplicitMotion(8))),
}


def run(report: Report, quick: bool) -> None:
    """Grow the disc by each setting in turn."""
    until, rows = 6.0 if quick else 24.0, list[dict[str, Any]]()
    observe = HardStatistics(SIDE, PIXEL, tuple(NAMES))
    for name, (dt, substeps, model) in SETTINGS.items():
        report.stage(name)
        numerics = Numerics(SIDE, 0.4, dt, compiled=False, substeps=substeps)
        began = time.process_time()
        grown = simulate(
            LARGE,
            member_keys(0, 1)[0],
            times=[until],
            numerics=numerics,
            relaxation=Relaxation(),
            observe=observe,
            model=model,
            throw=False,  # what went wrong stands in the table
        )
        row = {one: float(np.asarray(grown.statistics[key])[-1]) for key, one in NAMES.items()}
        first = rows[0] if rows else row
        gaps = {f"{one}, %": 100 * (row[one] / first[one] - 1) for one in NAMES.values()}
        said = "; ".join(grown.warnings())[:60]
        rows.append({"setting": name, **row, **gaps, "processor s": time.process_time() - began, "warnings": said})
    report.table(f"One disc at t = {until:g}, and its distance from the first setting", rows)
    by = {row["setting"]: row for row in rows}
    euler, implicit = by["Δt 0.025 in 4 substeps"], by["Δt 0.025, implicit, 3 iterations"]
    report.add("compactness by 4 substeps, off by", abs(euler["C, %"]), "%")
    report.add("compactness by the implicit step, 3 iterations, off by", abs(implicit["C, %"]), "%")
    report.add("time of that over time of 4 substeps", implicit["processor s"] / euler["processor s"], "×")


if __name__ == "__main__":
    command("implicit_step", run)
