"""A posterior, judged: its table, its diagnostics and all that is to be doubted."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from rich.box import SIMPLE
from rich.table import Table

from yeastfit.inference.comparison.left_out import LeftOut
from yeastfit.inference.models.forward_model import ForwardModel
from yeastfit.inference.posterior.predictive_check import Predictive
from yeastfit.inference.posterior.result import Posterior
from yeastfit.inference.prior.variation import NAME, absent

FEW = "draws in chains too short to be judged"
SHARES = {"q05": 0.05, "median": 0.5, "q95": 0.95}


@dataclass(frozen=True)
class Summary:
    """A posterior with its predictive check, where simulations of it succeeded.

    Attributes:
        posterior: The draws.
        predicted: Data sets at some of them; None where too few could be simulated.
        truth: True parameters, where known.
        warnings: All that is to be doubted, in words.
        model: What was inferred the parameters of.
        left_out: Colonies predicted by the others, where some were left out.
    """

    posterior: Posterior
    predicted: Predictive | None
    truth: Mapping[str, float] | None
    warnings: list[str]
    model: ForwardModel
    left_out: LeftOut | None = None

    @staticmethod
    def of(
        posterior: Posterior,
        predicted: Predictive | None,
        truth: Mapping[str, float] | None,
        doubts: Sequence[str],
        model: ForwardModel,
        left_out: LeftOut | None = None,
    ) -> "Summary":
        """With the warnings of posterior, predictive check and colonies left out, and further doubts."""
        said = [] if left_out is None else left_out.sentences()
        checked = [] if predicted is None else predicted.sentences()
        warnings = [*posterior.sentences(), *checked, *said, *doubts]
        return Summary(posterior, predicted, truth, list(dict.fromkeys(warnings)), model, left_out)

    @property
    def absent(self) -> float | None:
        """Probability that colonies do not differ in their parameters; None where that was taken for granted."""
        return absent(self.posterior)

    @property
    def varying(self) -> str:
        """Names of the parameters that differ between colonies, where some alone do."""
        return " and ".join(name.replace("_", " ") for name in self.posterior.varying)

    @property
    def variation(self) -> str:
        """What the posterior says of the variation between colonies."""
        before = self.posterior.prior.distributions[NAME].numbers["zero"]
        alone = f", of {self.varying} alone" if self.varying else ""
        return (
            f"variation between colonies{alone}: with probability {self.absent:.2g} there is none ({before:.2g} before "
            "the data)"
        )

    def rows(self) -> list[dict[str, Any]]:
        """Rows of posterior.csv, one per parameter."""
        posterior, rows = self.posterior, []
        quantiles = {name: posterior.quantile(share) for name, share in SHARES.items()}
        columns = {"mean": posterior.mean, "sd": posterior.sd, **quantiles, "effective_size": posterior.effective_size}
        for k, name in enumerate(posterior.free):
            row: dict[str, Any] = {"parameter": name, **{label: float(values[k]) for label, values in columns.items()}}
            if self.truth:
                truth = self.truth.get(name, math.nan)  # data sets do not tell τ
                inside = "" if math.isnan(truth) else row["q05"] <= truth <= row["q95"]
                row |= {"truth": truth, "inside_90": inside}
            rows.append(row)
        return rows

    def diagnostics(self) -> dict[str, Any]:
        """Content of diagnostics.json."""
        posterior, predicted = self.posterior, self.predicted
        return {
            "method": posterior.method,
            "status": posterior.status.name,
            "simulations": posterior.simulations,
            "seconds": posterior.seconds,
            "draws": int(posterior.weights.size),
            "effective_size": dict(zip(posterior.free, posterior.effective_size.tolist(), strict=True)),
            "acceptance": posterior.acceptance,
            "chains": posterior.chains.asdict() if posterior.chains else None,
            "predictive_p_value": None if predicted is None else predicted.p_value,
            "observations_inside_90": None if predicted is None else int(predicted.inside(0.9).sum()),
            "observations": len(posterior.observed),
            **({} if self.absent is None else {"variation_absent": self.absent}),
            **({} if self.left_out is None else {"left_out": self._left_out(self.left_out)}),
            "method_own": posterior.diagnostics.asdict(),
            "warnings": self.warnings,
        }

    @staticmethod
    def _left_out(found: LeftOut) -> dict[str, Any]:
        return {
            "groups": found.groups,
            "log_density": found.total,
            "standard_error": found.standard_error,
            "inside_50": found.coverage(0.5),
            "inside_90": found.coverage(0.9),
            "statistics": found.rows(),
        }

    def table(self) -> Table:
        """For a terminal, of 80 columns at least; `draws` are effective ones."""
        table = Table(box=SIMPLE, padding=0)
        table.add_column("parameter", no_wrap=True)
        columns = ["mean", "sd", "5 %", "median", "95 %", "draws", *(["true", "in 90 %"] if self.truth else [])]
        for name in columns:
            table.add_column(name, justify="right", no_wrap=True)
        for row in self.rows():
            cells = [row["parameter"], *(f"{row[name]:.3g}" for name in ("mean", "sd", *SHARES))]
            cells.append(f"{row['effective_size']:.0f}")
            if self.truth:
                cells += [f"{row['truth']:.3g}", {True: "yes", False: "no"}.get(row["inside_90"], "")]
            table.add_row(*cells)
        return table

    def lines(self) -> list[str]:
        """Diagnostics for a terminal."""
        posterior, predicted = self.posterior, self.predicted
        lines = [str(posterior.status)]
        if posterior.chains:
            chains = posterior.chains
            chain_count = "1 chain" if chains.chains == 1 else f"{chains.chains} chains"
            lines.append(
                f"{chain_count} of {chains.draws} draws, {chains.lengths.min():.0f} autocorrelation times of "
                f"{chains.times.max():.1f} draws or more; split R̂ at most {np.nanmax(chains.r_hat, initial=1.0):.3f}; "
                f"acceptance {posterior.acceptance.mean():.1%}"
            )
        else:
            known = [f"{one:.1%}" for one in posterior.acceptance if np.isfinite(one)]
            accepted = f"; acceptance {', '.join(known)}" if known else ""
            lines.append(f"{posterior.weights.size} {'weighted draws' if posterior.weighted else FEW}{accepted}")
        if predicted is not None:
            inside, count = int(predicted.inside(0.9).sum()), len(predicted.observed)
            lines.append(
                f"posterior predictive: {inside} of {count} observations in the 90 % band, p {predicted.p_value:.2f}"
            )
        if self.absent is not None:
            lines.append(self.variation)
        return lines if self.left_out is None else [*lines, self.left_out.sentence()]
