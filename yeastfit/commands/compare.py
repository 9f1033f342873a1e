"""`yeastfit compare`: runs of infer beside each other."""

import itertools
from pathlib import Path
from typing import Annotated, Any

import typer

from yeastfit.commands.console.terminal import out, warn
from yeastfit.commands.options import Out, Overwrite
from yeastfit.commands.posterior_run.run import COLONIES, LEFT_OUT, POSTERIOR
from yeastfit.commands.run_folder import read_run, run_versions
from yeastfit.errors import InputError
from yeastfit.inference.comparison.left_out import LeftOut
from yeastfit.inference.comparison.runs import ComparedRun, Comparison
from yeastfit.inference.posterior.result import Posterior
from yeastfit.report.files.comparison_files import write_comparison
from yeastfit.report.files.fit_files import OBSERVED
from yeastfit.results.contents import MANIFEST, RUN, check_finished, check_unchanged
from yeastfit.results.folder import results_folder
from yeastfit.text_files import read_csv

OF_THE_RUN = ("settings", "prior", "draws", "prior_draws", "condition", "model", "reuse", "method", "leave_out", "free")


def compare(
    runs: Annotated[list[Path], typer.Argument(help="Folders of runs of `yeastfit infer`, two at least.")],
    folder: Out,
    overwrite: Overwrite = False,
) -> None:
    """Compare posteriors: models on the same colonies, and conditions under the same model.

    Runs on the same colonies are compared by colonies left out (`yeastfit infer --leave-out`): the difference in log
    predictive density with its standard error, and which statistics each does not explain. Of runs under the same model
    on other colonies, the difference and ratio of every parameter, and the probability that it is larger. Exit code 1
    where a posterior has not settled.
    """
    names = _names(runs)
    compared = [_read(path, name) for path, name in zip(runs, names, strict=True)]
    found = Comparison.of(compared)
    reads = [path / name for path in runs for name in (MANIFEST, RUN, POSTERIOR)]
    drawn = {
        name: (path / COLONIES).read_bytes()
        for path, name in zip(runs, names, strict=True)
        if (path / COLONIES).is_file()
    }
    made = {name: str(path) for path, name in zip(runs, names, strict=True)}
    made["versions"] = ", ".join(f"{name} {one}" for name, one in run_versions().items())
    with results_folder(folder, "compare", reads=reads, overwrite=overwrite) as results:
        write_comparison(results.partial, found, drawn, made)
        changed = results.finish(inputs=reads, doubts=found.doubts, verdicts=found.sentences())
    warn([*changed, *found.doubts])
    for sentence in found.sentences():
        out.print(sentence, highlight=False)
    out.print(f"Results in {folder}, on one page: index.html")
    if not found.settled:
        raise typer.Exit(1)


def _names(runs: list[Path]) -> list[str]:
    """Of each run, as short as tells them apart: the name of its folder, with as many of those above it as it takes."""
    where = [path.resolve() for path in runs]
    if len(set(where)) < len(where):
        raise InputError(f"runs: {next(one for k, one in enumerate(runs) if where[k] in where[:k])} is given twice")
    ways = ([str(Path(*path.parts[-count:])) for path in where] for count in itertools.count(1))
    return next(names for names in ways if len(set(names)) == len(names))


def _read(path: Path, name: str) -> ComparedRun:
    """A finished run."""
    if not path.exists():
        raise InputError(f"{path}: there is no such folder")
    if not (path / RUN).is_file():
        raise InputError(f"{path} holds no {RUN}, need the folder of a run of yeastfit infer")
    check_finished(path)
    check_unchanged(path, (RUN, POSTERIOR, LEFT_OUT, OBSERVED))
    known: dict[str, Any] = read_run(path / RUN)
    configuration = known["configuration"]
    left_out = LeftOut.load(path / LEFT_OUT) if (path / LEFT_OUT).is_file() else None
    data = (str(configuration.get("condition") or ""), *sorted(known["inputs"].values()))
    settings = {name: value for name, value in configuration.items() if name not in OF_THE_RUN}
    posterior = Posterior.load(path / POSTERIOR)
    observed = _observed(path / OBSERVED)
    return ComparedRun(name, str(configuration.get("model", "")), data, settings, posterior, left_out, observed)


def _observed(path: Path) -> tuple[dict[str, float], ...]:
    """What a run's table of single colonies has of each; nothing where there is no table."""
    found: dict[str, dict[str, float]] = {}
    for _, row in read_csv(path)[1] if path.is_file() else ():
        found.setdefault(row["colony"], {})[f"{row['statistic']} at {row['hours']}"] = float(row["value"])
    return tuple(found.values())
