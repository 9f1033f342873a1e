"""Files of microscopes: Zeiss CZI, Nikon ND2 and Leica LIF, read by `czifile`, `nd2` and `liffile`.

They are imported when such a file is met: `pip install 'yeastfit[microscopes]'`. Everything but rows, columns and
colours (time, depth, channel, position) counts as frames, from 1 on, in the file's order. The size of a pixel is that
of the file's metadata.
"""

import xml.etree.ElementTree as ElementTree
from collections.abc import Callable, Sequence
from math import prod
from pathlib import Path
from typing import Any
from warnings import catch_warnings, simplefilter

import numpy as np
import numpy.typing as npt

from yeastfit.errors import InputError
from yeastfit.measure.reading.pixel_size import PixelSize
from yeastfit.memory import check_memory

Stack = tuple[npt.NDArray[Any], str, list[PixelSize]]
"""Values, a letter for each of their axes (X and Y among them, S for colours), and the sizes of a pixel."""

STARTS = {b"ZISRAWFI": "CZI", b"\xda\xce\xbe\n": "ND2", b"\x70\0\0\0": "LIF"}
MICRO = 1e6  # µm in a metre


def vendor_of(start: bytes) -> str | None:
    """CZI, ND2 or LIF by the first bytes of a file; None for others."""
    return next((name for begins, name in STARTS.items() if start.startswith(begins)), None)


def read_vendor(path: Path, vendor: str, frame: int | None = None) -> tuple[npt.NDArray[Any], list[PixelSize]]:
    """Read one frame of a microscope's file.

    Arguments:
        path: The file.
        vendor: CZI, ND2 or LIF.
        frame: Which, from 1 on; may be left out where there is one.

    Returns:
        Values [rows, columns] or [rows, columns, colour], and the sizes of a pixel that the file states.

    Raises:
        InputError: The library is not installed, or there are several frames and none of this number.
    """
    try:
        values, axes, sizes = READERS[vendor](path)
    except ImportError as error:
        raise InputError(f"{path}: {error.name} is not installed: pip install 'yeastfit[microscopes]'") from error
    return one_frame(values, axes, frame, path), sizes


def one_frame(values: npt.NDArray[Any], axes: str, frame: int | None, path: Path) -> npt.NDArray[Any]:
    """The frame of this number of a stack, as [rows, columns] or [rows, columns, colour]."""
    colour = "S" if "S" in axes and values.shape[axes.index("S")] in (3, 4) else ""
    others = [k for k, axis in enumerate(axes) if axis not in f"YX{colour}"]
    order = [*others, axes.index("Y"), axes.index("X"), *([axes.index(colour)] if colour else [])]
    flat = np.transpose(values, order)
    count = prod(flat.shape[: len(others)])
    number = check_frame(frame, count, path, {axes[k]: values.shape[k] for k in others if values.shape[k] > 1})
    return flat.reshape(count, *flat.shape[len(others) :])[number]


def check_frame(frame: int | None, count: int, path: Path, parts: dict[str, int] | None = None) -> int:
    """The index of a frame; raises `InputError` where there is none of this number, or several and no number."""
    of = f" ({', '.join(f'{axis} {size}' for axis, size in parts.items())})" if parts else ""
    if frame is None and count != 1:
        raise InputError(f"{path}: holds {count} frames{of}, choose one by --frame 1 to --frame {count}")
    if frame is not None and not 1 <= frame <= count:
        raise InputError(f"{path}: frame is {frame}, the file holds {count}{of}: need 1 to {count}")
    return 0 if frame is None else frame - 1


def _read_czi(path: Path) -> Stack:
    import czifile

    with czifile.CziFile(path) as file:
        _check_room(path, file.shape)
        known = czifile.czifile.DECOMPRESS
        if unread := {tile.compression for tile in file.filtered_subblock_directory} - known.keys():
            raise InputError(
                f"{path}: has tiles of compression {min(unread)} (5 and 6 are Zstd), which czifile does not read, "
                f"need {', '.join(map(str, sorted(known)))}: export it as TIFF"
            )
        with catch_warnings():
            simplefilter("error", UserWarning)  # of tiles that do not fit
            between = np.zeros(file.shape, file.dtype)  # black where no tile is, not what happens to be in memory
            values = np.asarray(file.asarray(out=between, max_workers=1))  # several workers hide what goes wrong
        axes = str(file.axes).replace("S", "P").replace("0", "S")  # scenes, colours
        document = file.metadata()
    metres = {
        item.get("Id"): float(found.text or "nan")
        for item in ElementTree.fromstring(document).iter("Distance")
        if (found := item.find("Value")) is not None
    }
    stated = {"X", "Y"} <= metres.keys()
    return values, axes, [PixelSize("CZI Scaling", metres["X"] * MICRO, metres["Y"] * MICRO)] if stated else []


def _read_nd2(path: Path) -> Stack:
    import nd2

    with nd2.ND2File(path) as file:
        _check_room(path, file.shape)
        channels = getattr(file.metadata, "channels", None) or []
        calibrated = bool(channels) and all(channels[0].volume.axesCalibrated[:2])  # else nd2 says 1 µm
        voxel = file.voxel_size()
        sizes = [PixelSize("ND2 voxel size", voxel.x, voxel.y)] if calibrated else []
        return np.asarray(file.asarray()), "".join(file.sizes), sizes


def _read_lif(path: Path) -> Stack:
    import liffile

    with liffile.LifFile(path) as file:
        count = len(file.images)
        if count != 1:
            raise InputError(f"{path}: holds {count} images, need one: export them one by one")
        image = file.images[0]
        _check_room(path, image.shape)
        x, y = (_step(image.coords.get(axis)) for axis in "XY")
        sizes = [PixelSize("LIF dimensions", x * MICRO, y * MICRO)] if x and y else []
        return np.asarray(image.asarray()), "".join(image.dims), sizes


def _check_room(path: Path, shape: Sequence[int]) -> None:
    """Raise `InputError` where so many values, of 4 bytes at most, do not fit into memory."""
    check_memory(4.0 * prod(shape), f"{path}: {' x '.join(map(str, shape))} values")


def _step(places: Any) -> float:
    """Between neighbours of evenly spaced places, in their unit; 0 where it is not known."""
    return float(abs(places[1] - places[0])) if places is not None and len(places) > 1 else 0.0


READERS: dict[str, Callable[[Path], Stack]] = {"CZI": _read_czi, "ND2": _read_nd2, "LIF": _read_lif}
