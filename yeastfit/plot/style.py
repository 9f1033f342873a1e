"""What all figures share: colours, and how a figure is written to a file."""

from pathlib import Path

from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from yeastfit.storage import written_whole

COLONY, TRUTH, OUTLINE = "#7a5230", "#1b7837", "#ff4d00"
CONDITIONS = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9", "#000000")  # Okabe and Ito


def save(figure: Figure, path: str | Path) -> None:
    """Write a figure as PNG at 130 dots per inch, whole or not at all.

    Arguments:
        figure: What any function of `yeastfit.plot` returns.
        path: The file to write; folders on the way are made.
    """
    with written_whole(path) as temporary:
        FigureCanvasAgg(figure).print_figure(temporary, dpi=130)
