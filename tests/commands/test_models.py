"""Every model through every command, and options that follow from models and their rules."""

import csv
import json
import re
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any, ClassVar

import jax.numpy as jnp
import numpy as np
import pytest
from jaxtyping import Array, Float, Int, UInt32
from PIL import Image

from yeastfit import (
    RULES,
    SAMPLERS,
    BuddingRule,
    ColonySimulator,
    Context,
    Fit,
    Imaging,
    InputError,
    Parameter,
    Posterior,
    Resolution,
    Sensitivity,
    Simulation,
    Targets,
    UptakeRule,
)
from yeastfit.commands import app as cli
from yeastfit.commands.generated.model import ModelOptions
from yeastfit.commands.generated.rules import RecipeOptions, rule_options
from yeastfit.inference.colony_simulator import COARSE
from yeastfit.inference.fit.simulators import colonies_in
from yeastfit.inference.models.algebraic import Algebraic
from yeastfit.inference.models.offlattice import Offlattice
from yeastfit.inference.simulator import names_of
from yeastfit.measure.measurements_table import read_measurements
from yeastfit.measure.outlining.outline_errors import OUTLINE_ERRORS
from yeastfit.model.model import BASES
from yeastfit.offlattice.masks.ellipse_mask import Ellipses
from yeastfit.offlattice.masks.li2024_mask import BinnedOutlines
from yeastfit.offlattice.parameters import PARAMETERS
from yeastfit.offlattice.simulation import OfflatticeSimulation
from yeastfit.offlattice.simulator import OfflatticeSimulator, known_statistics
from yeastfit.simulation.recipe import Recipe
from yeastfit.storage import write_table

OFFLATTICE = ["--model", "offlattice", "--cells", "1200"]


def rows(path: Path) -> list[dict[str, str]]:
    with path.open(newline="") as file:
        return list(csv.DictReader(file))


def configuration(folder: Path) -> dict[str, object]:
    return json.loads((folder / "manifest.json").read_text())["configuration"]


def said(capsys: pytest.CaptureFixture[str], *arguments: str) -> str:
    """The one line of an error."""
    capsys.readouterr()
    assert cli.run(list(arguments)) == 2
    (line,) = capsys.readouterr().err.strip().splitlines()
    return line


