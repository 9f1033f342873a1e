"""Photographs of discs, measured by the command line, two of them doubtful."""

from pathlib import Path

import numpy as np
from PIL import Image

from yeastfit.commands import app as cli

SIDE = 120


def disc(radius: float, x: float = 60.0, y: float = 60.0) -> np.ndarray:
    columns, rows = np.arange(SIDE)[None, :], np.arange(SIDE)[:, None]
    return np.hypot(columns - x, rows - y) <= radius


def photograph(path: Path, dark: np.ndarray) -> Path:
    noise = np.random.default_rng(0).normal(0, 2, dark.shape)
    Image.fromarray((np.where(dark, 60, 180) + noise).astype(np.uint8)).save(path)
    return path


def measured(folder: Path) -> tuple[Path, Path]:
    """A data set of three photographs, and its results: `b` has two objects, and nothing can be outlined in `c`."""
    data, results = folder / "data", folder / "results"
    data.mkdir()
    photograph(data / "a.png", disc(30))
    photograph(data / "b.png", disc(25, 40, 40) | disc(15, 90, 90))
    photograph(data / "c.png", np.zeros((SIDE, SIDE), bool))
    rows = ["first,a.png,1,5,0.5", '"b, c",b.png,2,5,0.5', "", ",c.png,3,5,0.5"]
    text = "\r\n".join(["note,file,replicate,hours,um_per_pixel", *rows])
    (data / "manifest.csv").write_bytes(text.encode("utf-8-sig"))  # as spreadsheets write it
    assert cli.run(["measure", str(data), "--out", str(results), "--jobs", "1"]) == 2  # of c
    return data, results
