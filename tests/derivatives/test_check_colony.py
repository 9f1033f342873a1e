"""The gradient checks: that they pass what is right, fail what is wrong, and say so where nothing can be told."""

import csv
import io
import json
from collections.abc import Iterator
from contextlib import redirect_stderr, redirect_stdout
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import equinox as eqx
import jax
import numpy as np
import pytest
from helpers import wrong_types
from jaxtyping import Array

from yeastfit import (
    HARD,
    GradientCheck,
    InputError,
    Numerics,
    Parameters,
    Relaxation,
    Simulation,
    check_gradients,
)
from yeastfit.commands import app as cli
from yeastfit.commands import gradcheck as command
from yeastfit.derivatives import check_colony as gradients
from yeastfit.measure import HardStatistics
from yeastfit.measure.statistics.smooth_statistics import SmoothStatistics
from yeastfit.model.colony import Colony
from yeastfit.model.parameters import PARAMETERS

TINY = Numerics(domain=6.0, spacing=0.2, dt=0.02, capacity=10)
SIZE = ["--domain", "6", "--spacing", "0.2", "--capacity", "10", "--time", "2.2"]  # the command line of the same
TIMES = (1.1, 2.2)
FEW = SmoothStatistics(extent=6.0, spacing=0.2, statistics=("area", "radius"))  # those below that are thorough take all


@pytest.fixture(autouse=True, scope="module")
def unchecked() -> Iterator[None]:
    """Statistics that are traced are no NumPy arrays, as they are annotated to be."""
    with wrong_types():
        yield


@dataclass
class Ran:
    """What `yeastfit gradcheck` found, wrote and printed."""

    check: GradientCheck
    status: int
    folder: Path
    out: str
    err: str


@pytest.fixture(scope="module")
def ran(tmp_path_factory: pytest.TempPathFactory) -> Ran:
    """One check for all tests that look at one."""
    found: list[GradientCheck] = []

    def kept(*arguments: Any, **more: Any) -> GradientCheck:
        found.append(check_gradients(*arguments, **more))
        return found[0]

    folder, out, err = tmp_path_factory.mktemp("gradcheck"), io.StringIO(), io.StringIO()
    with pytest.MonkeyPatch.context() as patch, redirect_stdout(out), redirect_stderr(err):
        patch.setattr(command, "check_gradients", kept)
        status = cli.run(["gradcheck", *SIZE, "--out", str(folder)])
    return Ran(found[0], status, folder, out.getvalue(), err.getvalue())


# --- simulations ---------------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def check(ran: Ran) -> GradientCheck:
    return ran.check


@pytest.mark.slow
def test_simulations_pass(check: GradientCheck) -> None:
    assert check.passed, str(check)
    directions = [*PARAMETERS.names, "union width", "contact width", "boundary width"]
    starts = [f"{name} {k}" for name in ("positions", "nutrient", "budding") for k in (1, 2)]
    assert list(check.growth) == [*(f"log {name}" for name in directions), *starts]
    assert len(check.comparisons) == 16 * (7 * 2 + 1)
    by_name = {(c.along, c.output, c.index): c for c in check.comparisons}
    assert by_name["log aspect_ratio", "area", (1,)].forward > 0.5
    assert by_name["budding 1", "area", (0,)].forward != 0.0
    # nothing is compared by chance: differences see what the derivative sees
    assert max(c.uncertainty for c in check.comparisons if c.by == "transpose") < 1e-9


@pytest.mark.thorough
def test_growth_is_that_of_the_tangents(check: GradientCheck) -> None:
    """A displacement of the first nodes starts at 1, a change of λ at 0; both grow but moderately here."""
    assert check.growth_times[-1] == pytest.approx(2.2)
    assert len(check.growth_times) == 20
    for name, sizes in check.growth.items():
        assert sizes.shape == (20,)
        assert sizes.max() < 10, name
    assert check.growth["positions 1"][0] == pytest.approx(1.0, rel=0.3)
    assert check.growth["log elasticity"][0] < 0.1
    assert check.warnings() == []


