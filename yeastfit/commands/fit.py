"""`yeastfit fit`: fit the model's parameters to measured curves."""

from collections.abc import Mapping, Sequence
from contextlib import nullcontext
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer
from rich.table import Table

from yeastfit.commands.console.terminal import out, shown_progress, warn
from yeastfit.commands.generated.model import ChosenModel, Fitted, ModelOptions, Statistics
from yeastfit.commands.generated.options import generated
from yeastfit.commands.generated.workers import WorkerOptions, paced
from yeastfit.commands.measured_source import Measurements, check_source, hours_of, measure_source, truth_of
from yeastfit.commands.options import (
    Jobs,
    MeasurementError,
    Out,
    Overwrite,
    Seed,
    Truth,
    check_once,
    named_pairs_in,
    names_in,
)
from yeastfit.commands.run_folder import inputs_of
from yeastfit.errors import InputError, SimulationError
from yeastfit.inference.fit.bootstrap_profile import Bootstrap, Profile, explore, profiles
from yeastfit.inference.fit.least_squares import check_search
from yeastfit.inference.fit.least_squares import fit as run_fit
from yeastfit.inference.fit.result import Fit
from yeastfit.inference.fit.settings import FitSettings
from yeastfit.inference.models.forward_model import ForwardModel
from yeastfit.inference.simulator import Simulator
from yeastfit.inference.workers.spread import Workers
from yeastfit.parameter_set import ParameterSet
from yeastfit.processors import available_processors
from yeastfit.report.files.fit_files import write_bootstrap, write_fit, write_profiles, write_targets
from yeastfit.report.pages.fit_page import fit_page
from yeastfit.report.pages.measurement_page import measurement_sections
from yeastfit.report.pictures import as_words
from yeastfit.results.folder import results_folder
from yeastfit.storage import versions, written_whole

MANY_AT_EDGE = 0.02  # of bootstrap draws: from where intervals are visibly too narrow


