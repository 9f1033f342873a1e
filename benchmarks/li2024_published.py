"""What is stored of the posteriors of Li et al. 2024: summaries of the chains in the repository of their program.

github.com/kaili2019/Li2024-off-lattice, files theta50_21100, theta500_21400 and thetaSW_22000: many short chains end to
end, whose starts are found as rows that share one offset below 0.01 from round numbers. All rows count, as in their
figures.
"""

from dataclasses import dataclass


@dataclass(frozen=True)
class Published:
    """Five numbers a row, in the order of the parameters.

    Attributes:
        rows: Of the file.
        acceptance: Moves per iteration.
        mean: Of all rows.
        low: 5 % quantile.
        median: 50 % quantile.
        high: 95 % quantile.
        error: Standard error of the mean, from the scatter of the chains' means.
        size: Effective size that this error implies.
        early: Mean of each chain's first 100 states.
        last: Mean of the chains' last states.
        last_error: Standard error of that.
        attempts: To place a daughter, per cell, at the mean.
        kept: Cells of N that are drawn, at the mean.
        pseudohyphal: Share of those, at the mean.
    """

    rows: int
    acceptance: float
    mean: tuple[float, ...]
    low: tuple[float, ...]
    median: tuple[float, ...]
    high: tuple[float, ...]
    error: tuple[float, ...]
    size: tuple[int, ...]
    early: tuple[float, ...]
    last: tuple[float, ...]
    last_error: tuple[float, ...]
    attempts: float
    kept: int
    pseudohyphal: float


PUBLISHED_POSTERIORS = {
    "awri796-50um": Published(
        rows=21_100,
        acceptance=0.050,
        mean=(0.6332, 0.6145, 0.2521, 0.1321, 0.1174),
        low=(0.392, 0.223, 0.094, 0.030, 0.025),
        median=(0.654, 0.630, 0.221, 0.119, 0.105),
        high=(0.815, 0.934, 0.531, 0.272, 0.254),
        error=(0.016, 0.027, 0.019, 0.011, 0.008),
        size=(68, 63, 48, 50, 88),
        early=(0.669, 0.573, 0.260, 0.094, 0.112),
        last=(0.611, 0.692, 0.259, 0.172, 0.142),
        last_error=(0.032, 0.032, 0.027, 0.015, 0.017),
        attempts=3.48,
        kept=38_700,
        pseudohyphal=0.097,
    ),
    "awri796-500um": Published(
        rows=21_400,
        acceptance=0.081,
        mean=(0.8054, 0.5507, 0.1631, 0.2554, 0.1674),
        low=(0.672, 0.305, 0.061, 0.093, 0.067),
        median=(0.819, 0.563, 0.162, 0.249, 0.152),
        high=(0.894, 0.779, 0.293, 0.433, 0.305),
        error=(0.007, 0.015, 0.008, 0.010, 0.008),
        size=(94, 83, 89, 104, 90),
        early=(0.843, 0.598, 0.173, 0.243, 0.147),
        last=(0.764, 0.525, 0.180, 0.272, 0.182),
        last_error=(0.014, 0.027, 0.014, 0.019, 0.016),
        attempts=3.70,
        kept=81_900,
        pseudohyphal=0.048,
    ),
    "simi-white-50um": Published(
        rows=22_000,
        acceptance=0.129,
        mean=(0.5648, 0.6921, 0.1931, 0.1779, 0.1558),
        low=(0.317, 0.327, 0.040, 0.034, 0.030),
        median=(0.567, 0.725, 0.165, 0.157, 0.131),
        high=(0.805, 0.939, 0.441, 0.401, 0.360),
        error=(0.012, 0.018, 0.010, 0.012, 0.009),
        size=(137, 117, 152, 101, 160),
        early=(0.583, 0.757, 0.261, 0.175, 0.129),
        last=(0.585, 0.668, 0.179, 0.184, 0.138),
        last_error=(0.031, 0.040, 0.023, 0.024, 0.021),
        attempts=3.55,
        kept=54_700,
        pseudohyphal=0.115,
    ),
}
"""By the names of `yeastfit.LI2024`."""