@pytest.mark.thorough
def test_rows_and_text(check: GradientCheck) -> None:
    rows = check.rows()
    assert len(rows) == len(check.comparisons)
    columns = "by along output index forward other uncertainty scale verdict time error"
    assert list(rows[0]) == columns.split()
    assert {row["time"] for row in rows} == {1.1, 2.2, None}
    text = str(check)
    assert "log aspect_ratio" in text
    assert "passed: of 240 derivatives 240 agree" in text
    assert len(text.splitlines()) == 18


@pytest.mark.thorough
def test_a_derivative_that_is_lost_on_the_way_is_found(monkeypatch: pytest.MonkeyPatch) -> None:
    """A tenth of that in one λ, and a hundredth of that in the initial nutrient."""
    true = gradients.simulate

    def simulate(parameters: Parameters, *, start: Colony, **more: Any) -> Simulation:
        def less(x: Array, share: float) -> Array:
            return (1 - share) * x + share * jax.lax.stop_gradient(x)

        parameters = eqx.tree_at(lambda p: p.mobility, parameters, less(parameters.mobility, 0.1))
        return true(parameters, start=eqx.tree_at(lambda c: c.nutrient, start, less(start.nutrient, 0.01)), **more)

    monkeypatch.setattr(gradients, "simulate", simulate)
    check = check_gradients(times=TIMES, numerics=TINY, observe=FEW, steps=(1e-5, 1e-6))
    assert not check.passed
    wrong = [c for c in check.comparisons if c.verdict == "differs"]
    assert {c.along for c in wrong} == {"log mobility", "nutrient 1", "nutrient 2"}
    assert {c.verdict for c in check.comparisons if c.by == "transpose"} == {"agrees"}
    errors = {name: np.median([c.error for c in wrong if c.along.startswith(name)]) for name in ("log", "nutrient")}
    assert errors == {"log": pytest.approx(0.1, rel=0.01), "nutrient": pytest.approx(0.01, rel=0.01)}


@pytest.mark.thorough
def test_a_tie_between_parents_is_reported_and_never_passed() -> None:
    """Hungry, not both of the first two nodes bud, and which does any displacement decides."""
    hungry = Parameters(metabolic_rate=20.0, diffusivity=0.02)
    check = check_gradients(hungry, times=TIMES, numerics=TINY, observe=FEW, steps=(1e-4, 1e-8))
    crossed = {c.along for c in check.comparisons if c.verdict == "crossed"}
    assert {"positions 1", "positions 2", "nutrient 1", "nutrient 2"} <= crossed
    assert not check.passed
    assert any("crosses a change of the order of parents" in line for line in check.warnings())
    assert "differs" not in check.counts


@pytest.mark.thorough
def test_chattering_contacts_are_reported_with_what_to_do() -> None:
    stiff = Parameters(repulsivity=30.0)
    check = check_gradients(stiff, times=TIMES, numerics=TINY, observe=FEW, steps=(1e-6,))
    (line,) = (line for line in check.warnings() if "chatter" in line)
    assert "dt · repulsivity / contact is 3" in line
    assert "5-fold in every step" in line
    assert "wider contact or a smaller dt" in line


def test_outgrown_derivatives_are_reported_with_what_to_do() -> None:
    growth = {"log mobility": np.array([0.0, 250.0]), "log repulsivity": np.array([0.0, np.inf])}
    growth["positions 1"] = np.array([1.0, np.exp(8.0)])
    kinds = {"log mobility": "λ", "log repulsivity": "λ", "positions 1": "positions"}
    (line,) = gradients._useless({name: growth[name] for name in ("log mobility", "positions 1")}, kinds, 4.0)
    assert line.startswith("by t = 4 a change of log mobility by 0.01 moves a node by 2.5 L0 to first order")
    assert "exp(2 t)" in line
    assert all(words in line for words in ("wider contact", "turning", "yeastfit.sensitivity"))
    (line,) = gradients._useless(growth, kinds, 4.0)
    assert "log repulsivity" in line


