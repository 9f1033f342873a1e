"""Every notebook runs in a reduced size, and is committed with the outputs of the full one."""

import ast
import re
from pathlib import Path
from typing import Any

import nbformat
import pytest
from nbclient import NotebookClient

import yeastfit
from yeastfit import measure, model, offlattice, plot

PUBLIC = {room.__name__: room.__all__ for room in (yeastfit, measure, model, offlattice, plot)}
NOTEBOOKS = sorted((Path(__file__).parents[1] / "notebooks").glob("*.ipynb"))
FIGURES = {  # statements about each in the last table of source_figures.ipynb
    "2.1": 1,
    "2.2": 1,
    "3.2": 1,
    "4.1 – 4.5": 1,
    "4.6": 1,
    "4.7": 6,
    "4.8": 2,
    "4.9": 1,
    "4.8, 4.9": 1,
    "section 4.1": 1,
    "4.10 – 4.12": 4,
    "4.12, 4.13": 3,
    "section 4.2": 1,
    "chapter 4": 1,
}
FULL_SIZE = {  # what the first cell says
    "fitting.ipynb": "full size: 10 colonies to 14 h",
    "gradients.ipynb": "full size: 64 colonies to t = 7.5",
    "mechanisms.ipynb": "full size: 16 colonies to t = 6",
    "offlattice.ipynb": "full size: 65000 cells, at most 12288 simulations",
    "posterior.ipynb": "full size: 10 colonies to 14 h, 4096 simulations",
    "real_colonies.ipynb": "full size: 3 conditions, --simulations 12288",
    "source_figures.ipynb": "full size: 6 members, to 35.0 h",
}
VERDICTS = {
    *("agrees", "disagrees", "not resolved"),
    *("could be finished here", "could not be finished", "faster here", "not faster here"),
}


def code_cells(notebook: Any) -> list[Any]:
    return [cell for cell in notebook.cells if cell.cell_type == "code"]


def imports_in(notebook: Any) -> list[ast.Import | ast.ImportFrom]:
    """Import statements of all code cells, wherever they stand."""
    source = "\n".join(cell.source for cell in code_cells(notebook))
    plain = re.sub(r"^%.*$", "", source, flags=re.MULTILINE)
    return [node for node in ast.walk(ast.parse(plain)) if isinstance(node, ast.Import | ast.ImportFrom)]


def private(imports: list[ast.Import | ast.ImportFrom]) -> list[str]:
    """What is imported from yeastfit and is not in the `__all__` of the package or of a public room."""
    found = []
    for node in imports:
        for alias in node.names:
            if isinstance(node, ast.Import):
                public, name = alias.name in PUBLIC, alias.name
            else:
                public, name = alias.name in PUBLIC.get(node.module or "", ()), f"{node.module}.{alias.name}"
            if name.split(".")[0] == "yeastfit" and not public:
                found.append(name)
    return found


def statements(notebook: Any) -> list[str]:
    """HTML rows of the last table, header excluded."""
    return re.findall(r"<tr>(.*?)</tr>", code_cells(notebook)[-1].outputs[-1]["data"]["text/html"], re.DOTALL)[1:]


def check_statements(notebook: Any) -> None:
    """Of source_figures.ipynb."""
    found: dict[str, int] = {}
    for row in statements(notebook):
        figure, statement, source, *outcomes = re.findall(r"<td[^>]*>(.*?)</td>", row, re.DOTALL)
        found[figure] = found.get(figure, 0) + 1
        assert statement
        assert source
        assert sum(map(int, re.findall(r'colspan="(\d+)"', row))) == 3 + 4
        assert {re.match(r"<b>(.*?)</b>", outcome)[1] for outcome in outcomes} <= VERDICTS  # type: ignore[index]
        assert "nan" not in row
    assert found == FIGURES


def test_there_are_notebooks() -> None:
    assert [path.name for path in NOTEBOOKS] == list(FULL_SIZE)


