"""Simulated colonies beside real ones: how far they agree, and which are real in the picture."""

from pathlib import Path

import numpy as np
import pytest
from made_posteriors import flat_prior, made_posterior
from PIL import Image
from test_colony_areas import left_out

from benchmarks import likeness, likeness_masks, offlattice_runs
from benchmarks.real_run import CELLS, RealRun
from yeastfit.inference.models.offlattice_drawing import TEXTURE
from yeastfit.measure.measurements_table import TABLE
from yeastfit.offlattice import Ellipses, grow
from yeastfit.offlattice.masks.ellipse_mask import PIXEL
from yeastfit.offlattice.simulator import statistics_of
from yeastfit.results.contents import MANIFEST, RUN
from yeastfit.storage import write_json, write_table

NAME = "awri796-50um"
NAMES = (*TEXTURE, *likeness.FURTHER)
AT = (0.7, 0.8, 0.24, 0.15, 0.08, 0.0, 2.0, 0.0)


@pytest.fixture
def work(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A finished run of one set, all of whose draws are those that its small colonies were made with."""
    rows = []
    for seed in range(8):
        mask = Ellipses.of(grow(AT[:5], cells=2500, seed=seed), margin=AT[6]).mask(2000 + 50 * seed)
        Image.fromarray(np.where(np.pad(mask, 20), 0, 255).astype(np.uint8)).save(tmp_path / f"{seed}.png")
        known = {"file": f"{seed}.png", "condition": "", "replicate": seed, "hours": 233.0, "um_per_pixel": PIXEL}
        rows.append({**known, "mask": "", **statistics_of(mask, PIXEL, ("max_radius", "area", *NAMES))})
    write_table(tmp_path / "data" / NAME / TABLE, rows)
    for one in (likeness_masks, offlattice_runs):
        monkeypatch.setattr(one, "DATA", tmp_path / "data")
    monkeypatch.setitem(CELLS, NAME, 2500)
    folder = tmp_path / NAME
    folder.mkdir()
    prior = flat_prior(*likeness.FREE, "colony_variation")
    made_posterior(np.tile(AT, (4, 10, 1)), prior=prior).save(folder / "posterior.npz")
    left_out(-4.0, outside=1).save(folder / "left_out.npz")
    (folder / MANIFEST).write_text("{}")
    write_json(folder / RUN, {"configuration": {"settings": {"each": 512}}})
    return tmp_path


@pytest.mark.thorough
def test_real_colonies_are_compared_with_simulated_ones_in_all_statistics(
    work: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    run = RealRun(NAME, work / NAME)
    real = offlattice_runs.real_colonies(NAME, NAMES)
    rows = likeness.compare(run, 40)
    assert tuple(row["statistic"] for row in rows) == NAMES
    assert [row["real, median"] for row in rows] == pytest.approx(np.median(real, axis=0).tolist())
    assert np.mean([row["inside 90 %"] for row in rows]) > 0.75
    assert 0.7 < np.mean([row["deviation at one λ / real"] for row in rows]) < 1.4  # all have one λ here
    monkeypatch.setattr(likeness, "real_colonies", lambda name, which: 3 * real)
    assert np.mean([row["inside 90 %"] for row in likeness.compare(run, 40)]) < 0.2


def test_the_page_and_the_picture_are_of_what_is_there(
    work: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(likeness, "COLONIES", 4)
    more = ["--images", str(work), "--grid", str(work / "grid.png")]
    with pytest.raises(SystemExit) as ended:
        likeness.main(["--page", "--work", str(work), "--docs", str(work), *more])
    assert ended.value.code == 0
    page = (work / "likeness.md").read_text(encoding="utf-8")
    assert "Not there yet: AWRI 796, 500 µM." in page
    assert "| AWRI 796, 50 µM: left out, inside 90 % | 0.938 |  | ≥ 0.8 | yes |" in page
    assert "| AWRI 796, 50 µM | yes | 100 | 512 | 94 | 94 | -31.7 ± 0.1 | 0.7 (0.7 to 0.7) |" in page
    assert "## Cores and what surrounds them, medians" in page
    assert all(f"| AWRI 796, 50 µM | {kind} | " in page for kind in ("real", "simulated", "of sated cells alone"))
    with Image.open(work / "grid.png") as image:
        assert image.width > 1000
    (told,) = (line for line in capsys.readouterr().err.splitlines() if "real are" in line)
    real = {int(one) for one in told.rpartition(": ")[2].split(", ")}
    assert len(real) == likeness_masks.EACH
    assert real < set(range(1, 7))


def test_cores_are_as_round_as_they_are_drawn() -> None:
    """A disc of 150 pixels with twelve wedges to 1.25 times its radius; an ellipse, by its own radius."""
    y, x = np.mgrid[-260:261, -260:261]
    radius, angle = np.hypot(x, y), np.arctan2(y, x)
    spokes = (radius <= 1.25 * 150) & (np.abs((angle * 12 / (2 * np.pi)) % 1 - 0.5) < 0.1)
    found = likeness_masks.core((radius <= 150) | spokes)
    assert found["core off a circle, %"] < 0.5
    assert [found[f"pieces at {wider} %"] for wider in (5, 10, 20, 30)] == [12, 12, 12, 0]
    assert found["inside at 5 %, %"] == pytest.approx(20, abs=1.5)
    assert found["inside at 30 %, %"] == 0
    share = 0.2 * 2 * np.pi / 12
    assert found["µm wide 5 to 20 µm out"] == pytest.approx(PIXEL * 158 * share, rel=0.1)
    assert np.isnan(found["µm wide 130 to 180 µm out"])
    turn = np.linspace(0, 2 * np.pi, 1000)
    edge = np.hypot(240 * np.cos(turn), 200 * np.sin(turn))
    off = likeness_masks.core((x / 240) ** 2 + (y / 200) ** 2 <= 1)["core off a circle, %"]
    assert off == pytest.approx(100 * edge.std() / edge.mean(), rel=0.05)


def test_what_differs_between_sets_is_said(work: Path) -> None:
    """Here the margin, 2 µm in one and 3 in the other."""
    other = work / "simi-white-50um"
    other.mkdir()
    rng = np.random.default_rng(0)
    for folder, margin in ((work / NAME, 2.0), (other, 3.0)):
        draws = np.tile([*AT[:6], margin, *AT[7:]], (4, 100, 1)) * rng.uniform(0.95, 1.05, (4, 100, 8))
        made_posterior(draws, prior=flat_prior(*likeness.FREE, "colony_variation")).save(folder / "posterior.npz")
        (folder / MANIFEST).write_text("{}")
    first, *rest = likeness.differences([RealRun(one, work / one) for one in (NAME, "awri796-500um", other.name)])
    assert first.startswith("margin is smaller in AWRI 796, 50 µM than in Simi White, 50 µM by a factor of 1.5")
    (same,) = rest
    assert same.startswith(
        "transition, sated from pseudohyphal, pseudohyphal from sated, fork, any mother, nutrient exponent, "
        "colony variation: AWRI 796, 50 µM and Simi White, 50 µM are not told apart"
    )
