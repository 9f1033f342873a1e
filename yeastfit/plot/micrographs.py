"""Figures of micrographs: the outline of what was taken for the colony, thumbnails, and sheets of them."""

import textwrap
from collections.abc import Sequence
from io import BytesIO

import numpy as np
from matplotlib.figure import Figure
from PIL import Image, ImageDraw

from yeastfit.measure.outlining.segmentation import outline
from yeastfit.plot.style import OUTLINE, literal

DOUBTFUL = "#b00020"
HIGHEST = 20.0  # inches of a micrograph


def overlay(
    pixels: np.ndarray, mask: np.ndarray, title: str, pixel_size: float | None = None, doubts: Sequence[str] = ()
) -> Figure:
    """Draw a micrograph with the outline of what was taken for the colony.

    Arguments:
        pixels: Grey values.
        mask: Which pixels are colony.
        title: Written above.
        pixel_size: µm per pixel; the axes are in pixels where it is unknown.
        doubts: Sentences written across the bottom.

    Returns:
        A figure with one panel, 6.3 inches wide.
    """
    size = pixel_size or 1.0
    rows, columns = pixels.shape
    inches = np.array([6.3, 6.3 * rows / columns])
    inches *= min(1.0, HIGHEST / inches[1])
    whole = np.maximum(inches, (6.3, 0.0)) + 0.75
    figure = Figure(figsize=(whole[0], whole[1]))
    left, bottom, width, height = (float(part) for part in (*(0.6, 0.45) / whole, *inches / whole))
    axes = figure.add_axes((left, bottom, width, height))
    axes.imshow(pixels, cmap="gray", extent=(-0.5 * size, (columns - 0.5) * size, (rows - 0.5) * size, -0.5 * size))
    contours = parted(outline(mask))
    axes.plot(contours[:, 1] * size, contours[:, 0] * size, color=OUTLINE, lw=0.7)
    axes.set(xlabel="µm" if pixel_size else "pixels (size unknown)")
    figure.text(0.6 / whole[0], 1 - 0.2 / whole[1], literal(title), fontsize=9, va="center")
    if doubts:
        lines = "\n".join(textwrap.fill(f"• {doubt}", 95, subsequent_indent="   ") for doubt in doubts)
        box = {"facecolor": "#ffe9a8", "edgecolor": "none", "alpha": 0.92, "pad": 3}
        axes.text(0.01, 0.01, lines, transform=axes.transAxes, fontsize=7, va="bottom", bbox=box, parse_math=False)
    return figure


def parted(contours: Sequence[np.ndarray]) -> np.ndarray:
    """Join lines to one that is drawn as they are, with nan between them: thousands are drawn at once."""
    gap = np.full((1, 2), np.nan)
    return np.concatenate([gap, *(part for contour in contours for part in (contour, gap))])


def thumbnail(pixels: np.ndarray, mask: np.ndarray | None, side: int) -> bytes:
    """Draw a small micrograph with the outline of its mask.

    Arguments:
        pixels: Grey values.
        mask: Which pixels are colony; None draws no outline.
        side: Length of the longer edge, in pixels.

    Returns:
        A JPEG file's bytes.
    """
    low, high = np.percentile(pixels, (0.2, 99.8))
    if low == high:
        low, high = float(pixels.min()), max(float(pixels.max()), float(pixels.min()) + 1)
    grey = np.clip((pixels.astype(np.float32) - low) * (255 / (high - low)), 0, 255).astype(np.uint8)
    scale = 2 * side / max(pixels.shape)  # drawn twice as large, so that reducing it makes smooth lines
    size = [max(2, round(length * scale)) for length in pixels.shape[::-1]]
    image = Image.fromarray(grey).resize((size[0], size[1]), Image.Resampling.BICUBIC).convert("RGB")
    canvas, width = ImageDraw.Draw(image), max(3, round(side / 140))
    drawn = [] if mask is None else [part for part in outline(mask) if np.ptp(part, axis=0).max() * scale >= 2]
    for contour in drawn:  # but for specks below a pixel of the picture: grain has a million of them
        canvas.line([(x, y) for y, x in ((contour + 0.5) * scale).tolist()], fill=OUTLINE, width=width, joint="curve")
    buffer = BytesIO()
    image.reduce(2).save(buffer, "JPEG", quality=82, optimize=True)
    return buffer.getvalue()


def thumbnail_sheet(
    thumbnails: Sequence[bytes], captions: Sequence[str], doubtful: Sequence[bool], columns: int
) -> Figure:
    """Draw many thumbnails side by side.

    Arguments:
        thumbnails: What `thumbnail` returned for each.
        captions: Written above each.
        doubtful: Whether each caption is red.
        columns: How many stand in a row.

    Returns:
        A figure as high as it needs to be.
    """
    lines = -(-len(thumbnails) // columns)
    figure = Figure(figsize=(max(1.5 * columns, 3.0), 1.75 * lines))
    for k, (data, caption, doubt) in enumerate(zip(thumbnails, captions, doubtful, strict=True)):
        row, column = divmod(k, columns)
        left, bottom = (column + 0.03) / columns, 1 - (row + 0.98) / lines
        axes = figure.add_axes((left, bottom, 0.94 / columns, 0.8 / lines))
        with Image.open(BytesIO(data)) as image:
            axes.imshow(
                np.asarray(image.convert("RGB").reduce(max(1, max(image.size) // 260))), interpolation="antialiased"
            )
        axes.axis("off")
        axes.set_anchor("N")
        color = DOUBTFUL if doubt else "black"
        axes.set_title(literal(caption, 26), fontsize=5.5, color=color, pad=2)
    return figure
