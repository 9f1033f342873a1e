"""Every model through every command."""

import csv
import json
import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image
from told import configuration, said

from yeastfit import (
    Fit,
    Posterior,
    Sensitivity,
)
from yeastfit.commands import app as cli
from yeastfit.commands.posterior_run.config import Request
from yeastfit.commands.posterior_run.run import InferRun
from yeastfit.errors import InputError
from yeastfit.inference.models.algebraic import Algebraic
from yeastfit.inference.models.offlattice import Offlattice
from yeastfit.inference.prior.distributions import Distribution
from yeastfit.measure.measurements_table import read_measurements
from yeastfit.offlattice.masks import ellipse_mask
from yeastfit.offlattice.masks.area_matching import match_exactly
from yeastfit.offlattice.parameters import PARAMETERS
from yeastfit.offlattice.simulation import COLUMNS, OfflatticeSimulation
from yeastfit.offlattice.simulator import OfflatticeSimulator
from yeastfit.results.folder import results_folder
from yeastfit.storage import write_table

OFFLATTICE = ["--model", "offlattice", "--cells", "1200"]


def rows(path: Path) -> list[dict[str, str]]:
    with path.open(newline="") as file:
        return list(csv.DictReader(file))


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
    assert kept.sentence().startswith("6 colonies of 1200 cells, ")
    first, *others = kept.colonies  # one that could bud no more
    columns = {name: getattr(first, name)[:194] for name in COLUMNS}
    ended = replace(kept, colonies=(replace(first, **columns), *others))
    assert ended.sentence().startswith("6 colonies of 194 to 1200 cells, ")
    found = configuration(grown)
    assert (found["model"], found["cells"], found["parameters"]["transition"]) == ("offlattice", 1200, 0.5)  # type: ignore[index]


def test_a_colony_is_the_same_whatever_the_number_of_members(grown: Path, tmp_path: Path) -> None:
    how = ["--members", "1", "--every", "1200", "--transition", "0.5", "--seed", "3"]
    assert cli.run(["simulate", *OFFLATTICE, *how, "--out", str(tmp_path)]) == 0
    one, many = (OfflatticeSimulation.load(folder / "simulation.npz") for folder in (tmp_path, grown))
    np.testing.assert_array_equal(one.colonies[0].x, many.colonies[0].x)


@pytest.mark.thorough
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


@pytest.mark.parametrize(("masks", "cells"), [("li2024", 500), ("bins", 500), ("ellipses", 500), ("ellipses", 30)])
def test_cells_that_do_not_cover_the_area_are_refused(
    table: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], masks: str, cells: int
) -> None:
    """With a number that covers it, also from far fewer, which cover more area each."""
    few = ["infer", str(table), "--model", "offlattice", "--masks", masks, "--out", str(tmp_path / "out")]
    line = said(capsys, *few, "--cells", str(cells))
    assert f"--cells is {cells}, which cover" in line
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
        assert "--pixel-size is 1000, it must be a number from 0.0084 to 8.4 µm" in said(
            capsys, *few, "--cells", "1200", "--pixel-size", "1000"
        )
    (read, where), sized = (read_measurements(table), table.parent), Offlattice(masks=masks, pixel_size=2.0)  # type: ignore[arg-type]
    unused = [note for note in sized.seen(read, where, None, ("radius",)).notes if "not used" in note]
    assert len(unused) == (masks != "ellipses")
    whole = Offlattice(cells=500, match="none").seen(read_measurements(table), table.parent, None, ("radius",))
    whole.model.simulator(whole.targets, PARAMETERS.names, {})


