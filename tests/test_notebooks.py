"""Every notebook runs in a reduced size, and is committed with the outputs of the full one."""

import ast
import re
from pathlib import Path
from typing import Any

import nbformat
import pytest
from nbclient import NotebookClient

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
    "posterior.ipynb": "full size: 10 colonies to 14 h, 4096 simulations",
    "source_figures.ipynb": "full size: 6 members, to 35.0 h",
}
VERDICTS = {
    *("agrees", "disagrees", "not resolved"),
    *("could be finished here", "could not be finished", "faster here", "not faster here"),
}


def code_cells(notebook: Any) -> list[Any]:
    return [cell for cell in notebook.cells if cell.cell_type == "code"]


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
def test_imports_what_there_is(path: Path) -> None:
    """Slow ones, too: so much is known in a moment."""
    source = "\n".join(cell.source for cell in code_cells(nbformat.read(path, as_version=4)))
    plain = re.sub(r"^%.*$", "", source, flags=re.MULTILINE)
    imports = [node for node in ast.walk(ast.parse(plain)) if isinstance(node, ast.Import | ast.ImportFrom)]
    assert "yeastfit" in " ".join(map(ast.unparse, imports))
    exec("\n".join(map(ast.unparse, imports)), {})


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
