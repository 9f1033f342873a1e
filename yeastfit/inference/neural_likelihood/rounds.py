"""What a run of the sequential emulator reports."""

from dataclasses import dataclass
from typing import Any

from yeastfit.inference.neural_likelihood.cross_validation import CrossValidation
from yeastfit.inference.posterior.diagnostics import Diagnostics


@dataclass(frozen=True)
class RoundDiagnostics:
    """One round.

    Attributes:
        simulations: So far, those of other runs included.
        failed: How many of those that the emulator was trained on were failures.
        moved: Change of the posterior from the round before, in standard deviations of the parameter that moved most.
        error_share: The emulator's share of error (`error_share`).
        settled: Whether both are small enough.
        cross_validation: Of held-out simulations.
    """

    simulations: int
    failed: int
    moved: float
    error_share: float
    settled: bool
    cross_validation: CrossValidation


@dataclass(frozen=True)
class EmulatorDiagnostics(Diagnostics):
    """What a run of the sequential emulator reports.

    Attributes:
        rounds: One after the other.
        steps: Of every chain of the last round, burn-in included.
        reused: Simulations of other runs that the emulator was trained on.
        elsewhere: Of each look elsewhere, the share of the posterior that was found far from where it had settled.
    """

    caption = (
        "Networks learn the mean and the scatter of the statistics, round by round where the posterior is, and from "
        "the simulations around it alone as soon as it hardly moves. Moved: "
        "change of the posterior from the round before, in standard deviations of the parameter that changed most. "
        "Error share: of the emulator's own error in the variance that data are compared with. "
        "A posterior that has settled is looked at from further away, with half as many simulations as a round has."
    )

    rounds: tuple[RoundDiagnostics, ...]
    steps: int
    reused: int
    elsewhere: tuple[float, ...] = ()

    def sentences(self) -> list[str]:
        """What the last round's cross-validation finds."""
        return self.rounds[-1].cross_validation.sentences()

    def rows(self) -> list[dict[str, Any]]:
        """One row per round."""
        return [
            {
                "round": k,
                "simulations": one.simulations,
                "failed": one.failed,
                "moved_sd": one.moved,
                "error_share_%": 100 * one.error_share,
            }
            for k, one in enumerate(self.rounds, start=1)
        ]
