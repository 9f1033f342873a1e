"""What each rule beyond the source's costs: the time of a step beside that of the plain model.

A colony of 250 nodes, grown by the source's rules, takes further steps by each rule and by the source's, ten times in
turn, of which the least count; every rule has parameters with which it is at work. Walkers are 5000, spread evenly.
Then stars of 125, 250, 500 and 1000 nodes take further steps likewise, in a dish that grows with them: the cost is
linear in nodes where the exponent of that table is about 1. Collocated nodes come in colonies of their own, grown from
stores of V nodes until the groups that should bud have none left; such a colony, too, takes further steps by its rules
and by the source's.

The plain step leaves alone the part of the grid where the nutrient is at rest, which is most of it. Three rules cannot:
lognormal disturbs all of it, with a normal number for every point; a morphogen that diffuses five times as fast as the
nutrient reaches all of it; the density of walkers is smoothed on all of it. The second table tells what that alone
takes, by NumPy and SciPy where they have it. A rule meets the target only where all that it adds takes at most 0.5
times the plain step.

Colonies with room for more than 500 nodes grow by compiled loops on a CPU, as far as there are such of their rules. The
last table is of stars of 1000 and 4000 nodes that take steps by these.

Targets: no rule takes above 1.5 times as long as the plain model, contact between cells at most 10 times at 500 cells.

    python -m benchmarks.mechanisms

--quick: shorter runs, with fewer stars. --docs DIR writes DIR/mechanisms-cost.md.
"""

import time
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from scipy.ndimage import gaussian_filter

from benchmarks.programs import LAMBDA, MIDDLE, SOURCE, STATISTICS, Program, numerics_for, placed, samples
from benchmarks.report import Report, command
from yeastfit.measure.statistics.smooth_statistics import SmoothStatistics
from yeastfit.model.colony import Colony, start
from yeastfit.model.compiled.rules import with_compiled_rules
from yeastfit.model.mechanisms.morphogen_medium import DIFFUSIVITY
from yeastfit.model.mechanisms.walker_medium import WalkerMedium
from yeastfit.model.model import Model
from yeastfit.model.numerics import Numerics
from yeastfit.model.nutrient import closed_step
from yeastfit.model.parameters import Parameters
from yeastfit.model.relaxation import Relaxation
from yeastfit.model.simulate import trajectory
from yeastfit.simulation.simulate import member_keys, simulate

Rules = dict[str, dict[str, Any]]

CASES: dict[str, tuple[Rules, dict[str, float]]] = {
    "gradient": ({"budding": {"rule": "gradient"}}, {}),
    "biased": ({"budding": {"rule": "biased"}}, {"budding_bias": 2.0}),
    "polar": ({"budding": {"rule": "polar"}}, {"budding_bias": 2.0, "polarity": 0.7}),
    "patches": ({"births": {"rule": "patches"}}, {}),
    "clocks": ({"births": {"rule": "clocks"}}, {"cycle_variation": 0.2}),
    "starvation, stay": ({"death": {"rule": "starvation"}}, {"death_rate": 0.2, "starvation": 0.3}),
    "starvation, vanish": (
        {"death": {"rule": "starvation", "dead": "vanish"}},
        {"death_rate": 0.2, "starvation": 0.3},
    ),
    "langevin": ({"motion": {"rule": "langevin"}}, {"node_noise": 0.01}),
    "lognormal": ({"fluctuations": {"rule": "lognormal"}}, {"nutrient_noise": 0.05}),
    "random detachment": ({"detachment": {"rule": "random"}}, {"detachment_rate": 0.01}),
    "nitrogen": ({"medium": {"rule": "nitrogen"}}, {}),
    "morphogen": ({"medium": {"rule": "morphogen"}}, {"morphogen_secretion": 1.0, "morphogen_repulsion": 1.0}),
    "superellipse": ({"shape": {"rule": "superellipse"}}, {"shape_exponent": 4.0}),
    "walkers": ({"medium": {"rule": "walkers"}, "births": {"rule": "walkers"}}, {}),
    "contact of cells": ({"contact": {"rule": "cells"}}, {}),
    "constrained contact": ({"contact": {"rule": "constraint"}}, {}),
}
"""Rules by question, and the parameters with which they are at work."""
BETWEEN_CELLS = ("contact of cells", "constrained contact")
"""Those that may take 10 times as long."""
SIZES = (125, 250, 500, 1000)
LARGE = (1000, 4000)
AT = 500  # cells at which contact between them is judged
TIMES = 10
STORES = (512, 1024, 2048, 4096)
USED_UP = 30.0  # a time at which stores of these sizes are