@pytest.mark.parametrize(
    ("relaxation", "words"),
    [
        (HARD, "union width 0 is the hard rule"),
        (Relaxation(contact=None), "contact width 0 is the hard rule"),
        (Relaxation(boundary=None), "boundary width 0 is the hard rule"),
        (Relaxation(births="whole"), "births is 'whole'"),
        (Relaxation(turning=0.5), "turning is 0.5, with which derivatives leave out what differences see"),
    ],
    ids=["hard", "contact", "boundary", "births", "turning"],
)
def test_rules_without_a_derivative_are_refused(relaxation: Relaxation, words: str) -> None:
    with pytest.raises(InputError, match=words):
        check_gradients(relaxation=relaxation, numerics=TINY)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"times": (2.0, 1.0)}, r"times is \[2, 1\], it must rise"),
        ({"parameters": Parameters(mobility=np.ones(2))}, r"mobility has shape \(2,\), a check is of one number each"),
        ({"draws": 0}, "draws is 0"),
        ({"observe": HardStatistics(extent=8.0)}, "observe is HardStatistics, which has no derivatives: use"),
        ({"observe": "smooth"}, "observe is 'smooth', it must be yeastfit.measure.SmoothStatistics"),
        ({"relaxation": "hard"}, "relaxation is 'hard', it must be yeastfit.Relaxation"),
    ],
    ids=["times", "parameters", "draws", "masks", "observer", "relaxation"],
)
def test_what_does_not_fit_is_named(change: dict[str, Any], words: str) -> None:
    with wrong_types(), pytest.raises(InputError, match=words):
        check_gradients(numerics=TINY, **change)


# --- the command line ----------------------------------------------------------------------------------------------


@pytest.mark.thorough
def test_gradcheck_writes_a_table_and_ends_with_0(ran: Ran) -> None:
    assert ran.status == 0
    assert "passed: of 240 derivatives 240 agree" in ran.out
    assert "log aspect_ratio" in ran.out
    assert ran.err == ""
    with (ran.folder / "gradcheck.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == 240
    assert {row["verdict"] for row in rows} == {"agrees"}
    manifest = json.loads((ran.folder / "manifest.json").read_text())
    assert manifest["passed"]
    assert manifest["configuration"]["numerics"]["capacity"] == 10


@pytest.mark.thorough
def test_gradcheck_ends_with_1_where_something_does_not_agree(
    capsys: pytest.CaptureFixture[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Without --out it leaves nothing behind."""
    monkeypatch.chdir(tmp_path)
    assert cli.run(["gradcheck", *SIZE, "--time", "1.64", "--tolerance", "1e-12"]) == 1
    printed = capsys.readouterr()
    assert "not passed: of 240 derivatives" in printed.out
    assert "warning: " in printed.err
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["--contact-width", "0"], "--contact-width is 0.0, it must be a number from 1e-06 to 1e+06"),
        (["--time", "0"], "--time is 0.0, it must be a number above 0"),
        (["--mobility", "-1"], "mobility"),
        (["--elasticity", "60"], "dt is 0.02, too large for the springs"),
    ],
    ids=["contact", "time", "mobility", "elasticity"],
)
def test_bad_input_is_one_line_and_exit_code_2(
    arguments: list[str], words: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert cli.run(["gradcheck", *SIZE, *arguments, "--out", str(tmp_path / "out")]) == 2
    *others, line = capsys.readouterr().err.strip().splitlines()
    assert all(one.endswith("is given more than once, the last one counts") for one in others)  # `SIZE` has a time
    assert line.startswith("error: ")
    assert words in line
    assert not (tmp_path / "out").exists()
