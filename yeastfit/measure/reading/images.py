"""Read grey values and the size of a pixel from image files; nothing else imports image readers.

Readers are imported inside functions: TIFF needs `tifffile`, with `imagecodecs` for compressed files (Pillow stands in
where it is missing), PNG and JPEG need `PIL`, PNG of 16 bits in colour `imagecodecs`, too. A pixel size is never
assumed: `read_micrograph` lists what counts.
"""

import logging
from collections.abc import Callable
from dataclasses import dataclass
from math import prod, sqrt
from pathlib import Path
from typing import Any, BinaryIO, NamedTuple
from warnings import catch_warnings, simplefilter

import numpy as np
import numpy.typing as npt
from jaxtyping import Float32, UInt8, UInt16

from yeastfit.errors import InputError, PixelSizeError
from yeastfit.measure.reading.pixel_size import PixelSize, given_instead, pages_here, pillow_sizes, tiff_sizes
from yeastfit.measure.reading.vendor_files import check_frame, read_vendor, vendor_of
from yeastfit.numbers import PIXEL_SIZES

Grey = UInt8[np.ndarray, "row column"] | UInt16[np.ndarray, "row column"] | Float32[np.ndarray, "row column"]

MAX_PIXELS = 100_000_000  # refused from the header, before anything is allocated
MAX_BYTES = 8 * MAX_PIXELS  # likewise, for wide types and many channels
DENSEST = {1: 1, 5: 3_000, 8: 1_100, 32_773: 64, 32_946: 1_100}  # bytes in a stored one: none, LZW, deflate, PackBits
MAX_RATIO = 32  # of the sides
MIN_SIDE = 16  # pixels; below, a background cannot be told from a colony
LEAST_CONTRAST = 1e-15  # of floating-point images, whose squares are in single precision's range
LUMINANCE = np.array([0.2125, 0.7154, 0.0721], dtype=np.float32)  # of red, green and blue, Rec. 709

logging.getLogger("tifffile").addHandler(logging.NullHandler())  # what it says of damaged files, InputError says too


@dataclass(frozen=True)
class Micrograph:
    """A photograph.

    Attributes:
        pixels: Grey values [rows, columns], 0 is black.
        pixel_size: In µm per pixel.
        pixel_size_source: Where that comes from, in words.
        path: The file.
    """

    pixels: Grey
    pixel_size: float
    pixel_size_source: str
    path: Path


class ImageContents(NamedTuple):
    """What a file holds.

    Attributes:
        pixels: Grey values.
        sizes: Pixel sizes that the file states, the most trustworthy first.
        remark: On a size that is not trusted; empty where there is none.
    """

    pixels: Grey
    sizes: list[PixelSize]
    remark: str


class SeveralImages(InputError):
    """A file holds more than one image."""


def read_image(path: str | Path, frame: int | None = None) -> Grey:
    """Read the grey values of a TIFF, PNG or JPEG file.

    8- and 16-bit values stay as they are, bilevel ones become 0 and 255, everything else float32. Equal colour channels
    become one; others become luminance (Rec. 709).

    Arguments:
        path: The file.
        frame: Of a time lapse or a z-stack, from 1 on.

    Returns:
        Grey values [rows, columns]; 0 is black, whatever the file's own convention.

    Raises:
        InputError: The file is anything but one flat, finite image of at most `MAX_PIXELS`.
    """
    return _read(Path(path), frame).pixels


def read_labels(path: str | Path) -> npt.NDArray[Any]:
    """Read a mask or a label image: as `read_image`, but of a palette the numbers of its colours, which are the labels.

    Arguments:
        path: The file.

    Returns:
        Values [rows, columns].

    Raises:
        InputError: As `read_image`.
    """
    return _read(Path(path), palette=False).pixels


