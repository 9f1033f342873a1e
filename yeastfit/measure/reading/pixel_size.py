"""Find the size of a pixel in the metadata of an image file, in µm along x and y."""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from itertools import compress
from typing import Any, NamedTuple
from xml.etree import ElementTree

from yeastfit.numbers import POSITIVE, number_of

LARGEST_PIXEL = 20.0  # µm; a coarser print density (72, 96, 300 dpi, 1 x 1) says nothing about a microscope
SAME = 0.01  # sizes that differ by less are one, rounded
MICROMETRES = {
    **dict.fromkeys(("µm", "μm", "um", "\\u00b5m", "\\u00B5m", "micron", "microns", "micrometer", "micrometre"), 1.0),
    **dict.fromkeys(("nm", "nanometer", "nanometre"), 1e-3),
    **dict.fromkeys(("Å", "A", "angstrom"), 1e-4),
    **dict.fromkeys(("pm",), 1e-6),
    **dict.fromkeys(("mm", "millimeter", "millimetre"), 1e3),
    **dict.fromkeys(("cm", "centimeter", "centimetre"), 1e4),
    **dict.fromkeys(("m", "meter", "metre"), 1e6),
    **dict.fromkeys(("inch", "in"), 25_400.0),
}


class PixelSize(NamedTuple):
    """A pixel size as a file states it.

    Attributes:
        source: Where the file states it, in words.
        x: In µm.
        y: In µm.
    """

    source: str
    x: float
    y: float


GIVEN = "given by the user"
INSTEAD = f"{GIVEN}; the file says "
Stated = tuple[list[PixelSize], str]  # sizes, the most trustworthy first, and a remark on one that is not trusted


def tiff_sizes(tif: Any, page: Any) -> Stated:
    """Sizes that a TIFF file states, opened by `tifffile`, of one of its pages."""
    return _trusted(_of_tiff(tif, page))


def pillow_sizes(image: Any) -> Stated:
    """Sizes that an image states which Pillow opened."""
    return _trusted(_of_pillow(image))


def given_instead(given: float, stated: Sequence[PixelSize]) -> str:
    """Where a size comes from that the user gave, and what the file states, first and foremost, if that is another."""
    if not stated or all(abs(side - given) <= SAME * given for side in (stated[0].x, stated[0].y)):
        return GIVEN
    source, x, y = stated[0]
    size = f"{x:.4g} µm" if abs(x - y) <= SAME * max(x, y) else f"{x:.4g} by {y:.4g} µm"
    return f"{INSTEAD}{size} ({source})"


def overruled_sizes(rows: Sequence[Mapping[str, Any]]) -> list[str]:
    """Say of how many rows of a table of measurements the file states another pixel size than the user."""
    found = [row for row in rows if str(row.get("pixel_size_from") or "").startswith(INSTEAD)]
    if not found:
        return []
    first = f"{float(found[0]['um_per_pixel']):.4g} µm {found[0]['pixel_size_from']}"
    return [f"pixel size of {found[0]['file']} is {first}" + (f"; likewise {len(found) - 1} more" * (len(found) > 1))]


def _trusted(found: Iterable[tuple[bool, PixelSize]]) -> Stated:
    """Sizes without coarse print densities, which are marked with True; the remark is on the first one left out."""
    sizes, ignored = list[PixelSize](), list[PixelSize]()
    for printed, size in found:
        (ignored if printed and max(size.x, size.y) > LARGEST_PIXEL else sizes).append(size)
    remark = f" ({ignored[0].source} is a print density, {25_400 / ignored[0].x:.0f} dpi)" if ignored else ""
    return sizes, remark


def _of_tiff(tif: Any, page: Any) -> Iterator[tuple[bool, PixelSize]]:
    tags = {tag.code: tag.value for tag in page.tags}
    yield from ((False, size) for size in _ome_size(tif, page))
    density = [_ratio(tags.get(code)) for code in (282, 283)]
    unit = str((tif.imagej_metadata or {}).get("unit", "")).strip()
    if unit in MICROMETRES and unit not in ("inch", "in") and all(density):
        yield False, PixelSize(f"ImageJ resolution in {unit}", *(MICROMETRES[unit] / each for each in density))
    if 65326 in tags:
        size = _number(tags[65326])
        yield False, PixelSize("TIFF tag 65326", size, size)
    per = {2: ("inch", 25_400.0), 3: ("centimetre", 10_000.0)}.get(int(tags.get(296, 2)))
    if per and all(density):
        yield True, PixelSize(f"TIFF resolution per {per[0]}", *(per[1] / each for each in density))


def _ome_size(tif: Any, page: Any) -> Iterator[PixelSize]:
    """That of the image which holds the page; none where images differ and it is not known which that is."""
    xml = tif.ome_metadata
    try:
        elements = list(ElementTree.fromstring(xml).iter()) if xml else []
    except ElementTree.ParseError:
        return
    sizes = [_of_pixels(element.attrib) for element in elements if element.tag.endswith("Pixels")]
    if len(set(sizes)) > 1:
        images = [pages_here(tif, series) for series in tif.series if series.kind == "ome"]
        sizes = list(compress(sizes, [page.index in one for one in images])) if len(images) == len(sizes) else []
    if len(set(sizes)) == 1 and (size := sizes[0]) is not None:
        yield size


def pages_here(tif: Any, series: Any) -> set[int]:
    """Numbers of an OME image's pages in this file; others of them may lie in other files, or be missing."""
    return {page.index for page in series if page is not None and page.parent is tif}


def _of_pixels(pixels: Mapping[str, str]) -> PixelSize | None:
    """What OME's element Pixels states by its attributes."""
    x, y = (_number(pixels.get(f"PhysicalSize{axis}")) for axis in "XY")
    unit_x, unit_y = (MICROMETRES.get(pixels.get(f"PhysicalSize{axis}Unit", "µm")) for axis in "XY")
    if not x or not unit_x:
        return None
    return PixelSize("OME PhysicalSizeX", x * unit_x, y * (unit_y or unit_x) if y else x * unit_x)


def _of_pillow(image: Any) -> Iterator[tuple[bool, PixelSize]]:
    x, y = (_number(each) for each in image.info.get("dpi", (0, 0)))
    if image.format == "JPEG":  # without a JFIF unit Pillow's dpi is EXIF's or a guess
        x, y = (x, y) if image.info.get("jfif_unit") in (1, 2) else (0.0, 0.0)
    if x and y:
        yield True, PixelSize(f"{image.format} resolution", 25_400 / x, 25_400 / y)


def _ratio(value: Any) -> float:
    """A TIFF rational; 0 where it is absent or has no value."""
    if isinstance(value, tuple) and len(value) == 2:
        return _number(value[0]) / _number(value[1]) if _number(value[1]) else 0.0
    return _number(value)


def _number(value: Any) -> float:
    """A positive finite number; 0 for everything else a metadata field may hold."""
    number = number_of(value.decode(errors="replace") if isinstance(value, bytes) else value)
    return number if number in POSITIVE else 0.0