def taken_over(rules: Rules, colony: Colony, numerics: Numerics) -> tuple[Model, Colony]:
    """The rules, and the source's colony with what they keep of it."""
    model = Model.of(rules)
    if colony.node_state:  # a colony of these rules
        return model, colony
    return model, model.resumed(replace(colony, medium=model.medium.store(jax.random.key(0), numerics)))


def further(
    rules: Rules, values: dict[str, float], colony: Colony, numerics: Numerics, steps: int, compiled: bool = False
) -> Program:
    """Further steps of a colony, by compiled loops or without, statistics at the end alone."""
    model, colony = taken_over(rules, colony, numerics)
    model = with_compiled_rules(model) if compiled else model
    parameters = model.complete(Parameters(**LAMBDA, **values))
    observe = STATISTICS if numerics == SOURCE else SmoothStatistics(numerics.domain, numerics.spacing)

    def run(parameters: Parameters, colony: Colony) -> Any:
        at = samples(steps, steps, int(since))
        return trajectory(parameters, colony, at, Relaxation(), numerics, observe, model)

    since = colony.step
    return Program.of(run, parameters, colony)


def in_turn(one: Program, plain: Program, steps: int) -> dict[str, float]:
    """Milliseconds a step of both, each the least of ten times in turn, and their ratio.

    nan where the colony does not stay finite: steps of one that is not take less.
    """
    end, _ = one.timed(1)[0]
    plain.timed(1)
    if not np.isfinite(end.positions).all():
        return {"ms a step": np.nan, "ms plain": np.nan, "times plain": np.nan}
    walls = np.full((TIMES, 2), np.nan)
    for k in range(TIMES):
        for column, program in enumerate((one, plain)):
            program.timed(1)
            walls[k, column] = program.wall
    ours, theirs = 1e3 * walls.min(axis=0) / steps
    return {"ms a step": float(ours), "ms plain": float(theirs), "times plain": float(ours / theirs)}


def grown(steps: int) -> Colony:
    """The source's colony after some steps."""

    def run(parameters: Parameters, colony: Colony) -> Any:
        return trajectory(parameters, colony, samples(steps, steps), Relaxation(), SOURCE, STATISTICS)[0]

    colony: Colony = jax.jit(run)(Parameters(**LAMBDA), start(jax.random.key(0), SOURCE))
    return colony


def beside_the_plain_model(report: Report, quick: bool) -> list[dict[str, Any]]:
    """A row for each rule at 250 nodes."""
    colony, steps = grown(MIDDLE), 25 if quick else 100
    plain = further({}, {}, colony, SOURCE, steps)
    rows: list[dict[str, Any]] = []
    for name, (rules, values) in CASES.items():
        report.stage(f"{int(colony.count)} nodes: {name}")
        rows.append({"rule": name, **in_turn(further(rules, values, colony, SOURCE, steps), plain, steps)})
    return rows


def on_the_whole_grid(report: Report, quick: bool) -> list[dict[str, Any]]:
    """A row for each thing that a rule of the whole grid cannot do without: ms, and times the plain step."""
    report.stage("the whole grid")
    colony, steps = grown(MIDDLE), 25 if quick else 100
    disturbed = replace(colony, nutrient=colony.nutrient.at[1:-1, 1:-1].multiply(0.999))
    whole, plain = further({}, {}, disturbed, SOURCE, steps), further({}, {}, colony, SOURCE, steps)
    both = in_turn(whole, plain, steps)
    rng, shape = np.random.Generator(np.random.SFC64(0)), (SOURCE.points, SOURCE.points)
    field, rate = jnp.asarray(rng.random(shape, np.float32)), jnp.zeros(shape)
    second = jax.jit(lambda c, b: closed_step(c, b, jnp.float32(DIFFUSIVITY.default), SOURCE))
    walkers = WalkerMedium()
    width, counts = walkers.width / SOURCE.spacing, np.asarray(field)
    needed: list[tuple[str, str, float]] = [
        ("lognormal", "the nutrient's step on all points", both["ms a step"] - both["ms plain"]),
        ("lognormal", "a normal number for each, NumPy", least(lambda: rng.standard_normal(shape, np.float32))),
        ("morphogen", "a step of the second field", least(lambda: jax.block_until_ready(second(field, rate)))),
        ("walkers", "two normal numbers each, NumPy", least(lambda: rng.standard_normal((walkers.walkers, 2)))),
        ("walkers", "their density, a filter by SciPy", least(lambda: gaussian_filter(counts, width, truncate=5.6))),
    ]
    return [{"rule": rule, "needs": what, "ms": ms, "times plain": ms / both["ms plain"]} for rule, what, ms in needed]


