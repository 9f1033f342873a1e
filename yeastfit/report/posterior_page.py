"""The page of a posterior: doubts first, then parameters, the check against the data, chains, and how it was made."""

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from yeastfit.report import html as page

if TYPE_CHECKING:
    from yeastfit.report.posterior_files import Results

ALT = {
    "corner": "Posterior of every parameter and pair of parameters, with the prior",
    "traces": "Every parameter along the chains, or the weights of the draws",
    "ranks": "Ranks of the draws of every chain; grey: two standard deviations of chance",
    "predictive": "Predicted curves over the data",
    "colonies": "Observed colonies above colonies grown from draws of the posterior",
    "emulator": "Residuals of simulations held out from the emulator",
}


def infer_page(results: "Results", pictures: Mapping[str, bytes], made: Mapping[str, Any], *, seen: bool) -> str:
    """One HTML file. pictures: PNG by name, see `ALT`; made: versions, settings. seen: whether photographs are."""
    samples, found = results.samples, results.predictive
    lead = page.facts(
        [
            (samples.method, "method"),
            (page.number(samples.simulations), "simulated data sets"),
            (page.number(round(float(results.effective_size.min()))), "independent draws, at least"),
            (f"{int(found.inside(0.9).sum())} of {len(found.observed)}", "observations in the 90 % band"),
        ]
    )
    sections = [
        ("Doubts", _doubts(results)),
        ("Parameters", _parameters(results) + _figure(pictures, "corner")),
        ("The data, predicted", _predicted(results) + _figure(pictures, "predictive") + _predictions(results)),
        ("Colonies", (_PHOTOGRAPHS if seen else "") + _GROWN + _figure(pictures, "colonies")),
        ("Chains" if results.chains else "Populations", _chains(results) + _figure(pictures, "traces", "ranks")),
    ]
    if "emulator" in pictures:
        sections.append(("Emulator", _emulator(results) + _figure(pictures, "emulator")))
    sections.append(("How this was made", page.pairs(made.items())))
    foot = '<p class="soft">Numbers: posterior.csv, predictive.csv, diagnostics.json; draws: samples.npz.</p>'
    return page.document("Posterior of the parameters", lead, sections, foot)


_PHOTOGRAPHS = "<p>Above, photographs at the last time, with what was taken for the colony.</p>"
_GROWN = (
    "<p>Grown anew, one colony each from draws of the posterior, to the last time of the data, all on one scale; their "
    "titles are λ in the table's order.</p>"
)


def _doubts(results: "Results") -> str:
    if not results.warnings:
        return "<p>None.</p>"
    items = "".join(f"<li>{page.text(one)}</li>" for one in results.warnings)
    return f'<div class="note doubt"><ul>{items}</ul></div>'


def _parameters(results: "Results") -> str:
    rows = results.rows()
    words = ("parameter", "inside_90")
    columns = [page.Column(name, words=name in words) for name in rows[0]]
    cells = [[_said(value) for value in row.values()] for row in rows]
    known = " The truth stands beside." if results.truth else ""
    said = (
        "<p>Mean, standard deviation and quantiles of each parameter λ, dimensionless; q05 to q95 is the central 90 % "
        f"interval.{known}</p>"
    )
    return said + page.table("Posterior of every parameter", columns, cells, ["corner"] * len(rows))


def _predicted(results: "Results") -> str:
    found = results.predictive
    of = "one colony" if found.replicates == 1 else f"the mean of {found.replicates} colonies"
    return (
        f"<p>At {len(found.values)} draws of the posterior {of} was simulated anew. Where the model is right, about "
        f"90 % of the observations lie in the wider band. All together p is {found.p_value:.2f}: the share of "
        "predictions that lie as far from their mean as the data do. Statistics are named by their times in units of "
        "1/μ*; lengths are in L0, areas in L0²; in the picture and in predictive.csv there are hours, too.</p>"
    )


def _predictions(results: "Results") -> str:
    rows = results.predictive.rows()
    columns = [page.Column(name, words=name in ("statistic", "inside_90")) for name in rows[0]]
    cells = [[_said(value) for value in row.values()] for row in rows]
    table = page.table("Observed statistics and their predictions", columns, cells, ["predictive"] * len(rows))
    return f"<details><summary>All {len(rows)} statistics</summary>{table}</details>"


def _chains(results: "Results") -> str:
    samples, chains = results.samples, results.chains
    if chains is None:
        epsilon = samples.diagnostics.get("epsilon", [])
        each = zip(epsilon, samples.acceptance.tolist(), strict=False)
        parts = [
            (f"population {k}", f"ε {one if one is None else page.number(one)}, {100 * share:.1f} % accepted")
            for k, (one, share) in enumerate(each)
        ]
        return page.pairs([*parts, ("ended", samples.diagnostics.get("end", ""))])
    columns = [
        page.Column("parameter", words=True),
        page.Column("autocorrelation_time", "draws"),
        page.Column("length", "autocorrelation times"),
        page.Column("effective_size", "draws"),
        page.Column("split_R̂"),
        page.Column("ranks", "p"),
    ]
    numbers = (chains.times, chains.lengths, chains.effective_size, chains.r_hat, chains.unequal)
    cells = [[name, *(float(one[k]) for one in numbers)] for k, name in enumerate(chains.free)]
    accepted = f"{100 * samples.acceptance.min():.1f} to {100 * samples.acceptance.max():.1f} %"
    words = f"<p>{chains.chains} chains of {chains.draws} draws each; {accepted} of the proposals were accepted.</p>"
    return words + page.table("Diagnostics of the chains", columns, cells, ["traces"] * len(cells))


def _emulator(results: "Results") -> str:
    rounds = results.samples.diagnostics["rounds"]
    columns = [
        page.Column("round"),
        page.Column("simulations"),
        page.Column("failed"),
        page.Column("moved", "sd"),
        page.Column("error_share", "%"),
    ]
    cells = [
        [k, one["simulations"], one["failed"], _number(one["moved"]), 100 * one["error_share"]]
        for k, one in enumerate(rounds, start=1)
    ]
    words = (
        "<p>Networks learn the mean and the scatter of a colony's statistics, round by round where the posterior is. "
        "Moved: by how much the posterior changed from the round before, in standard deviations, of the parameter that "
        "changed most. Error share: of the emulator's own error in the variance that data are compared with.</p>"
    )
    return words + page.table("Rounds of the emulator", columns, cells, ["emulator"] * len(cells))


def _figure(pictures: Mapping[str, bytes], *names: str) -> str:
    parts = []
    for name in names:
        if name in pictures:
            parts.append(page.card(name, pictures[name], ALT[name], page.text(ALT[name])))
    return "".join(parts)


def _said(value: Any) -> Any:
    return ("yes" if value else "no") if isinstance(value, bool) else value


def _number(value: float | None) -> float:
    return float("nan") if value is None else float(value)