@pytest.mark.usefixtures("undrawn")
@pytest.mark.thorough
@pytest.mark.usefixtures("unchecked")
@pytest.mark.parametrize("varying", [(), ("fork",)])
def test_infer_with_colonies_of_different_parameters(
    table: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], varying: tuple[str, ...]
) -> None:
    how = ["--free", "transition,fork", "--statistics", "compactness,radius", "--match", "exactly", "--draws", "12"]
    tiny = ["--simulations", "64", "--walkers", "16", "--most-steps", "500", "--variation-sd", "0.2"]
    alone = ["--varying", *varying] if varying else []
    common = ["infer", str(table), *OFFLATTICE, "--variation", "--out", str(tmp_path)]
    asked = [*common, *how, *tiny, *alone, "--prior-draws", "0"]
    assert cli.run(asked) in (0, 1)
    said = f"variation between colonies{', of fork alone' if varying else ''}: with probability"
    assert said in capsys.readouterr().out
    assert [row["parameter"] for row in rows(tmp_path / "posterior.csv")] == ["transition", "fork", "colony_variation"]
    run = json.loads((tmp_path / "run.json").read_text())["configuration"]
    assert run["variation"] == {"zero": 0.5, "sd": 0.2, **({"varying": ["fork"]} if varying else {})}
    found = Posterior.load(tmp_path / "posterior.npz")
    assert found.varying == varying
    told = json.loads((tmp_path / "diagnostics.json").read_text())["variation_absent"]
    assert told == pytest.approx(np.mean(found.values[:, :, 2] == 0))
    page = (tmp_path / "index.html").read_text()
    assert f"Each colony has its own {'fork' if varying else 'parameters'}, scattered about the condition" in page
    assert f". Variation{said.removeprefix('variation')}" in page
    assert "simulated at draws of the posterior to the size at which they are compared" in page
    assert (tmp_path / "colonies.png").is_file()
    assert cli.run([*asked, "--resume"]) in (0, 1)
    assert "this run is finished" in capsys.readouterr().out
    assert cli.run([*common, "--method", "abc-smc"]) == 2
    assert "--variation: abc-smc takes all colonies for those of one λ" in capsys.readouterr().err


