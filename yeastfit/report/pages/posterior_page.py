"""The page of a posterior: doubts first, then parameters, the check against the data, chains, and how it was made."""

from collections.abc import Mapping
from typing import Any

from yeastfit.inference.comparison.left_out import LeftOut
from yeastfit.inference.targets import Targets
from yeastfit.report import html as page
from yeastfit.report.learnt import learnt_by_posterior
from yeastfit.report.posterior_summary import FEW, Summary
from yeastfit.text import capitalised

WIDEST = 8  # statistics side by side in a table
IN_UNITS = "90 % interval in units"
ALT = {
    "corner": "Posterior of every parameter and pair of parameters, with the prior",
    "traces": "Every parameter along the chains, or the weights of the draws",
    "ranks": "Ranks of the draws of every chain; grey: two standard deviations of chance",
    "predictive": "Predicted curves over the data",
    "colonies": "Simulations at draws of the posterior, below photographs where there are any",
    "left_out": "Colonies that were left out, over what the others predict: intervals of 50 and 90 %",
    "emulator": "Residuals of simulations held out from the emulator",
}


def posterior_page(
    summary: Summary, targets: Targets, pictures: Mapping[str, bytes], made: Mapping[str, str], *, photographed: bool
) -> str:
    """One HTML file.

    Arguments:
        summary: Of the posterior.
        targets: The data.
        pictures: PNG by name, see `ALT`.
        made: How the run was made: versions, settings.
        photographed: Whether there are photographs among the pictures.
    """
    posterior, predicted = summary.posterior, summary.predicted
    inside = "no" if predicted is None else str(int(predicted.inside(0.9).sum()))
    lead = page.facts(
        [
            (posterior.method, "method"),
            (page.number(posterior.simulations), "simulations"),
            (page.number(round(float(posterior.effective_size.min()))), "independent draws, at least"),
            (f"{inside} of {len(posterior.observed)}", "observations in the 90 % band"),
        ]
    )
    sections = [
        ("Doubts", _doubts(summary)),
        ("Parameters", _parameters(summary) + _figure(pictures, "corner")),
        (
            "The data, predicted",
            _predicted(summary) + _figure(pictures, "predictive") + _predictions(summary) + _single(targets, summary),
        ),
    ]
    if "colonies" in pictures:
        words = (_PHOTOGRAPHS if photographed else "") + _drawn(summary)
        sections.append((summary.model.nouns[1].capitalize(), words + _figure(pictures, "colonies")))
    if summary.left_out is not None:
        sections.append(("Colonies left out", _left_out(summary.left_out) + _figure(pictures, "left_out")))
    sections.append(
        ("Chains" if posterior.chains else "Draws", _chains(summary) + _figure(pictures, "traces", "ranks"))
    )
    if method := _method(summary):
        sections.append(("Method", method + _figure(pictures, "emulator")))
    sections.append(("How this was made", page.pairs(made.items())))
    single = "colonies.csv, " if targets.colonies else ""
    foot = (
        f'<p class="soft">Numbers: targets.csv, {single}posterior.csv, predictive.csv, diagnostics.json; draws: '
        "posterior.npz.</p>"
    )
    return page.document("Posterior of the parameters", lead, sections, foot)


_VARIATION = (
    "Each colony has its own {}, scattered about the condition's: colony variation is the standard deviation of "
    "logarithms, of the logits of shares and probabilities. {}."
)
_PHOTOGRAPHS = (
    "<p>Above, photographs at the last time, with what was taken for the colony; that alone where they are not at "
    "hand.</p>"
)


def _drawn(summary: Summary) -> str:
    one, names = summary.model.nouns[0], ", ".join(name.replace("_", " ") for name in summary.posterior.free)
    end = "to the last time of the data" if summary.model.timed else "to the size at which they are compared"
    return (
        f"<p>One {page.text(one)} each, simulated at draws of the posterior {end}, all on one scale; numbers above "
        f"them are {page.text(names)}.</p>"
    )


def _doubts(summary: Summary) -> str:
    status = "" if summary.posterior.settled else f"<p>{page.text(str(summary.posterior.status))}.</p>"
    if not summary.warnings:
        return status or "<p>None.</p>"
    items = "".join(f"<li>{page.text(one)}</li>" for one in summary.warnings)
    return f'{status}<div class="note doubt"><ul>{items}</ul></div>'


def _parameters(summary: Summary) -> str:
    rows = [{**row, "parameter": row["parameter"].replace("_", " "), **_units(summary, row)} for row in summary.rows()]
    columns = [page.Column(name, words=name in ("parameter", "inside_90", IN_UNITS)) for name in rows[0]]
    truth = " The truth is beside them." if summary.truth else ""
    words = (
        "<p>Mean, standard deviation and quantiles of each parameter; q05 to q95 is the central 90 % "
        f"interval.{truth}</p>"
    )
    if summary.absent is not None:
        said = _VARIATION.format(summary.varying or "parameters", capitalised(summary.variation))
        words = f"<p>{page.text(said)}</p>{words}"
    words = f"<p>{page.text(learnt_by_posterior(summary.posterior, summary.model))}</p>{words}"
    return words + page.table("Posterior of every parameter", columns, _cells(rows), ["corner"] * len(rows))