def read_micrograph(path: str | Path, pixel_size: float | None = None, frame: int | None = None) -> Micrograph:
    """Read an image with the size of its pixels.

    A file states that size, the most trustworthy first, as OME-XML PhysicalSizeX; as an ImageJ unit with its
    resolution; as TIFF tag 65326 (µm, written by the microscope of the real data); or as a resolution per inch,
    centimetre or metre, which counts only where it makes a pixel finer than `pixel_size.LARGEST_PIXEL`.

    Arguments:
        path: The file.
        pixel_size: In µm per pixel; by default what the file states. The source says it where the two differ.
        frame: Of a time lapse or a z-stack, from 1 on.

    Returns:
        The photograph.

    Raises:
        PixelSizeError: The file states no size.
        InputError: x and y differ by more than 1 %, the size is not from 1 nm to 1 mm, or `read_image` refuses the
            file.
    """
    path = Path(path)
    given = None if pixel_size is None else PIXEL_SIZES.read(pixel_size, "pixel_size")
    contents = _read(path, frame)
    if given is not None:
        return Micrograph(contents.pixels, given, given_instead(given, contents.sizes), path)
    if not contents.sizes:
        raise PixelSizeError(
            f"{path}: no pixel size in the file{contents.remark}, pass pixel_size / --pixel-size in µm"
        )
    source, x, y = contents.sizes[0]
    if x not in PIXEL_SIZES or y not in PIXEL_SIZES:
        raise PixelSizeError(
            f"{path}: pixels of {x:.5g} by {y:.5g} µm ({source}), need {PIXEL_SIZES}: pass pixel_size / --pixel-size"
        )
    if abs(x - y) > 0.01 * max(x, y):
        raise InputError(
            f"{path}: pixels of {x:.5g} by {y:.5g} µm ({source}), need square ones (1 %): resample the image"
        )
    return Micrograph(contents.pixels, sqrt(x * y), source, path)


def _read(path: Path, frame: int | None = None, palette: bool = True) -> ImageContents:
    if path.is_dir():
        raise InputError(f"{path}: is a directory, need a TIFF, PNG or JPEG file")
    if path.exists() and not path.is_file():  # a pipe would be waited for
        raise InputError(f"{path}: is no regular file, need a TIFF, PNG or JPEG file")
    try:
        with path.open("rb") as file:
            start = file.read(8)
            file.seek(0)
            if (vendor := vendor_of(start)) is not None:
                values, sizes = read_vendor(path, vendor, frame)
                _check_size(path, values.shape[1], values.shape[0], 1)
                pixels, remark = _to_grey(values, path), ""
            else:
                pixels, sizes, remark = _reader(path, start)(path, file, frame, palette)
    except InputError:
        raise
    except Exception as error:  # a damaged file makes readers raise anything at all
        reason = getattr(error, "strerror", None) or " ".join(str(error).split()) or type(error).__name__
        raise InputError(f"{path}: cannot be read ({reason[:200]}), need an intact TIFF, PNG or JPEG file") from error
    return ImageContents(_finite(pixels, path), sizes, remark)


def _reader(path: Path, start: bytes) -> Callable[[Path, BinaryIO, int | None, bool], ImageContents]:
    if not start:
        raise InputError(f"{path}: is empty (0 bytes), need a TIFF, PNG or JPEG file")
    if start[:4] in (b"II*\0", b"MM\0*", b"II+\0", b"MM\0+"):
        return _read_tiff
    if start.startswith((b"\x89PNG\r\n\x1a\n", b"\xff\xd8\xff")):
        return _read_pillow
    raise InputError(f"{path}: is no image (begins with {start!r}), need a TIFF, PNG or JPEG file")


def _check_size(path: Path, width: int, height: int, pages: int) -> None:
    if pages != 1:
        raise SeveralImages(
            f"{path}: holds {pages} pages or planes, need a file with one image, or its number: --frame"
        )
    if not width * height:
        raise InputError(f"{path}: {width} x {height} pixels, need an image")
    if width * height > MAX_PIXELS:
        raise InputError(
            f"{path}: {width} x {height} pixels, need at most {MAX_PIXELS // 10**6} million: crop or bin it"
        )
    if max(width, height) > MAX_RATIO * max(min(width, height), MIN_SIDE):
        raise InputError(f"{path}: {width} x {height} pixels, need sides at most {MAX_RATIO} times each other: crop it")


