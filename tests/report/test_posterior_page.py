"""The page of a posterior, opened in a real browser where there is one."""

import re
from pathlib import Path

import pytest
from browser import REPORT, Reader, open_in_browser
from known_colonies import write_measurements

from yeastfit.commands import app as cli
from yeastfit.inference.neural_likelihood import network

LATE = (
    """<script>addEventListener("load", () => {
  const seen = { pictures: [...document.images].map(image => [image.alt, image.naturalWidth, image.complete]) };
  document.querySelector("figure button").click();
  seen.enlarged = [document.querySelector("dialog").open, document.querySelector("dialog img").naturalWidth > 1];
  document.querySelector("dialog form button").click();
  const table = document.querySelector("table");
  const names = () => [...table.tBodies[0].rows].map(row => row.cells[0].textContent);
  const head = [...table.tHead.rows[0].cells].find(cell => cell.textContent.startsWith("mean"));
  seen.sorted = [1, 2].map(() => { head.querySelector("button").click(); return names(); });
"""
    + REPORT
)
PICTURES = {
    "abc-mcmc": ("corner", "predictive", "colonies", "traces", "ranks"),
    "abc-smc": ("corner", "predictive", "colonies", "traces"),
    "emulator": ("corner", "predictive", "colonies", "traces", "ranks", "emulator"),
}
OPTIONS = {
    "abc-mcmc": ["--steps", "20", "--walkers", "4", "--pilot", "96", "--pilot-quantile", "0.2"],
    "abc-smc": ["--population", "48", "--simulations", "300", "--pilot", "96"],
    "emulator": ["--simulations", "64", "--walkers", "4", "--most-steps", "500"],
}
WORDS = {  # a doubt, and what is said of the method further down
    "abc-mcmc": ("chains are too short for mobility", "Draws are simulations within"),
    "abc-smc": ("draws are too few", "Each population keeps"),
    "emulator": ("has not settled", "Networks learn the mean"),
}


def made(folder: Path, method: str) -> str:
    """A page of short chains, or few simulations, which leave doubts."""
    data = write_measurements(folder / "data" / "measurements.csv")
    command = ["infer", str(data), "--out", str(folder / "out"), "--model", "known", "--draws", "12"]
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(network, "STEPS", 100)  # what networks learn is not the matter
        assert cli.run([*command, "--method", method, *OPTIONS[method]]) in (0, 1)
    return (folder / "out" / "index.html").read_text(encoding="utf-8")


@pytest.fixture(scope="module", params=list(PICTURES))
def method(request: pytest.FixtureRequest) -> str:
    return request.param


@pytest.fixture(scope="module")
def page(method: str, tmp_path_factory: pytest.TempPathFactory) -> str:
    return made(tmp_path_factory.mktemp(method), method)


def test_the_page_is_whole(page: str, method: str) -> None:
    read = Reader(page)
    assert read.open == []
    names = [attributes["id"] for _, attributes in read.tags if "id" in attributes]
    assert len(set(names)) == len(names)
    assert set(PICTURES[method]) <= set(names)
    assert {(link["href"] or "")[1:] for link in read.of("a")} <= set(names)
    assert all((image["src"] or "").startswith("data:image/") for image in read.of("img"))
    assert all(image["alt"] for image in read.of("img")[:-1])
    for words in (*WORDS[method], "90 % band", method, "log-uniform", "measurements.csv"):
        assert words in read.words
    assert read.words.index(WORDS[method][0]) < read.words.index("Mean, standard deviation")
    assert "photographs at the last time" not in read.words  # a table without any
    assert not re.search(r"(?:src|href)=[\"'](?!#|data:)", page)
    assert not re.search(r"/tmp|pytest-of", re.sub(r"base64,[A-Za-z0-9+/=]+", "", page))


@pytest.mark.parametrize("width", [1280, 500])
def test_a_browser_shows_it(page: str, method: str, tmp_path: Path, width: int) -> None:
    seen, console = open_in_browser(page, LATE, tmp_path, width)
    assert console == []
    assert seen["faults"] == []
    assert seen["requests"] == []
    assert len(seen["pictures"]) == len(PICTURES[method]) + 1  # and the one that grows
    assert all(wide > 0 and complete for _, wide, complete in seen["pictures"])
    assert seen["enlarged"] == [True, True]
    assert seen["sorted"] == [["aspect ratio", "mobility"], ["mobility", "aspect ratio"]]
    assert seen["wide"] <= 0
