"""Every command and its folder: what it takes, what it refuses before it computes anything, and names of data sets."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from known_colonies import RECIPE, write_measurements
from PIL import Image

from yeastfit.commands import app as cli
from yeastfit.commands import fit, gradcheck, infer, measure
from yeastfit.errors import InputError, SimulationError
from yeastfit.inference.models.algebraic import Algebraic
from yeastfit.results.check import check_folder
from yeastfit.results.folder import results_folder
from yeastfit.simulation import synthetic_data
from yeastfit.simulation.recipe import read_recipes
from yeastfit.storage import WORK, write_json

COMMANDS = ["simulate", "measure", "fit", "infer", "gradcheck", "design", "synthesize"]


class Case:
    """A command in a folder, whose computation is replaced by one that fails."""

    def __init__(self, command: str, where: Path) -> None:
        self.command, self.out = command, where / "small"
        inputs = where.parent / "inputs"
        inputs.mkdir()
        Image.new("L", (32, 32)).save(inputs / "a.png")
        (inputs / "recipes.toml").write_text(RECIPE)
        table = str(write_measurements(inputs / "measurements.csv"))
        self.sources = {
            "measure": [str(inputs / "a.png"), "--pixel-size", "1", "--jobs", "1"],
            "fit": [table],
            "infer": [table],
            "synthesize": ["--recipe", str(inputs / "recipes.toml")],
        }
        self.computed = 0

    def compute(self, *arguments: Any, **options: Any) -> None:
        self.computed += 1
        raise SimulationError("nothing came of it")

    def run(self, *options: str) -> int:
        out = self.out.parent if self.command == "synthesize" else self.out
        return cli.run([self.command, *self.sources.get(self.command, []), "--out", str(out), *options])


@pytest.fixture(params=COMMANDS)
def case(request: pytest.FixtureRequest, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Case:
    found = Case(request.param, tmp_path / "where")
    for place, name in (
        *((Algebraic, "grow"), (Algebraic, "sensitivity"), (measure, "measure_batch"), (fit, "run_fit")),
        *((infer, "_begun"), (gradcheck, "check_gradients"), (synthetic_data, "simulate")),
    ):
        monkeypatch.setattr(place, name, found.compute)
    return found


def contents(folder: Path) -> dict[str, bytes]:
    found = {one.relative_to(folder).as_posix(): one for one in folder.rglob("*") if one.is_file()}
    return {name: one.read_bytes() for name, one in found.items()}


def results_of(command: str, out: Path) -> None:
    with results_folder(out, command) as results:
        (results.partial / "old.csv").write_text("old")
        results.finish(inputs=[])


def test_a_new_an_empty_and_an_own_folder_is_taken_and_left_as_it_was_by_a_run_that_fails(case: Case) -> None:
    assert case.run() == 1
    assert not case.out.exists()
    case.out.mkdir(parents=True)
    assert case.run() == 1
    assert not list(case.out.iterdir())
    results_of(case.command, case.out)
    (case.out / "mine.txt").write_text("mine")
    before = contents(case.out)
    assert case.run(*(["--resume"] if case.command == "infer" else [])) == 1
    assert contents(case.out) == before
    assert case.computed == 3


def foreign(case: Case) -> None:
    case.out.mkdir(parents=True)
    (case.out / "mine.txt").write_text("mine")


def of_another(case: Case) -> None:
    results_of("another", case.out)


def unfinished(case: Case) -> None:
    write_json(case.out / WORK / "owner.json", {"command": "another", "files": {"old.csv": ["0"]}})


def of_an_earlier_version(case: Case) -> None:
    write_json(case.out / "manifest.json", {"command": case.command})
    (case.out / "old.csv").write_text("old")


def changed(case: Case) -> None:
    results_of(case.command, case.out)
    (case.out / "old.csv").write_text("by hand")


def a_file(case: Case) -> None:
    case.out.parent.mkdir()
    case.out.write_text("mine")


def below_a_file(case: Case) -> None:
    case.out.parent.write_text("mine")


def too_long(case: Case) -> None:
    if case.command == "synthesize":
        case.out = case.out.parent / ("x" * 300) / "small"
    else:
        case.out = case.out.parent / ("x" * 300)


@pytest.mark.parametrize(
    ("situation", "words"),
    [
        (foreign, "mine.txt, which yeastfit did not write: give another folder"),
        (of_another, "results of yeastfit another: give another folder, or --overwrite to replace its 1 files"),
        (unfinished, "an unfinished run of yeastfit another: give another folder, or repeat that command"),
        (of_an_earlier_version, "an earlier version of yeastfit, whose manifest.json lists no files"),
        (changed, "old.csv, changed since yeastfit wrote it: give another folder, or --overwrite"),
        (a_file, "cannot write to"),
        (below_a_file, "cannot write to"),
        (too_long, "cannot write to"),
    ],
    ids=lambda one: one.__name__ if callable(one) else "",
)
def test_other_folders_are_refused_in_one_line_before_anything_is_computed(
    situation: Callable[[Case], None], words: str, case: Case, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    situation(case)
    before = contents(tmp_path)
    assert case.run() == 2
    (line,) = [line for line in capsys.readouterr().err.splitlines() if not line.startswith("warning: ")]
    assert line.startswith("error: --out: ")
    if case.command == "infer" and situation in (changed, of_an_earlier_version):
        words = "holds a finished run: give --resume to go on with it, or another folder"
    assert words in line
    assert contents(tmp_path) == before
    assert case.computed == 0


@pytest.mark.parametrize("content", [b"", b"{", b"[]", b"[" * 20_000, bytes(9)])
def test_a_damaged_run_is_not_taken_up(content: bytes, tmp_path: Path) -> None:
    (tmp_path / "curves.csv").write_text("mine")
    (tmp_path / "run.json").write_bytes(content)
    with pytest.raises(InputError, match=r"holds a damaged run\.json: give another folder"):
        check_folder(tmp_path, "infer", resume=True)
    with pytest.raises(InputError, match=r"holds curves\.csv, run\.json, which yeastfit did not write"):
        check_folder(tmp_path, "infer", resume=False)


def test_a_folder_in_use_is_refused(case: Case, capsys: pytest.CaptureFixture[str]) -> None:
    with results_folder(case.out, case.command, resume=True):
        assert case.run(*(["--resume"] if case.command == "infer" else [])) == 2
        assert "is in use: process " in capsys.readouterr().err
        assert case.run() == 2  # not: holds a run that was not finished
    assert "is in use: process " in capsys.readouterr().err
    assert case.computed == 0


def test_results_of_another_command_are_overwritten_where_that_is_asked_for(case: Case) -> None:
    of_another(case)
    assert case.run("--overwrite") == 1
    assert case.computed == 1
    assert json.loads((case.out / "manifest.json").read_text())["command"] == "another"  # until there are new ones


def test_half_a_result_is_not_read(case: Case, capsys: pytest.CaptureFixture[str]) -> None:
    if case.command not in ("fit", "infer"):
        pytest.skip("reads no results")
    source = Path(case.sources[case.command][0])
    write_json(source.parent / WORK / "owner.json", {"command": "measure", "files": {}})
    assert case.run() == 2
    assert "holds an unfinished run of yeastfit measure: wait for it, or repeat the command" in capsys.readouterr().err


# --- names of data sets -----------------------------------------------------------------------------------------------


def read(tmp_path: Path, *names: str) -> list[str]:
    """A file of recipes with these names."""
    recipe = RECIPE.split("]", 1)[1]
    quoted = [json.dumps(name, ensure_ascii=False).replace("\x7f", "\\u007f") for name in names]
    (tmp_path / "recipes.toml").write_text("".join(f"[{name}]{recipe}" for name in quoted), encoding="utf-8")
    return list(read_recipes(tmp_path / "recipes.toml"))


@pytest.mark.parametrize(
    "names",
    [[name] for name in ("..", "", ".", ".hidden", "a/b", "../a", "/a", "a\\b", "a:b", "C:", "a\nb", "a\x7f", "con")]
    + [[name] for name in ("x" * 101, "NUL.txt", "lpt1", "a.", "a ", "a*", "\u202ea")],
    ids=str,
)
def test_names_that_are_none_of_a_folder_everywhere_are_refused(tmp_path: Path, names: list[str]) -> None:
    with pytest.raises(InputError, match=r"recipes\.toml: a data set is called .*, need a name that its folder can ha"):
        read(tmp_path, *names)


def test_names_of_one_folder_are_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"data sets are called 'small' and 'Small', which are one folder"):
        read(tmp_path, "small", "Small")


@settings(deadline=None, max_examples=80)
@given(st.text(st.characters(codec="utf-8"), max_size=110))
def test_any_other_name_is_that_of_a_folder_below_out(tmp_path_factory: pytest.TempPathFactory, name: str) -> None:
    where = tmp_path_factory.mktemp("names")
    try:
        (found,) = read(where, name)
    except InputError:
        return
    assert found == name
    (where / "out" / name).mkdir(parents=True)
    assert [one.name for one in (where / "out").iterdir()] == [name]