def _check_stored(path: Path, page: Any) -> None:
    """Raise `InputError` for a TIFF page that claims more values than its bytes can hold, or than `MAX_BYTES`."""
    stored, samples = sum(page.databytecounts), page.imagewidth * page.imagelength * page.samplesperpixel
    if stored * DENSEST.get(int(page.compression), np.inf) < samples * page.bitspersample // 8:
        raise InputError(
            f"{path}: {stored} bytes cannot hold {page.imagewidth} x {page.imagelength} x {page.samplesperpixel} "
            f"values of {page.bitspersample} bits, need the whole image"
        )
    if page.nbytes > MAX_BYTES:
        raise InputError(f"{path}: {page.nbytes / 1e6:.0f} MB of values, need at most {MAX_BYTES / 1e6:.0f} MB")


def _finite(pixels: Grey, path: Path) -> Grey:
    if pixels.dtype.kind == "f" and (bad := int((~np.isfinite(pixels)).sum())):
        raise InputError(
            f"{path}: {bad} of {pixels.size} pixels are NaN, infinite or beyond single precision, need finite values"
        )
    if pixels.dtype.kind == "f" and 0 < (contrast := float(np.ptp(pixels))) < LEAST_CONTRAST:
        raise InputError(
            f"{path}: grey values differ by {contrast:.3g} at most, need {LEAST_CONTRAST:g} for single precision: "
            "multiply them by a number"
        )
    return pixels


def _to_grey(values: npt.NDArray[Any], path: Path) -> Grey:
    """Grey values of an array [rows, columns] or [rows, columns, grey-alpha, RGB or RGBA]."""
    if values.ndim == 3 and values.shape[2] in (2, 4):
        opaque = np.iinfo(values.dtype).max if values.dtype.kind == "u" else 1
        if (values[..., -1] != opaque).any():
            raise InputError(f"{path}: has transparent pixels, need an opaque image: flatten it")
        values = values[..., :-1]
    if values.ndim == 3 and values.shape[2] in (1, 3):
        grey = bool((values == values[..., :1]).all())
        values = values[..., 0] if grey else values.astype(np.float32) @ LUMINANCE
    if values.ndim != 2 or values.size == 0:
        raise InputError(f"{path}: an array of shape {values.shape}, need a flat image [rows, columns]")
    if values.dtype == bool:
        return values.astype(np.uint8) * np.uint8(255)
    if values.dtype in (np.uint8, np.uint16):
        return np.asarray(values, dtype=values.dtype.newbyteorder("="))
    if values.dtype.kind not in "iuf":
        raise InputError(f"{path}: values of type {values.dtype}, need 8- or 16-bit or floating-point grey values")
    with np.errstate(over="ignore"):  # `_finite` counts what does not fit
        return values.astype(np.float32)


def _read_tiff(path: Path, file: BinaryIO, frame: int | None, palette: bool) -> ImageContents:
    import tifffile

    with tifffile.TiffFile(file) as tif:
        page: Any = tif.pages.first
        pages = len(tif.pages)
        if tif.is_imagej and tif.series:
            shape = zip(tif.series[0].axes, tif.series[0].shape, strict=True)
            planes = prod(count for axis, count in shape if axis not in "YXS")
            if planes > pages:  # ImageJ writes one entry for a stack beyond 4 GB
                raise InputError(
                    f"{path}: holds {planes} images behind one entry of its directory, of which the first alone can be "
                    "read: save the one that is needed as a file of its own"
                )
        elif tif.is_ome:
            pages = len(set().union(*(pages_here(tif, series) for series in tif.series))) or pages
        if frame is not None:
            page, pages = tif.pages.get(check_frame(frame, len(tif.pages), path)), 1  # by [index] OME's lack tags
        _check_size(path, page.imagewidth, page.imagelength, pages)
        ends = [start + count for start, count in zip(page.dataoffsets, page.databytecounts, strict=True)]
        if max(ends) > (held := path.stat().st_size):
            raise InputError(f"{path}: is cut short at {held} bytes of {max(ends)}, need the whole file")
        _check_stored(path, page)
        sizes, remark = tiff_sizes(tif, page)
        return ImageContents(_tiff_pixels(page, path, file, palette), sizes, remark)


