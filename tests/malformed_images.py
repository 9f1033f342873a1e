"""Malformed and odd image files, each with how it is made: tests read them alone and as a survey."""

import struct
import zlib
from collections.abc import Callable
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np
import tifffile
from PIL import Image

SIDE = 64
Y, X = np.mgrid[:SIDE, :SIDE]
DISC = np.hypot(X - 31, Y - 33) < 15
GREY = np.where(DISC, 60, 150).astype(np.uint8) + np.random.default_rng(0).integers(0, 5, DISC.shape).astype(np.uint8)

Make = Callable[[Path], object]


def tiff(values: Any = GREY, **options: Any) -> Make:
    return lambda path: tifffile.imwrite(path, values, **options)


def pillow(image: Image.Image, form: str, **options: Any) -> Make:
    return lambda path: image.save(path, format=form, **options)


def raw(data: bytes) -> Make:
    return lambda path: path.write_bytes(data)


def encoded(make: Make) -> bytes:
    """The bytes of a file that `make` would write."""
    buffer = BytesIO()
    make(buffer)  # type: ignore[arg-type]
    return buffer.getvalue()


def cut(make: Make, share: float) -> Make:
    return lambda path: path.write_bytes((data := encoded(make))[: int(share * len(data))])


def retagged(make: Make, **tags: Any) -> Make:
    """A TIFF file some of whose tags are overwritten."""

    def write(path: Path) -> None:
        make(path)
        with tifffile.TiffFile(path, mode="r+") as tif:
            for name, value in tags.items():
                tif.pages.first.tags[name].overwrite(value)

    return write


def png_header(width: int, height: int, sum_right: bool = True) -> bytes:
    """A PNG whose header says another size."""
    data = bytearray(encoded(pillow(Image.fromarray(GREY), "PNG")))
    data[16:24] = struct.pack(">II", width, height)
    if sum_right:
        data[29:33] = struct.pack(">I", zlib.crc32(bytes(data[12:29])))
    return bytes(data)


def bomb() -> bytes:
    """A PNG of 9 900 x 9 900 equal pixels: within the limit on size, some kilobytes long, its data cut off."""

    def chunk(kind: bytes, data: bytes) -> bytes:
        return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))

    header = chunk(b"IHDR", struct.pack(">IIBBBBB", 9_900, 9_900, 8, 0, 0, 0, 0))
    return b"\x89PNG\r\n\x1a\n" + header + chunk(b"IDAT", zlib.compress(bytes(1_000_000))) + chunk(b"IEND", b"")


def flipped(make: Make, first: float, last: float) -> Make:
    """A file with every bit between two places inverted."""

    def write(path: Path) -> None:
        data = bytearray(encoded(make))
        for at in range(int(first * len(data)), int(last * len(data))):
            data[at] ^= 0xFF
        path.write_bytes(bytes(data))

    return write


def endless(make: Make) -> Make:
    """A TIFF without end: its first directory says that the next one is itself."""

    def write(path: Path) -> None:
        make(path)
        data = bytearray(path.read_bytes())
        start = struct.unpack("<I", data[4:8])[0]
        entries = struct.unpack("<H", data[start : start + 2])[0]
        data[start + 2 + 12 * entries : start + 6 + 12 * entries] = struct.pack("<I", start)
        path.write_bytes(bytes(data))

    return write


def npy() -> bytes:
    buffer = BytesIO()
    np.save(buffer, GREY)
    return buffer.getvalue()


def alpha(opacity: int) -> Image.Image:
    return Image.fromarray(np.dstack([GREY] * 3 + [np.full_like(GREY, opacity)]))


def holed(value: float) -> np.ndarray:
    values = GREY.astype(np.float32)
    values[3, 4] = value
    return values


