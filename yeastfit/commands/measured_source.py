"""The measurements that `yeastfit fit` and `yeastfit infer` start from: read from a table, or made from micrographs."""

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from yeastfit.commands.measure_batch import measure_batch
from yeastfit.errors import InputError
from yeastfit.inference.models.forward_model import ForwardModel, Row, Seen
from yeastfit.measure.measurements_table import (
    NEEDED,
    OF_ANYTHING,
    TABLE,
    checked_rows,
    conditions_of,
    files_of,
    missing_masks,
    read_measurements,
    table_in,
)
from yeastfit.measure.outlining.doubts import to_be_checked
from yeastfit.measure.reading.batch_inputs import dataset_images
from yeastfit.measure.reading.dataset import MANIFESTS, dataset_folder, read_dataset
from yeastfit.measure.reading.pixel_size import overruled_sizes
from yeastfit.measure.replicate_curves import shrunk_colonies
from yeastfit.measure.statistics.registry import STATISTICS, names_with
from yeastfit.progress import Progress
from yeastfit.report.files.measurement_files import write_results
from yeastfit.report.outcome import Outcome
from yeastfit.results.folder import ResultsFolder
from yeastfit.simulation.recipe import read_truth
from yeastfit.text_files import read_csv

MEASURED = "measured"  # folder of a run, of what was measured for it


@dataclass(frozen=True)
class Measurements:
    """A table of measurements.

    Attributes:
        rows: One mapping for each image.
        folder: Where the table and its masks are.
        inputs: Files the table was made from.
        warnings: What went wrong while measuring.
        outcomes: Of micrographs that were measured; none where the table was read.
    """

    rows: list[dict[str, Any]]
    folder: Path
    inputs: list[Path]
    warnings: list[str]
    outcomes: tuple[Outcome, ...] = ()

    def seen(self, model: ForwardModel, chosen: Sequence[str], statistics: Sequence[str]) -> dict[str, Seen]:
        """Make the curves that a model is compared with.

        Arguments:
            model: The model, which decides how.
            chosen: Names of conditions; none chooses the only one there is.
            statistics: Which curves.

        Returns:
            By condition.

        Raises:
            InputError: A condition is not there, or none of several is chosen.
        """
        present = conditions_of(self.rows)
        _check_chosen(chosen, present, several=True)
        return {name: model.seen(self.rows, self.folder, name, statistics) for name in chosen or present}


Images = dict[str, list[Row]]
"""By condition: the row of each image that is there, of which a data set says file, replicate, hours and pixel size."""


def check_source(
    source: Path,
    chosen: Sequence[str],
    columns: Sequence[str] = NEEDED,
    *,
    several: bool = False,
    statistics: Sequence[str] = (),
    jobs: int | None = None,
) -> Images:
    """Check that there are data and conditions of these names, before anything is measured or written.

    Arguments:
        source: A data set, or a table of measurements, or its folder.
        chosen: Names of conditions; none chooses the only one there is.
        columns: What a table must have.
        several: Whether the command takes more than one condition.
        statistics: That will be compared.
        jobs: How many images to measure at once, if that was asked for.

    Returns:
        What is there of these conditions.

    Raises:
        InputError: There are no data, a column or a condition is not there, none of several is chosen, an image has no
            hours or no colony of its own, or jobs are given where nothing is measured.
    """
    wanted = f"a data set, with {' or '.join(MANIFESTS)}, or a {TABLE}"
    if not source.exists():
        raise InputError(f"{source}: there is no such file or folder, need {wanted}")
    table, where = table_in(source), dataset_folder(source)
    rows: list[dict[str, Any]]
    if where is not None:
        data = read_dataset(where)
        for name in statistics:
            if name in STATISTICS and name not in names_with("mask"):
                raise InputError(f"--statistics: no image shows {name!r}, and {source} holds images: leave it out")
        rows = [
            {"file": one.path.name, "condition": one.condition, "replicate": one.replicate, "hours": one.hours}
            | ({} if one.pixel_size is None else {"um_per_pixel": one.pixel_size})
            for one in data.frames
        ]
    elif table.is_file():
        if jobs is not None:
            raise InputError(f"--jobs is given, and {table} holds measurements, so that none is made: leave it out")
        rows = read_measurements(table, columns)
    else:
        raise InputError(f"{source}: no data there, need {wanted}")
    present = conditions_of(rows)
    _check_chosen(chosen, present, several)
    return {name: checked_rows(rows, name) for name in chosen or present}


def hours_of(rows: Sequence[Row]) -> list[float]:
    """Times of images, rising, as far as they are known."""
    return sorted({float(row["hours"]) for row in rows if math.isfinite(row["hours"])})


def colonies_at(rows: Sequence[Row], hours: Sequence[float]) -> tuple[list[str], dict[str, list[bool]]]:
    """Names of colonies, and which of them have an image, by "at 4 hours"."""
    names = list(dict.fromkeys(str(row["replicate"]) for row in rows))
    seen = {(str(row["replicate"]), row["hours"]) for row in rows}
    return names, {f"at {one:g} hours": [(name, one) in seen for name in names] for one in hours}


