"""The examples of docs/extending.md are run as they stand, and use public names only."""

import ast
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

import yeastfit

PAGE = Path(__file__).parents[1] / "docs" / "extending.md"
EXAMPLES = {
    re.match(r"# (\w+)\.py", text)[1]: text  # type: ignore[index]
    for text in re.findall(r"```python\n(.*?)```", PAGE.read_text(encoding="utf-8"), re.DOTALL)
}
PUBLIC = {"yeastfit": yeastfit.__all__, "yeastfit.measure": yeastfit.measure.__all__}


@pytest.fixture(autouse=True)
def registries() -> Iterator[None]:
    """What an example registers is forgotten after it."""
    registries: list[dict[str, Any]] = [yeastfit.STATISTICS, yeastfit.SAMPLERS]
    kept = [(one, dict(one)) for one in registries]
    yield
    for one, before in kept:
        one.clear()
        one.update(before)


def test_there_is_one_example_of_each_kind() -> None:
    assert list(EXAMPLES) == ["gyration_radius", "towards_nutrient", "logistic_growth", "rejection"]


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