@pytest.fixture(scope="module")
def grown(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Six colonies of the off-lattice model, as `yeastfit simulate` leaves them."""
    out = tmp_path_factory.mktemp("grown")
    how = ["--members", "6", "--every", "500", "--transition", "0.5", "--seed", "3"]
    assert cli.run(["simulate", *OFFLATTICE, *how, "--out", str(out)]) == 0
    return out


@pytest.fixture(scope="module")
def table(grown: Path) -> Path:
    """Their end images, as `yeastfit measure` leaves them; the mask tells what the table does not."""
    last = [row for row in rows(grown / "curves.csv") if row["cells"] == "1200"]
    names = ("area", "radius", "compactness", "outer_compactness")
    write_table(
        grown / "measurements.csv",
        [
            {"file": f"{k}.png", "condition": "", "replicate": k, "hours": 233.0, "um_per_pixel": 1.55008}
            | {"mask": f"masks/colony_{k}.png", "max_radius": 1000.0}
            | {name: row[name] for name in names}
            for k, row in enumerate(last)
        ],
    )
    return grown / "measurements.csv"


def test_simulate_writes_curves_over_the_number_of_cells_masks_and_pictures(grown: Path) -> None:
    table = rows(grown / "curves.csv")
    assert [row["cells"] for row in table[:4]] == ["500", "1000", "1200", "500"]
    assert {"li2024_branch_index", "compactness", "pseudohyphal_share"} <= set(table[0])
    with Image.open(grown / "masks" / "colony_5.png") as image:
        mask, density = np.asarray(image), image.info["dpi"]
    assert 25_400 / density[0] == pytest.approx(1.55008, rel=1e-3)
    assert mask.sum() * 1.55008**2 == pytest.approx(float(table[-1]["area"]))
    for name in ("curves.png", "colony_5.png"):
        with Image.open(grown / name) as image:
            assert min(image.size) > 300
    kept = OfflatticeSimulation.load(grown / "simulation.npz")
    assert kept.parameters["transition"] == 0.5
    assert [row["radius"] for row in kept.rows()] == pytest.approx([float(row["radius"]) for row in table])
    assert [len(each.x) for each in kept.colonies] == [1200] * 6
    found = configuration(grown)
    assert (found["model"], found["cells"], found["parameters"]["transition"]) == ("offlattice", 1200, 0.5)  # type: ignore[index]


def test_a_colony_is_the_same_whatever_the_number_of_members(grown: Path, tmp_path: Path) -> None:
    how = ["--members", "1", "--every", "1200", "--transition", "0.5", "--seed", "3"]
    assert cli.run(["simulate", *OFFLATTICE, *how, "--out", str(tmp_path)]) == 0
    one, many = (OfflatticeSimulation.load(folder / "simulation.npz") for folder in (tmp_path, grown))
    np.testing.assert_array_equal(one.colonies[0].x, many.colonies[0].x)


@pytest.mark.usefixtures("undrawn", "unchecked")
def test_fit_of_end_images(table: Path, tmp_path: Path) -> None:
    how = ["--free", "transition", "--statistics", "compactness,radius", "--starts", "1"]
    code = cli.run(["fit", str(table), *OFFLATTICE, *how, "--out", str(tmp_path)])
    result = Fit.load(tmp_path / "fit.json")
    assert code == (0 if result.converged else 1)
    assert result.values["transition"] == pytest.approx(0.5, abs=4 * result.standard_errors["transition"])
    assert {row["parameter"]: row["role"] for row in rows(tmp_path / "parameters.csv")}["fork"] == "fixed"
    found = configuration(tmp_path)
    assert (found["model"], found["cells"], found["match"]) == ("offlattice", 1200, "li2024")
    (one,) = {(row["hours"], row["replicates"]) for row in rows(tmp_path / "targets.csv")}
    assert one == ("233.0", "6")


@pytest.mark.usefixtures("unchecked")
def test_infer_from_end_images(table: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    how = ["--free", "transition,fork", "--statistics", "compactness,radius", "--match", "exactly", "--draws", "12"]
    tiny = ["--method", "abc-smc", "--population", "64", "--simulations", "300", "--pilot", "96"]
    code = cli.run(["infer", str(table), *OFFLATTICE, *how, *tiny, "--out", str(tmp_path)])
    posterior = Posterior.load(tmp_path / "posterior.npz")
    assert code == (0 if posterior.settled else 1)
    run = json.loads((tmp_path / "run.json").read_text())["configuration"]
    assert run["prior"]["fork"] == {"distribution": "beta", "a": 2.0, "b": 5.0, "low": 0.0, "high": 1.0}
    assert (run["model"], run["cells"], run["fixed"]["any_mother"]) == ("offlattice", 1200, 0.12)
    assert [row["parameter"] for row in rows(tmp_path / "posterior.csv")] == ["transition", "fork"]
    page = (tmp_path / "index.html").read_text()
    assert "Parameters are shares and probabilities" in page
    assert (tmp_path / "colonies.png").is_file()
    assert "hours" in rows(tmp_path / "predictive.csv")[0]
    single = [row["value"] for row in rows(tmp_path / "colonies.csv") if row["statistic"] == "compactness"]
    np.testing.assert_allclose(np.array(single, float), [float(row["compactness"]) for row in rows(table)], rtol=1e-8)
    assert "Statistics of every single colony" in page
    assert cli.run(["infer", "--model", "offlattice", "--print-prior"]) == 0
    assert "a = 5.0" in capsys.readouterr().out


def test_colonies_keep_their_names_whatever_the_order_of_their_images(table: Path) -> None:
    """The last images of colonies may be in another order than their first ones."""
    read = read_measurements(table)[:3]
    early = [{**row, "hours": 100.0, "area": 1.0} for row in read]
    seen = Offlattice().seen([*early, read[2], read[0], read[1]], table.parent, None, ("area",))
    assert seen.targets.colonies == ("2", "0", "1")
    assert seen.targets.curves is not None
    np.testing.assert_array_equal(seen.targets.curves[:, 0, 0], [read[k]["area"] for k in (2, 0, 1)])


def test_colonies_too_large_to_grow_by_the_hundred_are_told_of() -> None:
    """Real ones after days, of 1.4 mm², and not the demo's."""
    data = Path(__file__).parents[2] / "data"
    real = read_measurements(data / "real" / "awri796-50um" / "measurements.csv")
    (note,) = Algebraic().seen(real, data, None, ("compactness", "radius")).notes
    assert "has the area of about 63000 cells of 7.5 µm" in note
    small = [{**row, "area": 1e5} for row in real]
    assert Algebraic().seen(small, data, None, ("compactness", "radius")).notes == ()


@pytest.mark.parametrize("masks", ["li2024", "bins", "ellipses"])
def test_cells_that_do_not_cover_the_area_are_refused(
    table: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], masks: str
) -> None:
    """With a number that covers it."""
    few = ["infer", str(table), "--model", "offlattice", "--masks", masks, "--out", str(tmp_path / "out")]
    line = said(capsys, *few, "--cells", "500")
    assert "--cells is 500, which cover" in line
    assert not (tmp_path / "out").exists()
    (enough,) = re.findall(r"give about --cells (\d+),", line)
    assert 900 < int(enough) < 1700
    model = Offlattice(cells=int(enough), masks=masks)  # type: ignore[arg-type]
    seen = model.seen(read_measurements(table), table.parent, None, model.statistics_named(["li2024"]))
    simulator = seen.model.simulator(seen.targets, PARAMETERS.names, {})
    values = np.random.default_rng(1).beta(2, 5, size=(40, 5))
    simulator(values, np.arange(40))
    assert isinstance(simulator, OfflatticeSimulator)
    assert simulator.problems["all cells together cover no more than the area: all are kept"] <= 10
    if masks == "ellipses":
        assert "no pixel" in said(capsys, *few, "--cells", "1200", "--pixel-size", "1000")
    (read, where), sized = (read_measurements(table), table.parent), Offlattice(masks=masks, pixel_size=2.0)  # type: ignore[arg-type]
    unused = [note for note in sized.seen(read, where, None, ("radius",)).notes if "not used" in note]
    assert len(unused) == (masks != "ellipses")
    whole = Offlattice(cells=500, match="none").seen(read_measurements(table), table.parent, None, ("radius",))
    whole.model.simulator(whole.targets, PARAMETERS.names, {})