def _units(summary: Summary, row: Mapping[str, Any]) -> dict[str, str]:
    """The 90 % interval in µm and hours, where any parameter has such a unit."""
    model, free = summary.model, summary.posterior.free
    units = {name: model.unit_of(name) if name in model.parameters else (1.0, "") for name in free}
    if not any(unit for _, unit in units.values()):
        return {}
    factor, unit = units[row["parameter"]]
    ends = f"{page.number(factor * row['q05'])} to {page.number(factor * row['q95'])} {unit}"
    return {IN_UNITS: ends if unit else ""}


def _predicted(summary: Summary) -> str:
    predicted, (one, several) = summary.predicted, summary.model.nouns
    if predicted is None:
        return "<p>No prediction: too few simulations at draws of the posterior succeeded, see the doubts.</p>"
    what = f"one {one}" if predicted.replicates == 1 else f"the mean of {predicted.replicates} {several}"
    words = (
        f"At {len(predicted.values)} draws of the posterior {what} was simulated anew. Where the model is right, about "
        f"90 % of the observations lie in the wider band. All together p is {predicted.p_value:.2f}: the share of "
        f"predictions that lie as far from their mean as the data do. {summary.model.units}"
    )
    return f"<p>{page.text(words.strip())}</p>"


def _predictions(summary: Summary) -> str:
    if summary.predicted is None:
        return ""
    rows = summary.predicted.rows()
    columns = [page.Column(name, words=name in ("statistic", "inside_90")) for name in rows[0]]
    table = page.table("Observed statistics and their predictions", columns, _cells(rows), ["predictive"] * len(rows))
    return f"<details><summary>All {len(rows)} statistics</summary>{table}</details>"


def _single(targets: Targets, summary: Summary) -> str:
    """Statistics of the single colonies, where they are few enough for a table."""
    if targets.curves is None or not targets.colonies or len(targets.points) > WIDEST:
        return ""
    values = targets.curves[:, targets.measured]
    columns = [page.Column(summary.model.nouns[0], words=True), *(page.Column(name) for name in targets.points)]
    rows = [[name, *row] for name, row in zip(targets.colonies, values.tolist(), strict=True)]
    words = f"Statistics of every single {summary.model.nouns[0]}"
    table = page.table(words, columns, rows, ["predictive"] * len(rows))
    return f"<details><summary>{page.text(words)}</summary>{table}</details>"


def _left_out(found: LeftOut) -> str:
    rows = found.rows()
    columns = [page.Column(name, words=name in ("statistic", "fails")) for name in rows[0]]
    words = (
        f"{found.sentence()}. Log densities are in units of the standard deviations between colonies. Inside: colonies "
        "in the predicted interval. Offset: of the observed from the predicted, in predicted standard deviations."
    )
    table = page.table("Statistics of colonies left out", columns, _cells(rows), ["left_out"] * len(rows))
    return f"<p>{page.text(capitalised(words))}</p>{table}"


def _chains(summary: Summary) -> str:
    posterior, chains = summary.posterior, summary.posterior.chains
    if chains is None:
        return f"<p>{posterior.weights.size} {'weighted draws' if posterior.weighted else FEW}.</p>"
    columns = [
        page.Column("parameter", words=True),
        page.Column("autocorrelation_time", "draws"),
        page.Column("length", "autocorrelation times"),
        page.Column("effective_size", "draws"),
        page.Column("split_R̂"),
        page.Column("ranks", "p"),
    ]
    numbers = (chains.times, chains.lengths, chains.effective_size, chains.r_hat, chains.unequal)
    cells = [[name.replace("_", " "), *(float(one[k]) for one in numbers)] for k, name in enumerate(chains.free)]
    least, most = (f"{100 * one:.1f}" for one in (posterior.acceptance.min(), posterior.acceptance.max()))
    accepted = f"{least} %" if least == most else f"{least} to {most} %"
    several = "1 chain" if chains.chains == 1 else f"{chains.chains} chains"
    each = "" if chains.chains == 1 else " each"
    words = f"<p>{several} of {chains.draws} draws{each}; {accepted} of the proposals were accepted.</p>"
    return words + page.table("Diagnostics of the chains", columns, cells, ["traces"] * len(cells))


def _method(summary: Summary) -> str:
    """What the method reports of its own run; empty where it reports nothing."""
    diagnostics = summary.posterior.diagnostics
    parts = [f"<p>{page.text(diagnostics.caption)}</p>"] if diagnostics.caption else []
    if facts := diagnostics.facts():
        parts.append(page.pairs(facts))
    if rows := diagnostics.rows():
        columns = [page.Column(name) for name in rows[0]]
        parts.append(page.table("What the method reports", columns, _cells(rows), ["traces"] * len(rows)))
    return "".join(parts)


def _figure(pictures: Mapping[str, bytes], *names: str) -> str:
    shown = [name for name in names if name in pictures]
    return "".join(page.card(name, pictures[name], ALT[name], page.text(ALT[name])) for name in shown)


def _cells(rows: list[dict[str, Any]]) -> list[list[Any]]:
    """Values of a table, with words for truth values."""
    return [
        [("yes" if value else "no") if isinstance(value, bool) else value for value in row.values()] for row in rows
    ]
