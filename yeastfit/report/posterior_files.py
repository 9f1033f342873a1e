"""What `yeastfit infer` leaves of a posterior: tables, pictures, and one page of it all.

posterior.csv, diagnostics.json, predictive.csv, predictive.npz, posterior.nc where ArviZ is installed, pictures, and
index.html. All can be made again from samples.npz and predictive.npz.
"""

import importlib.util
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Bool, Float
from rich.box import SIMPLE
from rich.table import Table

from yeastfit import plot
from yeastfit.inference.colony_simulator import OUTLINE_PIXEL
from yeastfit.inference.posterior.arviz import to_netcdf
from yeastfit.inference.posterior.diagnostics import Diagnostics, diagnose
from yeastfit.inference.posterior.predictive_check import Predictive
from yeastfit.inference.posterior.prior import Prior
from yeastfit.inference.posterior.samples import Samples
from yeastfit.inference.targets_from_table import rows_of
from yeastfit.measure.reading.images import read_image
from yeastfit.report.posterior_page import infer_page
from yeastfit.storage import write_json, write_table, written_whole

SHARES = {"q05": 0.05, "median": 0.5, "q95": 0.95}


@dataclass(frozen=True)
class Results:
    """A posterior, judged. warnings: all that is to be said of it. truth: λ, where known."""

    samples: Samples
    prior: Prior
    predictive: Predictive
    chains: Diagnostics | None
    truth: Mapping[str, float] | None
    warnings: list[str]

    @staticmethod
    def of(
        samples: Samples, prior: Prior, found: Predictive, truth: Mapping[str, float] | None, doubts: Sequence[str]
    ) -> "Results":
        """With the diagnostics of the chains, in the prior's coordinates; weighted draws have none."""
        chains = None
        if not samples.weighted:
            x = prior.coordinates(samples.flat).reshape(samples.values.shape)
            acceptance = samples.acceptance
            if len(acceptance) != len(x):  # one chain of draws that happen to have one weight
                acceptance = np.full(len(x), acceptance[-1])
            chains = diagnose(x, free=samples.free, acceptance=acceptance)
        said = [*samples.warnings, *(chains.sentences() if chains else []), *found.sentences(), *doubts]
        return Results(samples, prior, found, chains, truth, list(dict.fromkeys(said)))

    @property
    def effective_size(self) -> Float[np.ndarray, " free"]:
        """Of chains as `diagnose` has it, of weighted draws as `Samples` has it."""
        return self.chains.effective_size if self.chains else self.samples.effective_size

    def rows(self) -> list[dict[str, Any]]:
        """posterior.csv."""
        samples = self.samples
        quantiles = {name: samples.quantile(share) for name, share in SHARES.items()}
        table = []
        for k, name in enumerate(samples.free):
            row: dict[str, Any] = {"parameter": name, "mean": float(samples.mean[k]), "sd": float(samples.sd[k])}
            row |= {label: float(values[k]) for label, values in quantiles.items()}
            row["effective_size"] = float(self.effective_size[k])
            if self.truth:
                true = self.truth[name]
                row |= {"truth": true, "inside_90": row["q05"] <= true <= row["q95"]}
            table.append(row)
        return table

    def diagnostics(self) -> dict[str, Any]:
        """diagnostics.json."""
        samples = self.samples
        return {
            "method": samples.method,
            "simulations": samples.simulations,
            "seconds": samples.seconds,
            "draws": int(samples.weights.size),
            "effective_size": dict(zip(samples.free, self.effective_size.tolist(), strict=True)),
            "acceptance": samples.acceptance,
            "chains": self.chains.asdict() if self.chains else None,
            "predictive_p_value": self.predictive.p_value,
            "observations_inside_90": int(self.predictive.inside(0.9).sum()),
            "observations": len(self.predictive.observed),
            "method_own": samples.diagnostics,
            "warnings": self.warnings,
        }

    def table(self) -> Table:
        """For a terminal, of 80 columns at least. draws: effective ones."""
        shown = Table(box=SIMPLE, padding=0)
        shown.add_column("parameter", no_wrap=True)
        columns = ["mean", "sd", "5 %", "median", "95 %", "draws", *(["true", "in 90 %"] if self.truth else [])]
        for name in columns:
            shown.add_column(name, justify="right", no_wrap=True)
        for row in self.rows():
            cells = [row["parameter"], *(f"{row[name]:.3g}" for name in ("mean", "sd", *SHARES))]
            cells.append(f"{row['effective_size']:.0f}")
            shown.add_row(*cells, *([f"{row['truth']:.3g}", "yes" if row["inside_90"] else "no"] if self.truth else []))
        return shown

    def lines(self) -> list[str]:
        """Diagnostics for a terminal."""
        said = []
        if self.chains:
            chains = self.chains
            said.append(
                f"{chains.chains} chains of {chains.draws} draws, {chains.lengths.min():.0f} autocorrelation times of "
                f"{chains.times.max():.1f} draws or more; split R̂ at most {np.nanmax(chains.r_hat, initial=1.0):.3f}; "
                f"acceptance {self.samples.acceptance.mean():.1%}"
            )
        else:
            said.append(
                f"{len(self.samples.acceptance)} populations, the last of {self.samples.weights.size} weighted draws; "
                f"acceptance {', '.join(f'{one:.1%}' for one in self.samples.acceptance)}"
            )
        inside, of = int(self.predictive.inside(0.9).sum()), len(self.predictive.observed)
        said.append(
            f"posterior predictive: {inside} of {of} observations in the 90 % band, p {self.predictive.p_value:.2f}"
        )
        return said