PICTURE = Image.fromarray(GREY)
FRAMES = [Image.fromarray(GREY // 2)] * 2
TIFF, PNG, JPEG = tiff(), pillow(PICTURE, "PNG"), pillow(PICTURE, "JPEG")

# what is wrong with each file, and a word that its message must hold besides its name
REFUSED: dict[str, tuple[Make, str]] = {
    "empty.tif": (raw(b""), "0 bytes"),
    "empty.png": (raw(b""), "0 bytes"),
    "one_byte.tif": (raw(b"I"), "is no image"),
    "only_magic.tif": (raw(b"II*\0"), "cannot be read"),
    "only_magic.png": (raw(b"\x89PNG\r\n\x1a\n"), "header is damaged"),
    "only_magic.jpg": (raw(b"\xff\xd8\xff"), "header is damaged"),
    "text.tif": (raw(b"file,area\na.tif,3\n"), "is no image"),
    "page.png": (raw(b"<!doctype html><title>Not found</title>"), "is no image"),
    "zeros.tif": (raw(bytes(4096)), "is no image"),
    "noise.jpg": (raw(np.random.default_rng(1).bytes(4096)), "is no image"),
    "array.npy": (raw(npy()), "is no image"),
    "array.tif": (raw(npy()), "is no image"),
    "picture.gif": (pillow(PICTURE, "GIF"), "is no image"),
    "picture.bmp": (pillow(PICTURE, "BMP"), "is no image"),
    "webp.png": (raw(b"RIFF\x1a\0\0\0WEBPVP8L"), "is no image"),
    "folder.tif": (lambda path: path.mkdir(), "is a directory"),
    "loop.tif": (lambda path: path.symlink_to(path), "cannot be read"),
    "dangling.tif": (lambda path: path.symlink_to("nowhere.tif"), "No such file"),
    "cut_02.tif": (cut(TIFF, 0.02), "need"),
    "cut_50.tif": (cut(TIFF, 0.5), "cut short"),
    "cut_95.tif": (cut(TIFF, 0.95), "cut short"),
    "cut_lzw.tif": (cut(tiff(compression="lzw"), 0.8), "cut short"),
    "cut_10.png": (cut(PNG, 0.1), "need"),
    "cut_90.png": (cut(PNG, 0.9), "need"),
    "cut_20.jpg": (cut(JPEG, 0.2), "need"),
    "cut_70.jpg": (cut(JPEG, 0.7), "cannot be read"),
    "corrupt_deflate.tif": (flipped(tiff(compression="deflate"), 0.3, 0.6), "cannot be read"),
    "corrupt.png": (flipped(PNG, 0.4, 0.6), "cannot be read"),
    "wrong_sum.png": (raw(png_header(SIDE, SIDE + 1, sum_right=False)), "header is damaged"),
    "huge.tif": (retagged(TIFF, ImageWidth=900_000, ImageLength=900_000), "900000 x 900000"),
    "huge_bigtiff.tif": (retagged(tiff(bigtiff=True), ImageWidth=2**31, ImageLength=2**31), "100 million"),
    "huge.png": (raw(png_header(2**31 - 1, 2**31 - 1)), "100 million"),
    "large_without_data.png": (raw(bomb()), "cannot be read"),
    "large_without_data.tif": (
        retagged(TIFF, ImageWidth=9_000, ImageLength=9_000),
        "4096 bytes cannot hold 9000 x 9000",
    ),
    "large_double.tif": (
        retagged(tiff(GREY / 255, compression="lzw"), ImageWidth=9_999, ImageLength=9_999),
        "cannot hold",
    ),
    "many_channels.tif": (retagged(tiff(tile=(16, 16), compression="lzw"), SamplesPerPixel=60_000), "cannot hold"),
    "nothing_wide.tif": (retagged(TIFF, ImageWidth=0), "0 x 64 pixels"),
    "strip_beyond_the_end.tif": (retagged(TIFF, StripOffsets=10**8), "cut short"),
    "strip_of_one_byte.tif": (retagged(TIFF, StripByteCounts=1), "1 bytes cannot hold"),
    "unknown_compression.tif": (retagged(TIFF, Compression=59_999), "need"),
    "pages.tif": (tiff(np.stack([GREY] * 3), photometric="minisblack"), "3 pages"),
    "planes.ome.tif": (tiff(np.stack([GREY] * 4), metadata={"axes": "ZYX"}), "4 pages"),
    "imagej_stack.tif": (tiff(np.stack([GREY] * 5), imagej=True), "5 pages"),
    "volume.tif": (tiff(np.zeros((16, 64, 64), np.uint8), volumetric=True, tile=(16, 64, 64)), "need"),
    "animated.png": (pillow(PICTURE, "PNG", save_all=True, append_images=FRAMES), "3 pages"),
    "transparent.png": (pillow(alpha(100), "PNG"), "transparent"),
    "transparent.tif": (tiff(np.asarray(alpha(0)), photometric="rgb", extrasamples=["unassalpha"]), "transparent"),
    "cmyk.jpg": (pillow(Image.new("CMYK", (SIDE, SIDE)), "JPEG"), "CMYK"),
    "cmyk.tif": (pillow(Image.new("CMYK", (SIDE, SIDE)), "TIFF"), "need"),
    "lab.tif": (pillow(Image.new("LAB", (SIDE, SIDE)), "TIFF"), "need"),
    "nan.tif": (tiff(holed(np.nan)), "1 of 4096"),
    "infinite.tif": (tiff(holed(-np.inf)), "1 of 4096"),
    "complex.tif": (tiff(GREY.astype(np.complex64)), "complex64"),
    "five_channels.tif": (tiff(np.dstack([GREY] * 5), photometric="minisblack", planarconfig="contig"), "need"),
    # images that can be read but hold nothing to measure
    "one_pixel.tif": (tiff(np.full((1, 1), 7, np.uint8)), "at least 16"),
    "one_pixel.png": (pillow(Image.new("L", (1, 1)), "PNG"), "at least 16"),
    "one_row.tif": (tiff(GREY[:1]), "at least 16"),
    "one_column.png": (pillow(Image.fromarray(GREY[:, :1]), "PNG"), "at least 16"),
    "long.png": (
        pillow(Image.fromarray(np.tile(GREY[:16], 10)), "PNG"),
        "640 x 16 pixels, need sides at most 32 times",
    ),
    "constant.tif": (tiff(np.full((SIDE, SIDE), 0.25, np.float32)), "every pixel is 0.25"),
    "black.png": (pillow(Image.new("L", (SIDE, SIDE)), "PNG"), "every pixel is 0"),
    "white.jpg": (pillow(Image.new("L", (SIDE, SIDE), 255), "JPEG"), "every pixel is 255"),
    "overflowing.tif": (tiff(np.where(DISC, 1.0, 1e300)), "beyond single precision"),
    "vanishing.tif": (tiff(np.where(DISC, 1e-36, 6e-35)), "grey values differ by 5.9e-35 at most, need 1e-15"),
}

# the grey values each must give
READ: dict[str, tuple[Make, np.ndarray, float]] = {
    "plain.tif": (TIFF, GREY, 0),
    "png_called.tif": (PNG, GREY, 0),
    "tiff_called.jpg": (TIFF, GREY, 0),
    "no_extension": (PNG, GREY, 0),
    "bigtiff.tif": (tiff(bigtiff=True), GREY, 0),
    "tiled.tif": (tiff(tile=(16, 32), compression="lzw"), GREY, 0),
    "zstd.tif": (tiff(compression="zstd"), GREY, 0),
    "predictor.tif": (tiff(compression="deflate", predictor=True), GREY, 0),
    "big_endian.tif": (tiff(GREY.astype(">u2"), byteorder=">"), GREY, 0),
    "planar.tif": (tiff(np.stack([GREY] * 3), photometric="rgb", planarconfig="separate"), GREY, 0),
    "inverted.tif": (tiff(255 - GREY, photometric="miniswhite"), GREY, 0),
    "palette.png": (pillow(PICTURE.convert("P"), "PNG"), GREY, 0),
    "palette.tif": (pillow(PICTURE.convert("P"), "TIFF"), GREY, 0),
    "opaque.png": (pillow(alpha(255), "PNG"), GREY, 0),
    "sixteen_bits.png": (pillow(Image.fromarray(GREY.astype(np.uint16) * 257), "PNG"), GREY * 257.0, 0),
    "signed.tif": (tiff(GREY.astype(np.int16) - 100), GREY - 100.0, 0),
    "signed_32.tif": (tiff(GREY.astype(np.int32) - 100), GREY - 100.0, 0),
    "unsigned_32.tif": (tiff(GREY.astype(np.uint32)), GREY, 0),
    "unsigned_64.tif": (tiff(GREY.astype(np.uint64)), GREY, 0),
    "double.tif": (tiff(GREY / 255.0), GREY / 255.0, 1e-7),
    "half.tif": (tiff(GREY.astype(np.float16)), GREY, 0),
    "bilevel.png": (pillow(Image.fromarray(DISC), "PNG"), DISC * 255.0, 0),
    "lossy.jpg": (pillow(PICTURE, "JPEG", quality=98), GREY, 4),
    "endless.tif": (endless(TIFF), GREY, 0),
    "broken_xml.ome.tif": (tiff(description="<OME><broken", metadata=None), GREY, 0),
}
