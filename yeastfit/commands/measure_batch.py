"""Measure many micrographs, one after another or in several processes.

Each file is read, outlined and measured by itself, and its mask and overlay are written at once. A file that cannot be
measured becomes an `Outcome` that says why, and the others are still measured. Outcomes are in the order of the images
and do not depend on the number of processes.
"""

import multiprocessing
import os
import pickle
import traceback
from collections.abc import Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

import numpy as np

from yeastfit import plot
from yeastfit.commands.console.failures import reason
from yeastfit.errors import InputError, PixelSizeError
from yeastfit.measure.measure_images import measure_file, outlined
from yeastfit.measure.outlining.doubts import DOUBTS
from yeastfit.measure.reading.batch_inputs import InputImage
from yeastfit.measure.reading.images import read_image
from yeastfit.measure.reading.outline_files import write_mask
from yeastfit.measure.statistics.registry import register_missing, registered
from yeastfit.measure.statistics.statistic import Statistic
from yeastfit.progress import Progress, silent
from yeastfit.report.outcome import Outcome
from yeastfit.storage import can_be_hashed, sha256_of, written_whole
from yeastfit.worker_processes import begin, interrupts_held_back

IMAGES_PER_PROCESS = 4  # fewer are measured sooner than another process has started
THREADS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")


