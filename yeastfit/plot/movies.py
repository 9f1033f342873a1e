"""Movies of growing colonies: GIF by Pillow, and MP4 where ffmpeg is installed."""

from collections.abc import Sequence
from pathlib import Path

from matplotlib.animation import AbstractMovieWriter, FFMpegWriter, PillowWriter
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from yeastfit.panel import Panel
from yeastfit.plot.simulations import draw_panels
from yeastfit.storage import written_whole

PER_SECOND = 8  # frames
DOTS = 70  # per inch: small enough for a page


def movie(frames: Sequence[Sequence[Panel]], path: str | Path) -> list[Path]:
    """Write a movie as PATH.gif and, where ffmpeg is installed, as PATH.mp4.

    Arguments:
        frames: What each frame shows; all of the same panels, in order of time.
        path: Without suffix.

    Returns:
        The files.
    """
    kinds: dict[str, type[AbstractMovieWriter]] = {".gif": PillowWriter}
    if FFMpegWriter.isAvailable():
        kinds[".mp4"] = FFMpegWriter
    written = []
    for suffix, writer in kinds.items():
        whole = Path(f"{path}{suffix}")
        with written_whole(whole) as temporary:
            _write(frames, temporary, writer(fps=PER_SECOND), suffix)
        written.append(whole)
    return written


def _write(frames: Sequence[Sequence[Panel]], path: Path, writer: AbstractMovieWriter, suffix: str) -> None:
    figure = Figure(figsize=(0.3 + 4.6 * len(frames[0]), 4.4), layout="constrained")
    FigureCanvasAgg(figure)
    named = path.with_name(path.name + suffix)  # writers take the format from the suffix
    with writer.saving(figure, str(named), DOTS):
        for panels in frames:
            figure.clear()
            draw_panels(figure, panels)
            writer.grab_frame()
    named.replace(path)