@pytest.mark.slow  # minutes, of compiling mostly
@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.name)
def test_runs_in_reduced_size(path: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("YEASTFIT_NOTEBOOK", "quick")
    monkeypatch.setenv("JUPYTER_PREFER_ENV_PATH", "1")  # this environment's kernel, whatever the user has installed
    for folder in ("IPYTHONDIR", "JUPYTER_RUNTIME_DIR", "JUPYTER_CONFIG_DIR", "JUPYTER_DATA_DIR"):
        monkeypatch.setenv(folder, str(tmp_path / folder.lower()))
    notebook = nbformat.read(path, as_version=4)
    for cell in code_cells(notebook):
        cell.outputs = []
    NotebookClient(notebook, timeout=300, kernel_name="python3", resources={"metadata": {"path": tmp_path}}).execute()
    assert all(cell.outputs for cell in code_cells(notebook))
    assert "reduced size" in code_cells(notebook)[0].outputs[0]["text"]
    assert "REDUCED SIZE" in code_cells(notebook)[-1].outputs[0]["data"]["text/html"]
    if path.name == "source_figures.ipynb":
        check_statements(notebook)


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.name)
def test_imports_public_names_only(path: Path) -> None:
    """And only names that exist."""
    imports = imports_in(nbformat.read(path, as_version=4))
    assert "yeastfit" in " ".join(map(ast.unparse, imports))
    assert private(imports) == []
    exec("\n".join(map(ast.unparse, imports)), {})


def test_private_imports_are_found() -> None:
    source = """
import yeastfit
import yeastfit.model.colony
from yeastfit import fit, storage
from yeastfit.model import Cells, numerics
from yeastfit.inference.fit.result import Fit
"""
    imports = [node for node in ast.parse(source).body if isinstance(node, ast.Import | ast.ImportFrom)]
    found = [
        "yeastfit.model.colony",
        "yeastfit.storage",
        "yeastfit.model.numerics",
        "yeastfit.inference.fit.result.Fit",
    ]
    assert private(imports) == found


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.name)
def test_is_committed_in_full_size(path: Path) -> None:
    """Run once from top to bottom, as it stands, by `make notebooks`."""
    notebook = nbformat.read(path, as_version=4)
    nbformat.validate(notebook)
    cells = code_cells(notebook)
    assert [cell.execution_count for cell in cells] == list(range(1, len(cells) + 1))
    assert all(cell.outputs for cell in cells)
    kinds = {(output.output_type, output.get("name")) for cell in cells for output in cell.outputs}
    assert kinds <= {("stream", "stdout"), ("display_data", None), ("execute_result", None)}  # no error, no stderr
    assert FULL_SIZE[path.name] in cells[0].outputs[0]["text"]
    assert "REDUCED" not in cells[-1].outputs[0]["data"]["text/html"]
    assert path.stat().st_size < 3e6
    if path.name == "source_figures.ipynb":
        check_statements(notebook)


def test_the_page_of_mechanisms_says_what_its_notebook_found() -> None:
    """Changes by each rule, and verdicts on the source's guesses."""
    root = Path(__file__).parents[1]
    page = (root / "docs" / "mechanisms.md").read_text(encoding="utf-8")
    notebook = nbformat.read(root / "notebooks" / "mechanisms.ipynb", as_version=4)
    said = [output.get("data", {}) for cell in code_cells(notebook) for output in cell.outputs]
    words = "\n".join(one.get("text/markdown", "") for one in said)
    tables = "\n".join(one.get("text/html", "") for one in said)
    changes = re.findall(r"\*\*(\w+)\*\*: (?:no change resolved|(.*?)(?:; no change.*)?, at t = 6)", words)
    verdicts = re.findall(r"<td>([^<]*)</td><td><b>([^<]*)</b></td><td>([^<]*)</td></tr>", tables)
    assert (len(changes), len(verdicts)) == (17, 15)
    missing = [rule for rule, found in changes if f"`{rule}` | {found or 'none resolved'} |" not in page]
    assert missing + [row for row in verdicts if f"| {' | '.join(row)} |" not in page] == []
