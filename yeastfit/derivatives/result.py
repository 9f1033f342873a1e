"""What a check of derivatives found: `yeastfit.check_derivatives`, `yeastfit.check_gradients`."""

from collections import Counter
from dataclasses import asdict, dataclass, field
from typing import Any

import numpy as np
from jaxtyping import Float

AGREES = "agrees"
VERDICTS = {
    AGREES: "agree",
    "crossed": "were not compared: every step crosses a change of the order of parents, or another discrete decision",
    "uncertain": "could not be compared: differences are all kinks, curvature and rounding",
    "differs": "differ",
    "not finite": "are not finite",
}


@dataclass(frozen=True)
class DerivativeComparison:
    """One derivative by JAX and by another method.

    Attributes:
        by: "differences", or "transpose", which compares ⟨v, J d⟩ with ⟨Jᵀ v, d⟩.
        along: The direction.
        output: Which output, "all" for a transpose.
        index: Of the number within it.
        forward: By forward mode.
        other: By the other method.
        uncertainty: Of both together.
        scale: What tolerance and `error` are relative to: the larger of both derivatives and `check.FLOOR` times the
            value.
        verdict: One of `VERDICTS`.
    """

    by: str
    along: str
    output: str
    index: tuple[int, ...]
    forward: float
    other: float
    uncertainty: float
    scale: float
    verdict: str

    @property
    def error(self) -> float:
        """|forward − other| / scale."""
        return abs(self.forward - self.other) / self.scale if self.scale else 0.0


@dataclass(frozen=True)
class GradientCheck:
    """Result of `check_derivatives` and `check_gradients`.

    Attributes:
        comparisons: All of them.
        tolerance: Relative, of differences.
        times: What the first index of an output stands for, if anything.
        growth_times: When `growth` was seen.
        growth: By direction: how far a unit of it moves, to first order, the node that it moves most.
        remarks: On the model itself.
    """

    comparisons: tuple[DerivativeComparison, ...]
    tolerance: float
    times: tuple[float, ...] = ()
    growth_times: tuple[float, ...] = ()
    growth: dict[str, Float[np.ndarray, " time"]] = field(default_factory=dict)
    remarks: tuple[str, ...] = ()

    @property
    def passed(self) -> bool:
        """Whether all comparisons agree; what could not be compared has not passed."""
        return bool(self.comparisons) and all(c.verdict == AGREES for c in self.comparisons)

    @property
    def counts(self) -> dict[str, int]:
        """How many comparisons came to each verdict."""
        found = Counter(c.verdict for c in self.comparisons)
        return {verdict: found[verdict] for verdict in VERDICTS if found[verdict]}

    def warnings(self) -> list[str]:
        """What does not agree, and what makes derivatives of one colony useless though they are right."""
        bad = {verdict: count for verdict, count in self.counts.items() if verdict != AGREES}
        return [f"{n} of {len(self.comparisons)} derivatives {VERDICTS[v]}" for v, n in bad.items()] + list(
            self.remarks
        )

    def rows(self) -> list[dict[str, Any]]:
        """Tidy table: one row per comparison."""
        return [
            asdict(c) | {"index": " ".join(map(str, c.index)), "time": self._time(c), "error": c.error}
            for c in self.comparisons
        ]

    def summary(self) -> list[dict[str, str]]:
        """In words, a line for each direction: the comparison with differences that is least in order."""
        order, lines = list(VERDICTS), []
        for along in dict.fromkeys(c.along for c in self.comparisons):
            *differences, reverse = (c for c in self.comparisons if c.along == along)
            worst = max(differences, key=lambda c: (order.index(c.verdict), c.error))
            lines.append(
                {
                    "along": along,
                    "worst": self._of(worst),
                    "derivative": f"{worst.forward:.4g}",
                    "error": "" if np.isnan(worst.error) else f"{worst.error:.0e}",
                    "verdict": worst.verdict + ("" if reverse.verdict == AGREES else f", reverse {reverse.verdict}"),
                }
            )
        return lines

    @property
    def status(self) -> str:
        """Passed or not, in a line."""
        several = {AGREES: "agree", "differs": "differ"}
        counts = ", ".join(f"{n} {several.get(verdict, verdict)}" for verdict, n in self.counts.items())
        return f"{'passed' if self.passed else 'not passed'}: of {len(self.comparisons)} derivatives {counts}"

    def __str__(self) -> str:
        lines = [list(line.values()) for line in self.summary()]
        lines.insert(0, list(self.summary()[0]))
        widths = [max(map(len, column)) for column in zip(*lines, strict=True)]
        table = ["  ".join(map(str.ljust, line, widths)).rstrip() for line in lines]
        return "\n".join([*table, self.status, *(f"warning: {line}" for line in self.warnings())])

    def _time(self, c: DerivativeComparison) -> float | None:
        return float(self.times[c.index[0]]) if self.times and c.index else None

    def _of(self, c: DerivativeComparison) -> str:
        time = self._time(c)
        return c.output + (f" t={time:g}" if time is not None else f" {list(c.index)}" if c.index else "")