def least(action: Callable[[], Any]) -> float:
    """Milliseconds that it takes, the least of many times."""
    walls = []
    for _ in range(10 * TIMES):
        began = time.perf_counter()
        action()
        walls.append(time.perf_counter() - began)
    return 1e3 * min(walls)


def in_stars(report: Report, sizes: tuple[int, ...], compiled: bool) -> dict[str, dict[int, dict[str, float]]]:
    """`in_turn` of each rule in stars of several sizes, by compiled loops or without."""
    nutrient, steps = np.asarray(grown(MIDDLE).nutrient), 15
    stars = {nodes: (placed(nodes, 3.0, 1.0, 0.7, nutrient), numerics_for(nodes)) for nodes in sizes}
    plain = {nodes: further({}, {}, *star, steps, compiled) for nodes, star in stars.items()}
    found = {}
    for name, (rules, values) in CASES.items():
        report.stage(f"stars of {sizes[0]} to {sizes[-1]} nodes{', compiled loops' if compiled else ''}: {name}")
        found[name] = {n: in_turn(further(rules, values, *stars[n], steps, compiled), plain[n], steps) for n in sizes}
    return found


def by_compiled_loops(report: Report, sizes: tuple[int, ...]) -> list[dict[str, Any]]:
    """A row for each rule: ms a step of stars of several sizes, and times the plain step."""
    rows = []
    for name, found in in_stars(report, sizes, compiled=True).items():
        row: dict[str, Any] = {"rule": name}
        for n, one in found.items():
            row |= {f"ms, {n} nodes": one["ms a step"], f"times plain, {n} nodes": one["times plain"]}
        rows.append(row)
    return rows


def against_nodes(report: Report, sizes: tuple[int, ...]) -> list[dict[str, Any]]:
    """A row for each rule: ms a step of stars of several sizes, the exponent of nodes, and the ratio at `AT`."""
    rows = []
    for name, found in in_stars(report, sizes, compiled=False).items():
        times = {f"{n} nodes": found[n]["ms a step"] for n in sizes}
        exponent = float(np.polyfit(np.log(sizes), np.log(list(times.values())), 1)[0])
        rows.append({"rule": name, **times, "exponent": exponent, f"times plain at {AT}": found[AT]["times plain"]})
    return rows


def from_stores(report: Report, stores: tuple[int, ...]) -> list[dict[str, Any]]:
    """A row for each store of collocated nodes; their springs need a shorter time step than others."""
    rows = []
    for nodes in stores:
        report.stage(f"a store of {nodes} nodes")
        numerics = replace(SOURCE, dt=0.5 * SOURCE.dt)
        rules = {question: {"rule": "collocated", "nodes": nodes} for question in ("births", "springs")}
        begin = member_keys(0, 1)[0]
        end = simulate(Parameters(**LAMBDA), begin, times=[USED_UP], numerics=numerics, model=Model.of(rules)).colony
        plain = further({}, {}, replace(end, node_state={}), numerics, 15)
        one = further(rules, {}, end, numerics, 15)
        rows.append({"V": nodes, "groups": int(end.count), **in_turn(one, plain, 15)})
    return rows


def run(report: Report, quick: bool) -> None:
    """Measure, and write the page."""
    rows = report.part(f"plain, {quick}", partial(beside_the_plain_model, report, quick))
    report.table("a step of 250 nodes", rows)
    needed = report.part(f"whole grid, {quick}", partial(on_the_whole_grid, report, quick))
    report.table("what rules of the whole grid cannot do without", needed)
    stores = report.part(f"stores, {quick}", partial(from_stores, report, STORES[:1] if quick else STORES))
    report.table("collocated nodes, by the size of their store", stores)
    first = {"rule": "collocated", "times plain": stores[0]["times plain"]}
    few = [row for row in rows if row["rule"] not in BETWEEN_CELLS]
    worst = max([*few, first], key=lambda row: row["times plain"])
    report.add("slowest rule but contact between cells", worst["times plain"], "× plain", 1.5, False, worst["rule"])
    stars = report.part(f"stars, {quick}", partial(against_nodes, report, SIZES[1:3] if quick else SIZES))
    report.table("ms a step against nodes", stars)
    for name in BETWEEN_CELLS:
        ratio = next(row[f"times plain at {AT}"] for row in stars if row["rule"] == name)
        report.add(f"{name} at {AT} cells", ratio, "× plain", 10, False)
    large = report.part(f"compiled, {quick}", partial(by_compiled_loops, report, LARGE[:1] if quick else LARGE))
    report.table("ms a step by compiled loops", large)
    if report.docs is not None:
        page = "\n\n".join([report.head(__doc__), *report.sections()])
        (report.docs / "mechanisms-cost.md").write_text(page)


if __name__ == "__main__":
    command("mechanisms", run)
