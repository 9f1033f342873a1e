"""What all figures share: colours, text from users and files, and how a figure is written to a file."""

import textwrap
from functools import cache
from pathlib import Path

import numpy as np
from matplotlib.axis import Axis
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.font_manager import FontProperties, findfont, get_font
from matplotlib.ticker import FixedLocator, FuncFormatter, LogLocator, NullFormatter

from yeastfit.errors import InputError
from yeastfit.kinds import check_kind
from yeastfit.storage import written_whole
from yeastfit.text import shown

COLONY, TRUTH, OUTLINE = "#7a5230", "#1b7837", "#ff4d00"
CONDITIONS = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9", "#000000")  # Okabe and Ito


def literal(text: str, width: int | None = None) -> str:
    r"""Make any text one that matplotlib draws as it is.

    Arguments:
        text: A label, a title, an entry of a legend, or a part of one.
        width: Where to break lines, in characters; by default there is one line.

    Returns:
        The text as `yeastfit.text.shown` writes it, without mathtext, as `$` is escaped; with `\u4e2d` and the like for
        letters that the font lacks; with a space before an underscore at its start, which would hide the entry of a
        legend.
    """
    drawn = "".join(each if _has_glyph(each) else each.encode("unicode_escape").decode() for each in shown(text))
    lines = drawn if width is None else textwrap.fill(drawn, width)
    return (" " if drawn.startswith("_") else "") + lines.replace("$", r"\$")


def words(name: str, width: int | None = None) -> str:
    """Write the name of a parameter or a statistic with spaces, to be drawn as it is; see `literal`."""
    return literal(name.replace("_", " "), width)


def label_log_axis(axis: Axis, low: float, high: float) -> None:
    """Give a logarithmic axis a few plain numbers as labels, also where it is shorter than a decade.

    Arguments:
        axis: `panel.xaxis` or `panel.yaxis`.
        low: Its lower end.
        high: Its upper end.
    """
    decades = np.log10(high / low)
    if decades > 2:
        axis.set_major_locator(LogLocator(numticks=4))
    else:  # evenly on the axis, rounded to numbers that are easy to read
        places = np.geomspace(low, high, 5)[1:-1] if decades > 0.2 else np.linspace(low, high, 5)[1:-1:2]
        step = 10.0 ** np.floor(np.log10(np.diff(places, prepend=low)))
        axis.set_major_locator(FixedLocator(np.unique(np.round(places / step) * step).tolist()))
    axis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:.3g}"))
    axis.set_minor_formatter(NullFormatter())


@cache
def _has_glyph(character: str) -> bool:
    """Whether the font of figures has a glyph."""
    return character.isascii() or bool(get_font(findfont(FontProperties())).get_char_index(ord(character)))


def save(figure: Figure, path: str | Path) -> None:
    """Write a figure as PNG at 130 dots per inch, whole or not at all.

    Arguments:
        figure: What any function of `yeastfit.plot` returns.
        path: The file to write; folders on the way are made.

    Raises:
        InputError: It is no figure, or the ending of the file is that of no format of pictures.
    """
    check_kind("figure", figure, Figure, "what a function of yeastfit.plot returned")
    known, ending = FigureCanvasAgg.get_supported_filetypes(), Path(path).suffix.removeprefix(".").lower()
    if ending and ending not in known:
        raise InputError(f"{path}: its ending {ending!r} is that of no picture, known are {', '.join(sorted(known))}")
    with written_whole(path) as temporary:
        FigureCanvasAgg(figure).print_figure(temporary, dpi=130)