def test_design_without_times(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    how = ["--statistics", "compactness,radius,perimeter", "--runs", "32", "--by", "statistic", "--area", "30000"]
    assert cli.run(["design", *OFFLATTICE, *how, "--out", str(tmp_path)]) == 0
    assert "1. " in capsys.readouterr().out
    found = Sensitivity.load(tmp_path / "sensitivity.json")
    assert found.statistics == ("compactness", "radius", "perimeter")
    assert rows(tmp_path / "design.csv")
    assert configuration(tmp_path)["area"] == 30000.0
    saved = ["design", "--sensitivity", str(tmp_path / "sensitivity.json"), "--out", str(tmp_path / "again")]
    for more, words in (
        ([], "any_mother, gap, not mobility, metabolic_rate"),
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


def test_colonies_are_matched_to_the_area_of_each_of_the_data(table: Path) -> None:
    """In pixels of the masks, whatever the mean; cells must cover the largest."""
    read = read_measurements(table)
    areas = [row["area"] for row in read]
    seen = Offlattice(cells=1500, match="each").seen(read, table.parent, None, ("compactness", "radius"))
    assert isinstance(seen.model, Offlattice)
    assert (seen.model.areas, seen.model.area) == (tuple(areas), None)
    simulator = seen.model.simulator(seen.targets, PARAMETERS.names, {"gap": 6.0})
    assert isinstance(simulator, OfflatticeSimulator)
    assert simulator.match is match_exactly
    assert simulator.area == pytest.approx([area / 1.55008**2 for area in areas], rel=1e-4)
    values = np.tile([0.5, 0.5, 0.3, 0.2, 0.1], (8, 1))
    covered = np.array([mask.sum() for mask in seen.model.outlines(simulator, values, seen.targets, 0)[0]])
    assert np.ptp(covered) > 0
    assert np.abs(covered[:, None] - simulator.area).min(axis=1).max() < 60  # pixels: a cell may close a hole
    few = Offlattice(cells=500, match="each").seen(read, table.parent, None, ("compactness", "radius"))
    with pytest.raises(InputError, match=r"compared at \S+ µm² at most: give about --cells"):
        few.model.simulator(few.targets, PARAMETERS.names, {})
    with pytest.raises(InputError, match="areas are given and match is li2024: they are for match each"):
        Offlattice(areas=(500.0,))
    with pytest.raises(InputError, match=r"areas is 5\.0, it must be a number of at least 40 µm²"):
        Offlattice(areas=(5.0,), match="each")


def test_colonies_of_less_area_may_have_had_less_nutrient(table: Path) -> None:
    """With an exponent of 1 their cells are in proportion to it, the largest have all; 0 is no exponent."""
    read = read_measurements(table)
    seen = Offlattice(cells=1500, match="each").seen(read, table.parent, None, ("compactness", "radius"))
    simulator = seen.model.simulator(seen.targets, PARAMETERS.names, {"gap": 6.0, "nutrient_exponent": 1.0})
    assert isinstance(simulator, OfflatticeSimulator)
    areas = [row["area"] for row in read]
    expected = {round(1500 * area / max(areas)) for area in areas}
    given = [PARAMETERS.defaults[name] for name in PARAMETERS.names]
    assert {simulator.cells_of(given, seed) for seed in range(64)} == expected
    assert max(expected) == 1500 > min(expected)
    held = seen.model.held(("compactness", "radius"), PARAMETERS.names, {})
    assert held["nutrient_exponent"] == 0
    alike = seen.model.simulator(seen.targets, PARAMETERS.names, held)
    assert isinstance(alike, OfflatticeSimulator)
    assert {alike.cells_of(given, seed) for seed in range(64)} == {1500}
    free = (*PARAMETERS.names, "nutrient_exponent")
    prior = seen.model.prior(seen.model.simulator(seen.targets, free, {}).parameters)
    assert prior.distributions["nutrient_exponent"] == Distribution("beta", {"a": 1.0, "b": 1.0})
    assert "nutrient_exponent" not in Offlattice(cells=1500).acting(("compactness",))


def test_simulate_says_what_to_change_where_filaments_reach_too_far(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(ellipse_mask, "MOST_PIXELS", 40**2)
    assert cli.run(["simulate", "--model", "offlattice", "--cells", "300", "--out", str(tmp_path / "out")]) == 2
    told = " ".join(capsys.readouterr().err.split())
    assert "cells is 300, of which filaments reach too far for an image: give fewer, or a larger transition" in told


def test_colonies_that_differ_much_in_area_are_told_of(table: Path) -> None:
    read = read_measurements(table)
    for larger, warns in ((1.49, False), (1.51, True)):
        unequal = [{**row, "area": 2e4 * (larger if at else 1.0)} for at, row in enumerate(read)]

        def notes(unequal: list = unequal, **settings: Any) -> tuple[str, ...]:
            return Offlattice(**settings).seen(unequal, table.parent, None, ("compactness",)).notes

        told = f"colonies cover 2e+04 to {2e4 * larger:.3g} µm², and simulated ones are all drawn at their mean: "
        told += "with --match each they are drawn at the areas of these"
        assert notes() == notes(match="exactly") == ((told,) if warns else ())
        assert notes(match="each") == notes(match="none") == notes(area=2e4) == ()


def test_a_posterior_takes_errors_that_every_outline_has_for_itself(table: Path, tmp_path: Path) -> None:
    """Of the mean of the data, unless an error of measurement is given."""
    names = ("compactness", "radius")
    rows = read_measurements(table)

    def errors(name: str, given: float | None) -> object:
        model = Offlattice(cells=1500, match="each")
        request = Request(statistics=names, model="offlattice", forward_model=model, measurement_error=given)
        with results_folder(tmp_path / name, "infer", resume=False) as results:
            return InferRun.begin(request, table, results, False, 1, lambda done, total: None).problem.colony_noise

    means = np.array([np.mean([row[name] for row in rows]) for name in names])
    assert errors("usual", None) == pytest.approx(np.diag((np.array([0.11, 0.028]) * means) ** 2))
    assert errors("given", 0.1) is None


def test_help_is_that_of_the_model(capsys: pytest.CaptureFixture[str]) -> None:
    for command in ("simulate", "fit", "infer", "design"):
        for model, own, others in (("offlattice", "--any-mother", "--mobility"), ("algebraic", "--dt", "--cells")):
            assert cli.run([command, f"--model={model}", "--help"]) == 0
            text = capsys.readouterr().out
            assert own in text
            assert others not in text
