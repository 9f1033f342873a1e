"""Malformed and odd files: each is read rightly, or refused in one line that names it, in bounded memory."""

import os
import tracemalloc
from pathlib import Path

import numpy as np
import pytest
from malformed_images import DISC, READ, REFUSED, TIFF

from yeastfit.errors import InputError
from yeastfit.measure.outlining.segmentation import segment
from yeastfit.measure.reading.images import read_image, read_micrograph

LIMIT = 30_000_000  # bytes at most, for files of some kilobytes, whatever their headers say


def test_the_folder_is_large_enough() -> None:
    assert len(REFUSED) >= 40
    assert not REFUSED.keys() & READ.keys()


def measured(path: Path) -> np.ndarray:
    """What `yeastfit measure` does with a file before it measures the mask."""
    return segment(read_micrograph(path, 1.0).pixels, name=str(path)).mask


@pytest.mark.parametrize("name", REFUSED)
def test_a_malformed_file_is_refused_in_one_line(name: str, tmp_path: Path) -> None:
    make, words = REFUSED[name]
    make(tmp_path / name)
    tracemalloc.start()
    try:
        with pytest.raises(InputError) as caught:
            measured(tmp_path / name)
        peak = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    message = str(caught.value)
    assert message.startswith(f"{tmp_path / name}: ")
    assert words in message
    assert "need" in message
    assert "\n" not in message
    assert len(message) < len(str(tmp_path / name)) + 400
    assert peak < LIMIT


@pytest.mark.parametrize("name", READ)
def test_an_odd_file_is_read_as_it_is_meant(name: str, tmp_path: Path) -> None:
    make, expected, tolerance = READ[name]
    make(tmp_path / name)
    np.testing.assert_allclose(read_image(tmp_path / name).astype(float), expected, rtol=0, atol=tolerance)
    mask = measured(tmp_path / name)
    assert (mask ^ (~DISC if name == "bilevel.png" and mask[0, 0] else DISC)).sum() <= 0.03 * DISC.sum()


@pytest.mark.skipif(not hasattr(os, "geteuid") or os.geteuid() == 0, reason="root may read every file")
def test_a_file_that_must_not_be_read_is_refused(tmp_path: Path) -> None:
    TIFF(tmp_path / "secret.tif")
    (tmp_path / "secret.tif").chmod(0)
    with pytest.raises(InputError, match=r"secret\.tif: cannot be read \(Permission denied\)"):
        read_image(tmp_path / "secret.tif")


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="no pipes here")
def test_a_pipe_does_not_hang(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe.tif")
    with pytest.raises(InputError, match=r"pipe\.tif: is no regular file"):
        read_image(tmp_path / "pipe.tif")