@generated(chosen=ModelOptions("fit"), workers=WorkerOptions())
def fit(
    source: Annotated[
        Path, typer.Argument(help="A data set, or measurements.csv of `yeastfit measure`.", show_default=False)
    ],
    folder: Out,
    condition: Annotated[
        list[str] | None,
        typer.Option(
            help="Condition whose colonies are fitted; repeat it to fit several together. Needed where the data have "
            "more than one.",
            show_default=False,
        ),
    ] = None,
    free: Fitted = None,
    own: Annotated[
        str,
        typer.Option(help="Names of the fitted parameters that may differ between conditions; the others are shared."),
    ] = "none",
    statistics: Statistics = None,
    bounds: Annotated[
        list[str] | None,
        typer.Option(
            metavar="NAME=LOW:HIGH",
            help="Range in which to search for a parameter; repeat it for several. By default the plausible range.",
            show_default=False,
        ),
    ] = None,
    prior: Annotated[
        list[str] | None,
        typer.Option(
            metavar="NAME=VALUE:WIDTH",
            help="What is known of a parameter beforehand: a value and its standard deviation, as a share of it (0.1 "
            "is 10 %). Repeat it for several.",
            show_default=False,
        ),
    ] = None,
    method: Annotated[
        str, typer.Option(help="How χ² is minimised: levenberg-marquardt, dogleg or bfgs.")
    ] = FitSettings.method,
    starts: Annotated[
        int, typer.Option(min=1, help="Number of places in the search range to start from. More find a better minimum.")
    ] = FitSettings.starts,
    measurement_error: MeasurementError = None,
    bootstrap: Annotated[
        int,
        typer.Option(
            min=0,
            max=1_000_000,
            help="Number of fits to resampled colonies, 500 for instance, for confidence intervals.",
        ),
    ] = 0,
    profile: Annotated[
        bool, typer.Option("--profile", help="Compute the profile likelihood of every fitted parameter.")
    ] = False,
    truth: Truth = False,
    overwrite: Overwrite = False,
    jobs: Jobs = None,
    seed: Seed = 0,
    *,
    chosen: ChosenModel,
    workers: Workers | None,
) -> None:
    """Fit the model's parameters to the colonies of a data set, with standard errors.

    Micrographs are measured first, as `yeastfit measure` does; give its measurements.csv instead to skip that. One
    photograph of each colony is enough with fewer free parameters or more statistics. Writes one page of everything
    (index.html), parameters.csv, fit.json, which yeastfit.Fit.load reads in Python, and pictures of the fit. Ends with
    exit code 1 where the fit did not converge, or --bootstrap or --profile failed.
    """
    model = chosen.forward
    names, fitted = model.statistics_named(names_in(statistics) or model.statistics), names_in(free) or model.fitted
    options: dict[str, Any] = {
        "own": () if own == "none" else names_in(own),
        "bounds": named_pairs_in("--bounds", bounds or (), "the ends of a range"),
        "prior": named_pairs_in("--prior", prior or (), "its centre and width", "mobility=1:0.1"),
    }
    check_once("--own", options["own"])
    settings = FitSettings(method=method, starts=starts, measurement_error=measurement_error)  # type: ignore[arg-type]
    held = model.held(names, model.parameters.subset(fitted).names, chosen.values)
    chosen.check_free(fitted)
    images = check_source(source, condition or (), model.columns, several=True, statistics=names, jobs=jobs)
    hours = {name: hours_of(one) for name, one in images.items()}
    most = sum(len(names) * (max(1, len(times)) if model.timed else 1) for times in hours.values())
    check_search(model.parameters.subset(fitted), condition or ("",), **options, most=most)
    for name, times in hours.items():
        model.check(held | _largest(model.parameters.subset(fitted), options["bounds"]), times)
        model.check_images(images[name], names)
    if workers is not None:
        workers.check()
    nouns = model.nouns
    _check_bootstrap(bootstrap, min(len({row["replicate"] for row in one}) for one in images.values()), nouns)
    known = truth_of(source, model.parameters) if truth else None
    with results_folder(folder, "fit", reads=inputs_of(source), overwrite=overwrite) as results:
        with shown_progress("measuring micrographs") as progress:
            data = measure_source(source, results.partial, jobs or available_processors(), progress)
        seen = data.seen(model, condition or (), names)
        warn(data.warnings + list(dict.fromkeys(note for one in seen.values() for note in one.notes)))
        targets = {"" if len(seen) == 1 else name: one.targets for name, one in seen.items()}
        fewest = min(1 if one.curves is None else len(one.curves) for one in targets.values())
        _check_bootstrap(bootstrap, fewest, nouns)
        write_targets(results.partial, {name: one.targets for name, one in seen.items()})
        both = [one.model.fit_simulators(one.targets, fitted, held) for one in seen.values()]
        coarse, fine = (dict(zip(targets, each, strict=True)) for each in zip(*both, strict=True))
        if measurement_error is None:
            names_compared = next(iter(targets.values())).names
            settings = replace(settings, measurement_error=model.measurement_errors(names_compared, None))
        with workers or nullcontext():
            if workers is not None:
                coarse, fine = ({name: workers.spread(one) for name, one in each.items()} for each in (coarse, fine))
            with shown_progress("fitting") as shown:
                progress = paced(shown, workers, nouns[1])
                result = run_fit(targets, coarse, fine=fine, seed=seed, settings=settings, progress=progress, **options)
            write_fit(results.partial, result, known)
            try:
                lines, explored = _explored(results.partial, result, bootstrap, profile, coarse, fine), True
            except SimulationError as error:  # which must not cost the fit
                lines, explored = [f"no bootstrap and no profile: {error}"], False
        configuration = {**chosen.configuration("fit"), "parameters": held, "free": fitted, **options}
        said = {"condition": ", ".join(filter(None, seen)) or None, **configuration}
        _write_page(results.partial, result, next(iter(seen.values())).model, data, said, known, lines)
        more: dict[str, Any] = {"configuration": configuration, "status": result.message}
        if workers is not None:
            more["workers"] = workers.asdict()
        changed = results.finish(seed=seed, inputs=data.inputs, seconds=result.seconds, **more)
    warn([*changed, *result.warnings])
    out.print(_table(result, known))
    for line in lines:
        out.print(line, highlight=False)
    out.print(
        f"{result.message}; chi-square {result.chi_square:.1f} on {result.degrees_of_freedom} degrees of freedom; "
        f"{result.simulations} simulated {nouns[1]} in {result.seconds:.0f} s. Results in {folder}, on one page: "
        "index.html"
    )
    if not (result.converged and explored):
        raise typer.Exit(1)


