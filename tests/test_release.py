"""What a release needs: licence, citation and changelog that agree with the metadata, a version, types."""

import importlib.resources
import re
import tomllib
from importlib.metadata import version
from pathlib import Path

import pytest
from packaging.version import Version

import yeastfit
from yeastfit.commands import app as cli
from yeastfit.errors import InputError
from yeastfit.measure.reading.dataset import read_dataset

ROOT = Path(__file__).parents[1]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]


def cited(field: str) -> str:
    """A field of CITATION.cff that stands at the left edge, in one line."""
    text = (ROOT / "CITATION.cff").read_text(encoding="utf-8")
    (value,) = re.findall(rf"^{field}: (.+)$", text, re.MULTILINE)
    return value.strip('"')


def test_licence_metadata_and_citation_agree() -> None:
    (name,) = PROJECT["license-files"]
    text = (ROOT / name).read_text(encoding="utf-8")
    assert text.startswith(f"{PROJECT['license']} License")
    assert cited("license") == PROJECT["license"]
    (author,) = PROJECT["authors"]
    assert f"Copyright (c) 2026 {author['name']}" in text
    assert f"  - name: {author['name']}" in (ROOT / "CITATION.cff").read_text(encoding="utf-8")


def test_the_citation_names_the_project_and_every_source_of_the_readme() -> None:
    assert cited("cff-version") == "1.2.0"
    assert cited("type") == "software"
    assert cited("title").startswith(PROJECT["name"])
    text = (ROOT / "CITATION.cff").read_text(encoding="utf-8")
    sources = (ROOT / "README.md").read_text(encoding="utf-8").partition("## Sources")[2].partition("\n## ")[0]
    titles = re.findall(r"(?<!\*)\*([^*]+)\*", sources)
    assert len(titles) == 2
    for title in titles:
        assert " ".join(title.split()) in text
    for doi in re.findall(r"doi:(10\.[^\]]+)\]", sources):
        assert doi in text


def test_the_changelog_has_unreleased_changes_and_the_first_version() -> None:
    headings = re.findall(r"^## \[(.+?)\]", (ROOT / "CHANGELOG.md").read_text(encoding="utf-8"), re.MULTILINE)
    assert headings[0] == "Unreleased"
    assert headings[-1] == "0.1.0"
    assert headings[1:] == sorted(headings[1:], key=Version, reverse=True)


def test_the_version_is_that_of_the_installed_package() -> None:
    assert str(Version(yeastfit.__version__)) == yeastfit.__version__ == version("yeastfit")


def test_the_command_line_prints_the_version(capsys: pytest.CaptureFixture[str]) -> None:
    assert cli.run(["--version"]) == 0
    assert capsys.readouterr().out == f"yeastfit {yeastfit.__version__}\n"


@pytest.mark.parametrize("shell", ["bash", "zsh", "fish"])
def test_the_command_line_completes_in_shells(
    shell: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("_TYPER_COMPLETE_TEST_DISABLE_SHELL_DETECTION", "1")
    assert cli.run(["--show-completion", shell]) == 0
    assert "complete" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("typed", "offered"),
    [
        ("yeastfit sim", "simulate"),
        ("yeastfit simulate --mob", "--mobility"),
        ("yeastfit fit --model off", "offlattice"),
        ("yeastfit infer --method abc-s", "abc-smc"),
        ("yeastfit simulate --budding p", "polar"),
    ],
)
def test_words_are_completed(
    typed: str, offered: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("_YEASTFIT_COMPLETE", "complete_bash")
    monkeypatch.setenv("COMP_WORDS", typed)
    monkeypatch.setenv("COMP_CWORD", str(typed.count(" ")))
    assert cli.run([]) == 0
    assert capsys.readouterr().out == f"{offered}\n"


def test_type_checkers_see_the_types() -> None:
    assert importlib.resources.files("yeastfit").joinpath("py.typed").is_file()


@pytest.mark.parametrize("options", [[], ["--quick"]])
def test_the_demo_fits_the_data_set_that_comes_with_the_package(
    options: list[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def look(source: Path, *_: object, **__: object) -> None:
        raise InputError(f"{len(read_dataset(source).frames)} photographs")

    monkeypatch.setattr("yeastfit.commands.fit.check_source", look)
    assert cli.run(["demo", "--out", str(tmp_path), *options]) == 2
    assert capsys.readouterr().err == "error: 110 photographs\n"