@pytest.mark.usefixtures("undrawn")
@pytest.mark.thorough
@pytest.mark.usefixtures("unchecked")
def test_infer_with_colonies_of_different_parameters(
    table: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    how = ["--free", "transition,fork", "--statistics", "compactness,radius", "--match", "exactly", "--draws", "12"]
    tiny = ["--simulations", "64", "--walkers", "16", "--most-steps", "500", "--variation-sd", "0.2"]
    asked = ["infer", str(table), *OFFLATTICE, *how, *tiny, "--variation", "--prior-draws", "0", "--out", str(tmp_path)]
    assert cli.run(asked) in (0, 1)
    assert "with probability" in capsys.readouterr().out
    assert [row["parameter"] for row in rows(tmp_path / "posterior.csv")] == ["transition", "fork", "colony_variation"]
    run = json.loads((tmp_path / "run.json").read_text())["configuration"]
    assert run["variation"] == {"zero": 0.5, "sd": 0.2}
    found = Posterior.load(tmp_path / "posterior.npz")
    told = json.loads((tmp_path / "diagnostics.json").read_text())["variation_absent"]
    assert told == pytest.approx(np.mean(found.values[:, :, 2] == 0))
    page = (tmp_path / "index.html").read_text()
    assert "Each colony has parameters of its own" in page
    assert (tmp_path / "colonies.png").is_file()
    assert cli.run([*asked, "--resume"]) in (0, 1)
    assert "this run is finished" in capsys.readouterr().out
    refused = cli.run(["infer", str(table), *OFFLATTICE, "--variation", "--method", "abc-smc", "--out", str(tmp_path)])
    assert refused == 2
    assert "--variation: abc-smc takes all colonies for those of one λ" in capsys.readouterr().err


def test_design_without_times(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    how = ["--statistics", "compactness,radius,area", "--runs", "32", "--by", "statistic", "--area", "30000"]
    assert cli.run(["design", *OFFLATTICE, *how, "--out", str(tmp_path)]) == 0
    assert "1. " in capsys.readouterr().out
    found = Sensitivity.load(tmp_path / "sensitivity.json")
    assert found.statistics == ("compactness", "radius", "area")
    assert rows(tmp_path / "design.csv")
    assert configuration(tmp_path)["area"] == 30000.0
    saved = ["design", "--sensitivity", str(tmp_path / "sensitivity.json"), "--out", str(tmp_path / "again")]
    for more, words in (
        ([], "any_mother, not mobility, metabolic_rate"),
        (["--scheduler", "tcp://localhost:1"], "--workers or --scheduler"),
    ):
        capsys.readouterr()
        assert cli.run([*saved, *more]) == 2
        assert words in capsys.readouterr().err


def test_indices_of_li_and_coauthors_are_measured_on_the_masks(table: Path) -> None:
    from yeastfit import FORWARD_MODELS
    from yeastfit.measure.measurements_table import read_measurements
    from yeastfit.offlattice.statistics.li2024_statistics import PUBLISHED, li2024_statistics

    model = FORWARD_MODELS["offlattice"]()
    names = model.statistics_named(["li2024"])
    assert names == PUBLISHED
    seen = model.seen(read_measurements(table), table.parent, None, names)
    with Image.open(table.parent / "masks" / "colony_0.png") as image:
        expected = li2024_statistics(np.asarray(image))
    assert seen.targets.curves is not None
    assert seen.targets.curves[0, 2, 0] == expected.branch_index
    areas = [float(row["area"]) for row in rows(table)]
    assert seen.model.area == pytest.approx(np.mean(areas))  # type: ignore[attr-defined]


def test_masks_are_drawn_as_the_statistics_ask_for() -> None:
    """As Li et al. do for their three indices, without the frame for others of theirs, else as ellipses, or as said."""
    whole = Offlattice(cells=100).statistics
    theirs = Offlattice(cells=100).statistics_named(["li2024"])

    def drawn(names: tuple[str, ...], masks: Any = None) -> Any:
        targets, model = Targets.from_means({name: [1.0] for name in names}, [10.0]), Offlattice(cells=100, masks=masks)
        draw = model.simulator(targets, model.parameters.names, {}).draw
        return draw.func if isinstance(draw, partial) else draw

    assert drawn(theirs) == BinnedOutlines.of
    assert drawn(whole) == drawn(theirs, "bins") == BinnedOutlines.whole
    assert drawn((*theirs, "compactness")) == drawn(theirs, "ellipses") == Ellipses.of
    assert drawn((*whole, "compactness"), "li2024") == BinnedOutlines.of


def test_errors_of_the_off_lattice_model_are_those_of_outlines() -> None:
    """Unless one is given; a statistic that nobody has looked at has its own."""
    targets = Targets.from_means({name: [1.0] for name in ("smoothed_branch_index", "fractal_dimension")}, [10.0])
    model = Offlattice()
    assert model.measurement_errors(targets, None) == {"smoothed_branch_index": 0.13, "fractal_dimension": 0.01}
    assert model.measurement_errors(targets, 0.0) == {"smoothed_branch_index": 0.0, "fractal_dimension": 0.0}
    assert set(OUTLINE_ERRORS) <= set(known_statistics())


def test_help_is_that_of_the_model(capsys: pytest.CaptureFixture[str]) -> None:
    for command in ("simulate", "fit", "infer", "design"):
        for model, own, others in (("offlattice", "--any-mother", "--mobility"), ("algebraic", "--dt", "--cells")):
            assert cli.run([command, f"--model={model}", "--help"]) == 0
            text = capsys.readouterr().out
            assert own in text
            assert others not in text


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