def _write_page(
    folder: Path,
    result: Fit,
    model: ForwardModel,
    data: Measurements,
    configuration: Mapping[str, Any],
    known: Mapping[str, float] | None,
    lines: Sequence[str],
) -> None:
    """Write index.html, in the place of that of the measurements, which stand below."""
    curves = folder / "curves.png"
    measured = measurement_sections(data.outcomes, curves.read_bytes() if curves.is_file() else b"")
    made = {**as_words(configuration), "seed": str(result.seed), "seconds": f"{result.seconds:.0f}"}
    made["versions"] = ", ".join(f"{name} {one}" for name, one in versions().items())
    page = fit_page(result, model, folder, made, known, lines, measured if data.outcomes else ())
    with written_whole(folder / "index.html") as temporary:
        temporary.write_text(page, encoding="utf-8")


def _largest(parameters: ParameterSet, bounds: Mapping[str, tuple[float, float]]) -> dict[str, float]:
    """The upper end of where each parameter is searched for, in any condition."""
    ends = {name: [one.plausible[1]] for name, one in parameters.items()}
    for name, (_, high) in bounds.items():
        if (of := name.partition(" of ")[0]) in ends:
            ends[of] = [high] if name == of else [*ends[of], high]
    return {name: max(each) for name, each in ends.items()}


def _check_bootstrap(draws: int, fewest: int, nouns: tuple[str, str]) -> None:
    """Raise `InputError` where there is nothing to be drawn."""
    if draws == 1:
        raise InputError("--bootstrap is 1, it must be 0 or at least 2 fits")
    if draws and fewest < 2:
        raise InputError(
            f"--bootstrap is {draws} and a condition has one {nouns[0]}, need at least two to draw from: use --profile"
        )


def _explored(
    folder: Path, result: Fit, draws: int, profile: bool, coarse: Mapping[str, Simulator], fine: Mapping[str, Simulator]
) -> list[str]:
    """Bootstrap and profiles where they are asked for: their files, and lines for the terminal."""
    if not (draws or profile):
        return []
    with shown_progress("growing colonies around the estimate"):
        explored = explore(result, coarse, fine=fine)
    lines: list[str] = []
    if draws:
        resampled = explored.bootstrap(draws)
        write_bootstrap(folder, resampled, result)
        lines += _bootstrap_lines(resampled)
    if profile:
        found = profiles(explored)
        write_profiles(folder, found)
        lines += _profile_lines(found)
    return lines


def _bootstrap_lines(found: Bootstrap) -> list[str]:
    lines = [
        f"bootstrap of replicates: {name} {found.intervals[name][0]:.4g} to {found.intervals[name][1]:.4g} (95 %)"
        for name in found.free
    ]
    if found.at_edge > MANY_AT_EDGE:
        lines.append(f"{found.at_edge:.0%} of the draws ended where the surface ends: these intervals are too narrow")
    return lines + _unconverged_lines("the bootstrap", found.unconverged, len(found.values))


def _profile_lines(found: Mapping[str, Profile]) -> list[str]:
    lines = []
    for name, each in found.items():
        low, high = (f"{end:.4g}" if np.isfinite(end) else "beyond the surface" for end in each.intervals["95%"])
        lines.append(f"profile of {name}: {low} to {high} (95 %)")
        lines += each.doubts
        lines += _unconverged_lines(f"the profile of {name}", each.unconverged, len(each.values))
    return lines


def _unconverged_lines(what: str, count: int, fits: int) -> list[str]:
    return [f"{count} of {fits} fits of {what} ran into their limit of steps: do not trust it"] if count else []


def _table(result: Fit, known: Mapping[str, float] | None) -> Table:
    """Parameters with their errors, beside the true ones where these are known."""
    rows = result.rows()
    several = "condition" in rows[0]
    columns = ["parameter", "fitted", "standard error", *(["true", "(fitted - true) / error"] if known else [])]
    table = Table(*(["condition"] if several else []), *columns)
    for row in rows:
        value, error = row["value"], row["standard_error"]
        cells = [row["condition"]] if several else []
        cells += [row["parameter"], f"{value:.4g}", "fixed" if error is None else _error(error, value)]
        if known:
            off = "" if error is None or not np.isfinite(error) else f"{(value - known[row['parameter']]) / error:+.1f}"
            cells += [f"{known[row['parameter']]:.4g}", off]
        table.add_row(*cells)
    return table


def _error(error: float, value: float) -> str:
    return f"{error:.2g} ({error / value:.1%})" if np.isfinite(error) else "not determined"