def _tiff_pixels(page: Any, path: Path, file: BinaryIO, palette: bool) -> Grey:
    try:
        values = np.asarray(page.asarray())
    except ValueError as error:
        if "imagecodecs" not in str(error):
            raise
        file.seek(0)
        return _read_pillow(path, file, None, palette).pixels
    if page.planarconfig == 2 and values.ndim == 3:
        values = np.moveaxis(values, 0, -1)
    if page.photometric == 3 and not palette:
        return _to_grey(values, path)
    if page.photometric == 3:
        colours = (page.colormap >> 8).astype(np.uint8)  # stored in 16 bits, meant in 8
        return _to_grey(np.moveaxis(colours[:, values], 0, -1), path)
    if page.photometric == 0:  # 0 is white
        values = _negative(values, page.bitspersample)
    elif page.photometric not in (1, 2, 6):
        raise InputError(f"{path}: TIFF photometric interpretation {page.photometric}, need greyscale, palette or RGB")
    return _to_grey(values, path)


def _negative(values: npt.NDArray[Any], bits: int) -> npt.NDArray[Any]:
    """Black and white exchanged: of unsigned numbers within their bits, else within the values that are there."""
    if values.dtype.kind == "b":
        return ~values
    if values.dtype.kind == "u":
        return values.dtype.type(2**bits - 1) - values
    return -values.astype(np.float64)


def _read_pillow(path: Path, file: BinaryIO, frame: int | None, palette: bool) -> ImageContents:
    from PIL import Image, UnidentifiedImageError

    with catch_warnings():
        simplefilter("ignore", Image.DecompressionBombWarning)  # _check_size is stricter
        try:
            image = Image.open(file)
        except UnidentifiedImageError:
            raise InputError(f"{path}: its header is damaged, need an intact TIFF, PNG or JPEG file") from None
        except Image.DecompressionBombError:
            limit = MAX_PIXELS // 10**6
            raise InputError(f"{path}: far too many pixels, need at most {limit} million: crop or bin it") from None
    with image:
        frames = getattr(image, "n_frames", 1)
        if frame is not None:
            image.seek(check_frame(frame, frames, path))
            frames = 1
        _check_size(path, *image.size, frames)
        sizes, remark = pillow_sizes(image)
        if image.mode in ("RGB", "RGBA", "LA") and ";16" in str(image.tile):  # of which Pillow keeps 8 bits
            file.seek(0)
            return ImageContents(_to_grey(_deep_png(path, file, frame), path), sizes, remark)
        if image.mode == "P" and palette:
            converted = image.convert("RGBA")
        elif image.mode in ("1", "L", "LA", "P", "RGB", "RGBA", "F") or image.mode.startswith("I"):
            converted = image
        else:
            raise InputError(f"{path}: colour mode {image.mode}, need greyscale, palette, RGB or RGBA")
        return ImageContents(_to_grey(np.asarray(converted), path), sizes, remark)


def _deep_png(path: Path, file: BinaryIO, frame: int | None) -> npt.NDArray[Any]:
    """Values of a PNG with several channels of 16 bits."""
    if frame not in (None, 1):
        raise InputError(f"{path}: frame is {frame}, of PNG with channels of 16 bits need 1: save it as TIFF")
    try:
        import imagecodecs
    except ImportError as error:
        raise InputError(f"{path}: has channels of 16 bits, which need imagecodecs: pip install imagecodecs") from error
    return np.asarray(imagecodecs.png_decode(file.read()))
