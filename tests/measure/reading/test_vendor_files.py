"""Files of microscopes. Nothing writes CZI, ND2 or LIF files: objects as the libraries have them stand in for these."""

import sys
import warnings
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import tifffile

from yeastfit import InputError
from yeastfit.errors import PixelSizeError
from yeastfit.measure.reading.images import read_image, read_micrograph

STACK = np.arange(3 * 2 * 20 * 30, dtype=np.uint16).reshape(3, 2, 20, 30)
XML = (
    "<ImageDocument><Metadata><Scaling><Items><Distance Id='X'><Value>6.5e-07</Value></Distance>"
    "<Distance Id='Y'><Value>6.5e-07</Value></Distance></Items></Scaling></Metadata></ImageDocument>"
)
DECODERS = SimpleNamespace(DECOMPRESS={0: None, 4: None})  # of czifile's, by compression


class Opened(SimpleNamespace):
    """An open file."""

    def __enter__(self) -> "Opened":
        return self

    def __exit__(self, *error: object) -> None:
        pass


def czi(_: Path, compression: int = 0, fault: str = "", covered: slice = slice(None)) -> Opened:
    """As czifile reads it: several workers hide errors, and what no tile covers is left as it was in memory."""
    values = STACK[None, ..., None]

    def asarray(out: np.ndarray | None = None, max_workers: int = 4) -> np.ndarray:
        out = np.full_like(values, 777) if out is None else out
        if fault == "damaged" and max_workers == 1:
            raise ValueError("failed to read 1200 bytes, got 300")
        if fault == "shifted":
            warnings.warn("could not broadcast input array", stacklevel=1)
        out[..., covered, :] = values[..., covered, :]
        return out

    tiles = [SimpleNamespace(compression=0), SimpleNamespace(compression=compression)]
    return Opened(
        shape=values.shape,
        dtype=values.dtype,
        axes="STZYX0",
        asarray=asarray,
        metadata=lambda: XML,
        filtered_subblock_directory=tiles,
    )


def nd2(_: Path, calibrated: bool | None = True) -> Opened:
    """Without metadata where it is not known whether the file is calibrated; nd2 then takes 1 µm for a pixel."""
    volume = SimpleNamespace(axesCalibrated=(calibrated, calibrated, False))
    side = 0.65 if calibrated else 1.0
    return Opened(
        shape=STACK.shape,
        sizes={"T": 3, "Z": 2, "Y": 20, "X": 30},
        asarray=lambda: STACK,
        metadata=None if calibrated is None else SimpleNamespace(channels=[SimpleNamespace(volume=volume)]),
        voxel_size=lambda: SimpleNamespace(x=side, y=side, z=1),
    )


def lif(_: Path) -> Opened:
    coords = {"X": 6.5e-7 * np.arange(30), "Y": 6.5e-7 * np.arange(20)}
    return Opened(images=[Opened(shape=STACK.shape, dims=("T", "Z", "Y", "X"), coords=coords, asarray=lambda: STACK)])


FILES: dict[str, tuple[bytes, str, str, Any]] = {
    "czi": (b"ZISRAWFILE", "czifile", "CziFile", czi),
    "nd2": (b"\xda\xce\xbe\n\0\0\0\0", "nd2", "ND2File", nd2),
    "lif": (b"\x70\0\0\0\0\0\0\0", "liffile", "LifFile", lif),
}


