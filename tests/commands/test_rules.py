"""Rules of the model on the command line: themselves, their settings and the parameters that they bring."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar

import jax.numpy as jnp
import pytest
from jaxtyping import Array, Float, Int, UInt32
from told import configuration, said

from yeastfit import (
    RULES,
    SAMPLERS,
    BuddingRule,
    ColonySimulator,
    Context,
    Imaging,
    InputError,
    Parameter,
    Posterior,
    Resolution,
    Simulation,
    Targets,
    UptakeRule,
)
from yeastfit.commands import app as cli
from yeastfit.commands.generated.model import ModelOptions
from yeastfit.commands.generated.rules import RecipeOptions, rule_options
from yeastfit.inference.fit.simulators import colonies_in
from yeastfit.inference.models.algebraic import Algebraic
from yeastfit.inference.resolution import COARSE
from yeastfit.inference.simulator import names_of
from yeastfit.model.model import BASES
from yeastfit.simulation.recipe import Recipe


class Leaning(BuddingRule):
    """Children to the right, more or less.

    Attributes:
        power: How often the cosine is taken
            of the angle.
    """

    name: ClassVar[str] = "leaning"
    parameters: ClassVar[tuple[Parameter, ...]] = (
        Parameter("lean", "κ", "how closely children lie to the right", plausible=(0.1, 50.0), default=0.0),
    )
    power: int = 1

    def angles(
        self, context: Context, parents: Int[Array, " node"], lineages: UInt32[Array, "node 2"]
    ) -> Float[Array, " node"]:
        spread = jnp.linspace(-jnp.pi, jnp.pi, parents.shape[0])
        return spread / (1.0 + context.parameters["lean"]) ** self.power


@pytest.fixture
def leaning(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """A rule that somebody has registered, with its setting and its parameter on the command line."""
    monkeypatch.setitem(RULES["budding"], "leaning", Leaning)
    return ["--budding", "leaning", "--budding-power", "2", "--lean", "3"]


@pytest.mark.usefixtures("undrawn")
def test_a_rule_its_setting_and_its_parameter_are_options(leaning: list[str], tmp_path: Path) -> None:
    small = ["--domain", "12", "--spacing", "0.2", "--capacity", "16", "--time", "2", "--every", "2", "--members", "2"]
    assert cli.run(["simulate", *leaning, *small, "--out", str(tmp_path)]) == 0
    found: Any = configuration(tmp_path)
    assert found["rules"]["budding"] == {"rule": "leaning", "power": 2}
    assert found["parameters"]["lean"] == 3.0
    kept = Simulation.load(tmp_path / "simulation.npz")
    assert isinstance(kept.model.budding, Leaning)
    assert (kept.model.budding.power, float(kept.parameters["lean"])) == (2, 3.0)


@pytest.mark.parametrize("command", ["simulate", "fit", "infer", "design", "gradcheck"])
def test_rules_reach_the_model_of_every_command(leaning: list[str], command: str) -> None:
    given = {"budding": "leaning", "budding_power": 2, "lean": 3.0}
    chosen = ModelOptions(command, only="algebraic").read(given)
    assert isinstance(chosen.forward, Algebraic)
    assert chosen.forward.rules.budding == Leaning(power=2)
    assert chosen.values == {"lean": 3.0}
    assert chosen.configuration(command)["rules"]["budding"]["power"] == 2


def test_a_parameter_of_a_rule_may_be_free(leaning: list[str], capsys: pytest.CaptureFixture[str]) -> None:
    assert cli.run(["infer", "--budding", "leaning", "--free", "mobility,lean", "--print-prior"]) == 0
    assert "# κ: how closely children lie to the right\n[lean]" in capsys.readouterr().out
    model = ModelOptions("fit").read({"budding": "leaning"}).forward
    targets = Targets.from_means({"radius": [1.0, 1.5]}, times=[1.0, 2.0], replicates=5, imaging=Imaging(extent=3.0))
    coarse, fine = model.fit_simulators(targets, ["lean"], {})
    for simulator in (coarse, fine):
        assert simulator.parameters.names == ("lean",)
        assert names_of(simulator)[-1] == "lean"
    resolutions, rules = colonies_in({"": coarse}, {"": fine})
    assert resolutions == (COARSE, Resolution())
    assert rules is not None
    assert rules["budding"] == {"rule": "leaning", "power": 1}


@pytest.mark.parametrize("command", ["simulate", "fit", "infer"])
def test_a_capacity_limits_colonies_of_every_command(command: str) -> None:
    chosen = ModelOptions(command).read({"capacity": 20_000})
    assert chosen.configuration(command)["capacity"] == 20_000
    targets = Targets.from_means({"radius": [1.0, 9.0]}, times=[1.0, 15.0], replicates=5, imaging=Imaging(extent=9.0))
    for one in (
        chosen.forward.simulator(targets, ["mobility"], {}),
        *chosen.forward.fit_simulators(targets, ["mobility"], {}),
    ):
        assert isinstance(one, ColonySimulator)
        assert one.curves.numerics.capacity == 20_000
    with pytest.raises(InputError, match="capacity is 1, it must be a whole number of nodes, at least 2"):
        ModelOptions(command).read({"capacity": 1})


def test_rules_take_the_place_of_those_of_a_recipe(leaning: list[str]) -> None:
    recipe = Recipe(parameters={"mobility": 2.0}, seed=1, hours=(4.0,))
    changed = RecipeOptions().read({"budding": "leaning", "lean": 3.0})(recipe)
    assert isinstance(changed.model.budding, Leaning)
    assert changed.parameters == {"mobility": 2.0, "lean": 3.0}
    again = RecipeOptions().read({"lean": 4.0, "aspect_ratio": 0.5})(changed)
    assert again.parameters == {"mobility": 2.0, "lean": 4.0, "aspect_ratio": 0.5}
    with pytest.raises(InputError, match="--lean is a parameter of --budding leaning: choose that rule"):
        RecipeOptions().read({"lean": 4.0})(recipe)
    with pytest.raises(
        InputError, match=r"the recipe has lean, a parameter of --budding leaning: choose that rule, or"
    ):
        RecipeOptions().read({"budding": "uniform"})(changed)


def test_help_explains_rules_settings_and_parameters(leaning: list[str], capsys: pytest.CaptureFixture[str]) -> None:
    for command in ("simulate", "synthesize", "fit", "infer", "design", "gradcheck"):
        assert cli.run([command, "--help"]) == 0
        text = " ".join(capsys.readouterr().out.replace("│", " ").split())
        assert "In which direction a child appears. uniform – Any direction alike, " in text
        assert "; leaning – Children to the right, more or less. Default: uniform." in text
        assert "How often the cosine is taken of the angle. Of --budding leaning." in text
        assert "κ, how closely children lie to the right. Plausible: 0.1 to 50. Of --budding leaning." in text


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["--lean", "2"], "--lean is a parameter of --budding leaning: choose that rule, or leave it out"),
        (["--budding-power", "2"], "--budding-power is a setting of --budding leaning: choose that rule"),
        (["--budding", "leaning", "--lean", "-1"], "lean (κ) is -1, it must be finite and at least 0"),
        (["--model", "offlattice", "--budding", "leaning"], "--budding is an option of --model algebraic"),
        (["--births", "leaning"], "--births is 'leaning', it must be one of global"),
    ],
)
def test_what_rules_do_not_have_is_said_in_one_line(
    leaning: list[str], arguments: list[str], words: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for command in ("simulate", "design"):
        assert words in said(capsys, command, *arguments, "--out", str(tmp_path))
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["--model", "other"], "--model is 'other', it must be one of algebraic, offlattice"),
        (["--model", "offlattice", "--mobility", "2"], "--mobility is an option of --model algebraic"),
        (["--cells", "100"], "--cells is an option of --model offlattice, not of algebraic"),
        (["--budding", "other"], "--budding is 'other', it must be one of uniform"),
        (["--budding", "turned"], "--budding is 'turned', it must be one of uniform"),
        (["--model", "offlattice", "--fork", "2"], "fork (γ) is 2, it must be in [0, 1]"),
        (["--model", "offlattice", "--cells", "0"], "cells is 0"),
        (["--model", "offlattice", "--every", "0"], "every is 0"),
    ],
)
def test_what_would_be_right_is_said_in_one_line(
    arguments: list[str], words: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert words in said(capsys, "simulate", *arguments, "--out", str(tmp_path))
    assert not list(tmp_path.iterdir())


def test_numba_is_asked_for_where_it_is_missing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    from yeastfit import compiled
    from yeastfit.offlattice import colony

    monkeypatch.setattr(compiled, "njit", None)
    monkeypatch.setattr(colony, "grow_cells", compiled.kernel(lambda *arguments: (0, 0, 0, 0)))
    line = said(capsys, "simulate", "--model", "offlattice", "--out", str(tmp_path))
    assert "pip install 'yeastfit[offlattice]'" in line


def test_every_rule_and_its_settings_say_what_they_are() -> None:
    """Those that a rule inherits included."""
    said = {option.name: option.help for option in rule_options()}
    assert said["death"].startswith("What becomes of nodes. none – No node dies")
    for question in BASES:
        each = said[question].partition(". ")[2].rstrip(".").split("; ")
        assert {one.partition(" – ")[0] for one in each} <= set(RULES[question])
        assert not [one for one in each if len(one.partition(" – ")[2].split()) < 3]
    assert said["contact_boundary"].startswith("K, over what width the outline")
    assert not [name for name, text in said.items() if len(text.partition(" Of --")[0].split()) < 5]


def test_options_that_a_command_has_anyway_are_not_taken_over(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    """A sampler's setting called --draws, and a rule's parameter called --time: refused by name, also for --help."""

    @dataclass(frozen=True)
    class Weighing:
        draws: int = 3

        def run(self, *arguments: Any) -> Posterior:
            raise AssertionError

    class Slowly(UptakeRule):
        name: ClassVar[str] = "slowly"
        parameters: ClassVar[tuple[Parameter, ...]] = (Parameter("time", "T", "time to digest", (0.1, 1.0), 0.5),)

        def rate(self, *arguments: Any, **more: Any) -> Any:
            raise AssertionError

    out = str(tmp_path / "out")
    with monkeypatch.context() as patch:
        patch.setitem(SAMPLERS, "weighing", Weighing)
        assert cli.run(["infer", "--help"]) == 2
        assert "'draws' ((weighing 3)) is a setting or parameter called like" in capsys.readouterr().err
    monkeypatch.setitem(RULES["uptake"], "slowly", Slowly)
    assert cli.run(["simulate", "--uptake", "slowly", "--out", out]) == 2
    said = capsys.readouterr().err
    assert said.startswith("error: 'time' (")
    assert said.endswith("called like an option that yeastfit simulate has anyway, --time: rename it\n")