def measure_batch(
    images: Sequence[InputImage], folder: Path, *, jobs: int = 1, progress: Progress = silent
) -> list[Outcome]:
    """Measure files, and write the mask and the overlay of each that can be outlined.

    Arguments:
        images: What to measure.
        folder: Where to write masks/NAME.png and overlays/NAME.png.
        jobs: The most processes to use. Each holds one image at a time and uses one processor. A process that dies, for
            lack of memory for instance, costs only its own image.
        progress: Told after each file.

    Returns:
        An outcome for each image.
    """
    for part in ("masks", "overlays"):
        (folder / part).mkdir(parents=True, exist_ok=True)
    outcomes: dict[int, Outcome] = {}
    processes = min(jobs, -(-len(images) // IMAGES_PER_PROCESS))
    finished = _in_processes(images, folder, processes) if processes > 1 else _one_by_one(images, folder)
    for number, outcome in finished:
        outcomes[number] = outcome
        progress(f"measured {len(outcomes)} of {len(images)}", len(outcomes) / len(images))
    return [outcomes[number] for number in range(len(images))]


def _one_by_one(images: Sequence[InputImage], folder: Path) -> Iterator[tuple[int, Outcome]]:
    for number, image in enumerate(images):
        yield number, measure_image(image, folder)


def _in_processes(images: Sequence[InputImage], folder: Path, processes: int) -> Iterator[tuple[int, Outcome]]:
    """Yield outcomes as they come.

    Once a process has died, files are measured one at a time: then the first without an outcome is the one to blame.
    This process does it all where no other can be started, as in a script that does its work while it is imported, and
    where a registered statistic cannot be sent to another one, because its functions cannot be imported.
    """
    waiting = dict(enumerate(images))
    context = multiprocessing.get_context("spawn")  # JAX must not be forked
    while waiting and _can_be_sent(registered()):
        pool = ProcessPoolExecutor(processes, context, begin, (pickle.dumps((register_missing, registered())),))
        try:
            with _settings_for_workers():
                first = pool.submit(os.getpid)
                futures = {pool.submit(measure_image, image, folder): number for number, image in waiting.items()}
            if isinstance(first.exception(), BrokenProcessPool):
                break
            for future in as_completed(futures):
                outcome = future.result()
                del waiting[futures[future]]
                yield futures[future], outcome
        except BrokenProcessPool:
            if processes == 1:
                number, image = next(iter(waiting.items()))
                del waiting[number]
                yield number, Outcome(image, error=f"{image.path}: its process died, perhaps of too little memory")
            processes = 1
        except KeyboardInterrupt:  # of a signal that came to this process alone
            for process in list(pool._processes.values()):
                process.terminate()
            raise
        finally:
            pool.shutdown(cancel_futures=True)  # after the images at hand
    for number, image in waiting.items():
        yield number, measure_image(image, folder)


def _can_be_sent(statistics: Sequence[Statistic]) -> bool:
    """Whether pickle takes them; a function is pickled by where it can be imported from."""
    try:
        pickle.dumps(statistics)
    except (pickle.PicklingError, AttributeError, TypeError):
        return False
    return True


@contextmanager
def _settings_for_workers() -> Iterator[None]:
    """Let processes started inside use one thread each, and hold Ctrl-C back from them until they have begun."""
    added = [name for name in THREADS if name not in os.environ]
    os.environ.update(dict.fromkeys(added, "1"))
    try:
        with interrupts_held_back():
            yield
    finally:
        for name in added:
            del os.environ[name]


def measure_image(image: InputImage, folder: Path) -> Outcome:
    """Measure one file and write its mask and overlay.

    Arguments:
        image: What to measure.
        folder: Where to write the mask and the overlay.

    Returns:
        The outcome, whatever goes wrong; a file that only lacks the size of a pixel is outlined all the same.

    Raises:
        OSError: The mask or the overlay cannot be written.
    """
    try:
        digest = sha256_of(image.path) if can_be_hashed(image.path) else ""
    except OSError:
        digest = ""
    outcome = Outcome(image, sha256=digest)
    try:
        return _measured(outcome, folder)
    except PixelSizeError as error:
        return _outlined(replace(outcome, error=str(error)), folder)
    except InputError as error:
        return replace(outcome, error=str(error))
    except OSError as error:
        if _below(error.filename, folder):  # a full disk is not the image's fault, and costs all of them
            raise
        return replace(outcome, error=f"{image.path}: {reason(error)}")
    except Exception as error:  # a bug met in one file must not cost the others; it is reported with its place
        place = traceback.extract_tb(error.__traceback__)[-1]
        fault = f"{type(error).__name__}: {' '.join(str(error).split())} ({Path(place.filename).name}:{place.lineno})"
        return replace(outcome, error=f"{image.path}: a fault of yeastfit, please report it: {fault}")


def _below(name: object, folder: Path) -> bool:
    """Whether an error is of a file in this folder."""
    return isinstance(name, str | os.PathLike) and Path(name).is_relative_to(folder)


def _measured(outcome: Outcome, folder: Path) -> Outcome:
    """The outcome with its row and thumbnail."""
    image = outcome.image
    measured = measure_file(image.path, image.pixel_size, image.options, image.outline, image.frame)
    doubts, ready_made = measured.segmentation.warnings, measured.segmentation.ready_made
    shape, micrograph = measured.shape, measured.micrograph
    title = f"{image.label}: area {shape.area:.4g} µm², compactness {shape.compactness:.3g}"
    thumbnail = _pictures(
        image, micrograph.pixels, measured.segmentation.mask, title, micrograph.pixel_size, doubts, folder
    )
    known = {"condition": image.condition, "replicate": image.replicate, "hours": image.hours}
    row = {"file": image.label, **known, **measured.row(), "mask": f"masks/{image.name}.png"}
    return replace(outcome, row={**row, "file": image.label}, doubts=doubts, thumbnail=thumbnail, ready_made=ready_made)


def _outlined(outcome: Outcome, folder: Path) -> Outcome:
    """The outcome of an image without pixel size, with its thumbnail where it can be outlined."""
    image = outcome.image
    try:
        pixels = read_image(image.path, image.frame)
        found = outlined(pixels, str(image.path), image.options, image.outline)
    except InputError as error:
        return replace(outcome, error=f"{outcome.error}; {error}")
    title = f"{image.label}: no pixel size, not measured"
    thumbnail = _pictures(image, pixels, found.mask, title, None, found.warnings, folder)
    return replace(outcome, doubts=found.warnings, thumbnail=thumbnail)


def _pictures(
    image: InputImage,
    pixels: np.ndarray,
    mask: np.ndarray,
    title: str,
    pixel_size: float | None,
    doubts: tuple[str, ...],
    folder: Path,
) -> bytes:
    """Write mask and overlay, whole or not at all, and return the thumbnail."""
    with written_whole(folder / "masks" / f"{image.name}.png") as temporary:
        write_mask(temporary, mask, pixel_size)
    figure = plot.overlay(pixels, mask, title, pixel_size, [f"{doubt}: {DOUBTS[doubt]}" for doubt in doubts])
    plot.save(figure, folder / "overlays" / f"{image.name}.png")
    return plot.thumbnail(pixels, mask, image.side)