@pytest.mark.parametrize("suffix", list(FILES))
def test_a_frame_and_its_pixel_size(suffix: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    start, module, name, opened = FILES[suffix]
    path = tmp_path / f"colony.{suffix}"
    path.write_bytes(start)
    monkeypatch.setitem(sys.modules, module, SimpleNamespace(**{name: opened}, czifile=DECODERS))
    found = read_micrograph(path, frame=4)
    np.testing.assert_array_equal(found.pixels, STACK[1, 1])
    assert found.pixel_size == pytest.approx(0.65)
    with pytest.raises(InputError, match=r"holds 6 frames \(T 3, Z 2\), choose one by --frame 1 to --frame 6"):
        read_image(path)
    with pytest.raises(InputError, match=r"frame is 7, the file holds 6 \(T 3, Z 2\): need 1 to 6"):
        read_image(path, frame=7)
    monkeypatch.setitem(sys.modules, module, None)
    with pytest.raises(InputError, match=r"is not installed: pip install 'yeastfit\[microscopes\]'"):
        read_image(path)


@pytest.mark.filterwarnings("default:could not broadcast")
@pytest.mark.parametrize(
    ("file", "words"),
    [
        ({"compression": 5}, r"has tiles of compression 5 \(.*Zstd\), .* need 0, 4: export it as TIFF"),
        ({"fault": "damaged"}, r"cannot be read \(failed to read 1200 bytes"),
        ({"fault": "shifted"}, r"cannot be read \(could not broadcast"),
    ],
)
def test_czi_tiles_that_cannot_be_read_are_refused(
    file: dict[str, Any], words: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = with_czi(tmp_path, monkeypatch, **file)
    with pytest.raises(InputError, match=rf"colony\.czi: {words}"):
        read_image(path, frame=1)


def test_a_czi_is_black_between_tiles(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    read = read_image(with_czi(tmp_path, monkeypatch, covered=slice(12)), frame=2)
    np.testing.assert_array_equal(read[:, :12], STACK[0, 1, :, :12])
    assert not read[:, 12:].any()


def with_czi(folder: Path, monkeypatch: pytest.MonkeyPatch, **file: Any) -> Path:
    """A file that a stand-in for czifile opens as `czi`."""
    path = folder / "colony.czi"
    path.write_bytes(FILES["czi"][0])
    module = SimpleNamespace(CziFile=lambda path: czi(path, **file), czifile=DECODERS)
    monkeypatch.setitem(sys.modules, "czifile", module)
    return path


@pytest.mark.parametrize("calibrated", [False, None])
def test_nd2_without_calibration_states_no_size(
    calibrated: bool | None, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "colony.nd2"
    path.write_bytes(FILES["nd2"][0])
    monkeypatch.setitem(sys.modules, "nd2", SimpleNamespace(ND2File=lambda path: nd2(path, calibrated)))
    with pytest.raises(PixelSizeError, match=r"colony\.nd2: no pixel size in the file, pass pixel_size"):
        read_micrograph(path, frame=1)
    assert read_micrograph(path, 0.65, frame=1).pixel_size_source == "given by the user"


@pytest.mark.parametrize(
    ("shape", "words"),
    [((10_000, 10_001), "10001 x 10000 pixels, need at most 100 million"), ((1, 600), "600 x 1 .* at most 32 times")],
)
def test_images_of_any_maker_are_as_large_as_others_at_most(
    shape: tuple[int, int], words: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "colony.lif"
    path.write_bytes(FILES["lif"][0])
    large = Opened(shape=shape, dims=("Y", "X"), coords={}, asarray=lambda: np.broadcast_to(np.uint8(7), shape))
    monkeypatch.setitem(sys.modules, "liffile", SimpleNamespace(LifFile=lambda path: Opened(images=[large])))
    with pytest.raises(InputError, match=rf"colony\.lif: {words}"):
        read_image(path)


def test_a_frame_of_a_tiff(tmp_path: Path) -> None:
    tifffile.imwrite(tmp_path / "stack.tif", STACK[:, 0], photometric="minisblack")
    np.testing.assert_array_equal(read_image(tmp_path / "stack.tif", frame=3), STACK[2, 0])
    with pytest.raises(InputError, match="holds 3 pages or planes, need a file with one image, or its number: --frame"):
        read_image(tmp_path / "stack.tif")
    with pytest.raises(InputError, match="frame is 4, the file holds 3: need 1 to 3"):
        read_image(tmp_path / "stack.tif", frame=4)


def test_frames_of_an_ome_tiff(tmp_path: Path) -> None:
    tifffile.imwrite(tmp_path / "a.ome.tif", STACK[:, 0], metadata={"axes": "TYX", "PhysicalSizeX": 0.65})
    for frame in (1, 2, 3):
        read = read_micrograph(tmp_path / "a.ome.tif", frame=frame)
        np.testing.assert_array_equal(read.pixels, STACK[frame - 1, 0])
        assert read.pixel_size == 0.65


OME = (
    '<OME xmlns="http://www.openmicroscopy.org/Schemas/OME/2016-06" UUID="urn:uuid:{}"><Image ID="Image:0">'
    '<Pixels ID="Pixels:0" DimensionOrder="XYCZT" Type="uint16" SizeX="30" SizeY="20" SizeC="1" SizeZ="1" SizeT="3" '
    'PhysicalSizeX="0.65">{}</Pixels></Image></OME>'
)
PART = '<TiffData FirstT="{0}" IFD="0" PlaneCount="1"><UUID FileName="t{0}.ome.tif">urn:uuid:{0}</UUID></TiffData>'


@pytest.mark.parametrize("alone", [False, True])
def test_a_file_of_a_set_of_ome_tiffs(alone: bool, tmp_path: Path) -> None:
    """Every file lists the images of all three, and holds one, whether the others are there or not."""
    for k in [1] if alone else [0, 1, 2]:
        xml = OME.format(k, "".join(PART.format(other) for other in range(3)))
        tifffile.imwrite(tmp_path / f"t{k}.ome.tif", STACK[k, 0], description=xml, metadata=None)
    for frame in (None, 1):
        read = read_micrograph(tmp_path / "t1.ome.tif", frame=frame)
        np.testing.assert_array_equal(read.pixels, STACK[1, 0])
        assert read.pixel_size == 0.65
    with pytest.raises(InputError, match="frame is 2, the file holds 1: need 1 to 1"):
        read_image(tmp_path / "t1.ome.tif", frame=2)
