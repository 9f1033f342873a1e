"""`yeastfit measure`: outline the colony in each micrograph and measure it."""

import os
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Annotated, Any

import typer

from yeastfit.commands.console.terminal import fail, out, shown_progress, warn
from yeastfit.commands.generated.options import flag_of
from yeastfit.commands.measure_batch import measure_batch
from yeastfit.commands.options import Jobs, Out, Overwrite
from yeastfit.measure.reading.batch_inputs import find_images
from yeastfit.measure.reading.dataset import Dataset, Frame
from yeastfit.measure.reading.pixel_size import overruled_sizes
from yeastfit.measure.reading.segmentation_options import read_options
from yeastfit.measure.replicate_curves import shrunk_colonies
from yeastfit.processors import available_processors
from yeastfit.report.files.measurement_files import write_results
from yeastfit.report.outcome import Outcome
from yeastfit.results.folder import results_folder

OF_PHOTOGRAPHS = ("threshold", "roi", "colonies")  # options that a ready-made outline leaves no use for


def measure(
    paths: Annotated[
        list[Path],
        typer.Argument(
            help="A data set, or micrographs (TIFF, PNG, JPEG; CZI, ND2, LIF) and folders of them.", show_default=False
        ),
    ],
    folder: Out,
    pixel_size: Annotated[
        float | None, typer.Option(help="Size of a pixel in µm, for images that do not state it themselves.")
    ] = None,
    seed_point: Annotated[
        str | None,
        typer.Option(metavar="X,Y", help="A pixel inside the colony, where another object would be outlined."),
    ] = None,
    threshold: Annotated[
        float | None,
        typer.Option(help="Contrast with the background, in grey levels, above which a pixel belongs to the colony."),
    ] = None,
    roi: Annotated[
        str | None,
        typer.Option(
            metavar="X0,Y0,X1,Y1", help="Region in which to look for the colony: left, top, right, bottom, in pixels."
        ),
    ] = None,
    colonies: Annotated[
        str | None,
        typer.Option(
            metavar="one|all",
            help="Measure one object of an image, or all together. Default: one of a photograph, all of a mask.",
        ),
    ] = None,
    frame: Annotated[
        int | None,
        typer.Option(
            min=1, help="Which image of a time lapse or z-stack to measure, counted from 1, where a file holds several."
        ),
    ] = None,
    overwrite: Overwrite = False,
    jobs: Jobs = None,
) -> None:
    """Outline the colony in each micrograph and measure its shape; lengths are in µm.

    A folder with manifest.csv or manifest.toml is a data set: what the manifest says of an image takes precedence over
    the options given here. In a folder without a manifest every image is measured.

    Writes measurements.csv, masks, overlays to check the outlines by eye, contact_sheet.png, and index.html, a page
    that shows everything; for a data set also the curves of each condition. A file that cannot be measured is reported
    and the others are still measured; the exit code is then 2.
    """
    options: dict[str, Any] = {"seed_point": seed_point, "threshold": threshold, "roi": roi, "colonies": colonies}
    images, dataset, skipped = find_images(paths, pixel_size, read_options(options))
    images = [replace(image, frame=frame) for image in images]
    options |= {"pixel_size": pixel_size, "frame": frame}
    settings = {name: value for name, value in options.items() if value is not None}
    place = dataset.folder if dataset else paths[0] if len(paths) == 1 else folder
    title = f"Micrographs of {os.path.basename(os.path.realpath(place))}"
    manifest = [dataset.manifest] if dataset else []
    reads = [*manifest, *(file for image in images for file in image.files)]
    with results_folder(folder, "measure", reads=reads, overwrite=overwrite) as results:
        with shown_progress("measuring micrographs") as progress:
            outcomes = measure_batch(images, results.partial, jobs=jobs or available_processors(), progress=progress)
        write_results(results.partial, title, outcomes, dataset=dataset, skipped=skipped, settings=settings)
        inputs = [*manifest, *(file for outcome in outcomes if outcome.sha256 for file in outcome.image.files)]
        failed = [
            _as_typed(outcome.error, settings if dataset is None else ()) for outcome in outcomes if not outcome.row
        ]
        if results.finished and len(failed) == len(outcomes):
            fail([*failed, f"no micrograph was measured: the earlier results in {folder} stay"])
        overruled = {image.label: image.options.as_arguments() for image in images if image.options.as_arguments()}
        changed = results.finish(
            inputs=inputs,
            configuration={**settings, "overruled": overruled},
            failed=failed,
            dataset=_from(folder, dataset.manifest) if dataset else None,
            photographs={image.label: _from(folder, image.path) for image in images},
        )
    measured = [outcome for outcome in outcomes if outcome.row]
    warn(changed)
    rows = [outcome.row for outcome in measured if outcome.row]
    warn([*overruled_sizes(rows), *shrunk_colonies(rows)])
    warn(_without_effect(settings, measured, dataset))
    warn([f"{outcome.image.label}: {doubt}" for outcome in measured for doubt in outcome.in_doubt])
    if skipped:
        names = ", ".join(path.name for path in skipped)
        warn([f"passed over, no images by their names, or links to others: {names}"])
    out.print(f"{len(measured)} of {len(images)} micrographs measured. Results in {folder}, on one page: index.html")
    if failed:
        fail(failed)


def _as_typed(error: str, given: Iterable[str]) -> str:
    """What went wrong with an image, by the options that were given rather than by columns of a manifest."""
    for name in given:
        typed = partial(_with_flag, flag_of(name))
        error = re.sub(rf": {name} is (\[[^]]*\])?", typed, error)
    return error


def _with_flag(flag: str, found: re.Match[str]) -> str:
    """The option and its value, of which a manifest has a list."""
    return f": {flag} is " + re.sub(r"[][ ]|\.0\b", "", found[1] or "")


def _without_effect(given: Mapping[str, Any], measured: Sequence[Outcome], dataset: Dataset | None) -> list[str]:
    """Say which options that are given changed nothing of some images: a warning for each."""
    found = []
    for name in given:
        if dataset is not None and all(_says(frame, name) for frame in dataset.frames):
            found.append(f"{flag_of(name)} has no effect: {dataset.manifest.name} says it of every image")
        elif name in OF_PHOTOGRAPHS:
            outlined = [one for one in measured if one.image.outline or (name == "threshold" and one.ready_made)]
            if outlined:
                images = f"{len(outlined)} of {len(measured)} images"
                found.append(f"{flag_of(name)} has no effect on {images}: their outlines are ready-made")
    return found


def _says(frame: Frame, name: str) -> bool:
    """Whether a manifest says an option of an image."""
    return getattr(frame if name == "pixel_size" else frame.options, name, None) is not None


def _from(folder: Path, file: Path) -> str:
    """The way from the results to a file, for who opens them from another place; on another drive all of it."""
    try:
        return Path(os.path.relpath(os.path.abspath(file), os.path.realpath(folder))).as_posix()
    except ValueError:
        return os.path.abspath(file)