@dataclass(frozen=True)
class Photograph:
    """An observed colony: title, grey values where there are some, mask, µm per pixel."""

    title: str
    pixels: np.ndarray | None
    mask: Bool[np.ndarray, "row column"]
    pixel_size: float


def photographs(
    rows: Sequence[Mapping[str, Any]], folder: Path, images: Path, condition: str | None, most: int = 6
) -> list[Photograph]:
    """Some colonies at their last time. folder: of the masks; images: where the photographs may lie."""
    own = rows_of(rows, condition)
    last = max(row["hours"] for row in own)
    found = []
    for row in [row for row in own if row["hours"] == last and (folder / str(row["mask"])).is_file()][:most]:
        mask = read_image(folder / str(row["mask"])) > 0
        path = images / str(row["file"])
        pixels = read_image(path) if path.is_file() else None
        pixels = None if pixels is None or pixels.shape != mask.shape else pixels
        found.append(Photograph(f"colony {row['replicate']}, {last:g} h", pixels, mask, float(row["um_per_pixel"])))
    return found


def write_results(
    folder: Path,
    results: Results,
    targets: Any,
    seen: Sequence[Photograph],
    grown: Sequence[np.ndarray],
    made: Mapping[str, Any],
) -> list[str]:
    """All files but the manifest; what is to be said of them. made: what the page says of the run."""
    samples, found = results.samples, results.predictive
    write_table(folder / "posterior.csv", results.rows())
    write_json(folder / "diagnostics.json", results.diagnostics())
    rows = zip(found.rows(), targets.clock[np.argwhere(targets.measured)[:, 1]].tolist(), strict=True)
    write_table(folder / "predictive.csv", [{targets.clock_label: round(time, 6), **row} for row, time in rows])
    found.save(folder / "predictive.npz")
    figures = {"corner": plot.corner(samples, results.prior, results.truth)}
    figures["traces"] = plot.traces(samples)
    if results.chains and results.chains.chains > 1:
        figures["ranks"] = plot.ranks(results.chains)
    figures["predictive"] = plot.predictive(found, targets)
    hours = targets.clock[-1]
    pairs = [
        (f"{_described(found, k)}, {hours:.3g} h", one, OUTLINE_PIXEL * targets.imaging.scales.length)
        for k, one in enumerate(grown)
    ]
    observed = [(one.title, one.pixels, one.mask, one.pixel_size) for one in seen]
    figures["colonies"] = plot.colonies(observed, pairs)
    if "rounds" in samples.diagnostics:
        figures["emulator"] = plot.held_out(samples.diagnostics["rounds"], samples.labels)
    for name, figure in figures.items():
        plot.save(figure, folder / f"{name}.png")
    pictures = {name: (folder / f"{name}.png").read_bytes() for name in figures}
    with written_whole(folder / "index.html") as temporary:
        temporary.write_text(infer_page(results, pictures, made, seen=bool(seen)), encoding="utf-8")
    if importlib.util.find_spec("arviz") is None:
        return ["posterior.nc is left out: ArviZ is not installed (pip install yeastfit[arviz])"]
    to_netcdf(samples, folder / "posterior.nc", found)
    return []


def _described(found: Predictive, k: int) -> str:
    digits = (f"{value:.{max(0, 2 - math.floor(math.log10(abs(value) or 1)))}f}" for value in found.values[k].tolist())
    return ", ".join(digits)