def measure_source(source: Path, folder: Path, jobs: int, progress: Progress) -> Measurements:
    """Read a table of measurements, or measure a data set as `yeastfit measure` does.

    Arguments:
        source: A data set, or a table of measurements, or its folder.
        folder: Where to write the results of measuring.
        jobs: How many micrographs to measure at once.
        progress: Told how far the measuring is.

    Returns:
        The measurements; images that could not be measured are left out with a warning.

    Raises:
        InputError: The source cannot be read, or nothing in it can be measured.
    """
    table, where = table_in(source), dataset_folder(source)
    if where is None and table.is_file():
        rows = read_measurements(table, OF_ANYTHING)  # others are those that `check_source` has looked for
        return Measurements(rows, table.parent, files_of(table, rows), recorded_warnings(rows, table.parent))
    dataset = read_dataset(where or source)
    images = dataset_images(dataset)
    outcomes = measure_batch(images, folder, jobs=jobs, progress=progress)
    write_results(folder, f"Micrographs of {dataset.folder.resolve().name}", outcomes, dataset=dataset)
    rows = [outcome.row for outcome in outcomes if outcome.row]
    failed = [f"left out: {outcome.error}" for outcome in outcomes if not outcome.row]
    if not rows:
        raise InputError("; ".join(failed))
    doubts = [f"{outcome.image.label}: {doubt}" for outcome in outcomes for doubt in outcome.in_doubt]
    inputs = [dataset.manifest, *(file for outcome in outcomes if outcome.row for file in outcome.image.files)]
    told = failed + overruled_sizes(rows) + shrunk_colonies(rows) + doubts
    return Measurements(rows, folder, inputs, told, tuple(outcomes))


def measure_once(source: Path, results: ResultsFolder, jobs: int, progress: Progress) -> Measurements:
    """`measure_source` in the folder of a run, which keeps what was measured for when it is resumed.

    Arguments:
        source: As of `measure_source`; its files have not changed since.
        results: The folder.
        jobs: As of `measure_source`.
        progress: Likewise.

    Returns:
        The measurements.

    Raises:
        InputError: As `measure_source`.
    """
    place = results.path / MEASURED
    if (place / TABLE).is_file():
        results.check_kept(MEASURED)
        rows = read_measurements(place / TABLE)
        return Measurements(rows, place, [], recorded_warnings(rows, place))
    made = results.partial / MEASURED
    data = measure_source(source, made, jobs, progress)
    return replace(data, folder=results.keep(MEASURED)) if data.folder == made else data


def recorded_warnings(rows: Sequence[Mapping[str, Any]], folder: Path) -> list[str]:
    """Collect what was said when a table was measured, from its rows and the failures.csv beside it.

    Arguments:
        rows: Of measurements.csv.
        folder: Of measurements.csv.

    Returns:
        One sentence for each image left out, each doubt, the first colonies that get smaller, and each condition of
        which a mask is missing; one where files state other pixel sizes than the user.

    Raises:
        InputError: There is a failures.csv that `yeastfit measure` did not write.
    """
    failures, failed = folder / "failures.csv", list[str]()
    if failures.is_file():
        names, left_out = read_csv(failures)
        if not {"file", "error"} <= set(names):
            raise InputError(f"{failures}: no columns file and error, need that of `yeastfit measure`, or none")
        failed = [f"left out: {row.get('error', row.get('file'))}" for _, row in left_out]
    stated = [(row["file"], [one.strip() for one in str(row.get("warnings") or "").split(";")]) for row in rows]
    doubts = [(name, one) for name, found in stated for one in to_be_checked(found) if one]
    told = failed + overruled_sizes(rows) + shrunk_colonies(rows)
    return told + [f"{name}: {one}" for name, one in doubts] + missing_masks(rows, folder)


def truth_of(source: Path, parameters: Iterable[str]) -> dict[str, float]:
    """Read the true parameters of a synthetic data set, for the option --truth.

    Arguments:
        source: The data set, or a table beside the folder truth.
        parameters: Names of those of the model.

    Returns:
        Parameters by name.

    Raises:
        InputError: Nothing is known, or not of this model.
    """
    known = read_truth(source)
    if known is None:
        raise InputError(f"--truth: {source} has no truth/parameters.json beside it, leave --truth out")
    for name in parameters:
        if name not in known:
            raise InputError(f"--truth: {source} was made with {', '.join(known)}, {name} is not known: leave it out")
    return known


def _check_chosen(chosen: Sequence[str], present: Sequence[str], several: bool) -> None:
    """Raise `InputError` where a condition is not there, or none of several is chosen."""
    names = "one without a name" if list(present) == [""] else ", ".join(map(repr, present))
    for name in chosen:
        if list(chosen).count(name) > 1:
            raise InputError(f"--condition: {name!r} appears twice")
        if name not in present:
            raise InputError(f"--condition: got {name!r}, the data have {names}")
    if not chosen and len(present) > 1:
        more = ", or several by giving it again" if several else ""
        raise InputError(f"--condition: the data have {names}; choose one{more}")
