"""The examples of docs/extending.md are run as they stand, and use public names only."""

import ast
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

import yeastfit
from yeastfit.commands.app import run
from yeastfit.storage import write_table

PAGE = Path(__file__).parents[1] / "docs" / "extending.md"
EXAMPLES = {
    re.match(r"# (\w+)\.py", text)[1]: text  # type: ignore[index]
    for text in re.findall(r"```python\n(.*?)```", PAGE.read_text(encoding="utf-8"), re.DOTALL)
}
PUBLIC = {"yeastfit": yeastfit.__all__, "yeastfit.measure": yeastfit.measure.__all__}


@pytest.fixture(autouse=True)
def registries() -> Iterator[None]:
    """What an example registers is forgotten after it."""
    registries: list[dict[str, Any]] = [yeastfit.STATISTICS, yeastfit.SAMPLERS, yeastfit.FORWARD_MODELS]
    kept = [(one, dict(one)) for one in registries]
    yield
    for one, before in kept:
        one.clear()
        one.update(before)


def test_there_is_one_example_of_each_kind() -> None:
    assert list(EXAMPLES) == ["gyration_radius", "towards_nutrient", "logistic_growth", "rejection"]


@pytest.mark.thorough
@pytest.mark.parametrize("name", EXAMPLES)
def test_it_runs(name: str) -> None:
    exec(compile(EXAMPLES[name], f"{name}.py", "exec"), {"__name__": name})


@pytest.mark.parametrize("name", EXAMPLES)
def test_it_uses_public_names_only(name: str) -> None:
    for node in ast.walk(ast.parse(EXAMPLES[name])):
        if isinstance(node, ast.Import):
            assert all(one.name == "yeastfit" or not one.name.startswith("yeastfit") for one in node.names)
        if isinstance(node, ast.ImportFrom) and (node.module or "").startswith("yeastfit"):
            assert {one.name for one in node.names} <= set(PUBLIC[node.module or ""])
        if isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name) and node.value.id == "yeastfit":
            assert node.attr in yeastfit.__all__


def test_the_forward_model_goes_through_the_commands(tmp_path: Path, undrawn: None) -> None:
    example: dict[str, Any] = {"__name__": "logistic_growth"}
    exec(compile(EXAMPLES["logistic_growth"], "logistic_growth.py", "exec"), example)
    rows = [
        {"file": f"{k}{hours}", "replicate": k, "hours": hours, "area": area}
        for k, culture in enumerate(example["cultures"].tolist())
        for hours, area in zip((2, 5, 8, 11, 14), culture, strict=True)
    ]
    write_table(tmp_path / "measurements.csv", rows)
    table, model = str(tmp_path / "measurements.csv"), ["--model", "culture", "--start", "1"]
    assert run(["fit", table, *model, "--out", str(tmp_path / "fit")]) == 0
    found = yeastfit.Fit.load(tmp_path / "fit" / "fit.json")
    assert abs(found.values["growth_rate"] - 0.6) < 4 * found.standard_errors["growth_rate"]
    short = ["--method", "abc-smc", "--population", "100", "--simulations", "500", "--draws", "12"]
    assert run(["infer", table, *model, *short, "--out", str(tmp_path / "infer")]) in (0, 1)
    assert (tmp_path / "infer" / "manifest.json").is_file()
    assert run(["design", *model, "--runs", "32", "--limit", "200", "--out", str(tmp_path / "design")]) == 0
