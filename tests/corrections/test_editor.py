"""The widget, in a napari without a window."""

import os
import shutil
import warnings
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from measured_discs import SIDE, disc, measured

pytestmark = pytest.mark.filterwarnings("ignore")  # of napari and what it stands on

os.environ.setdefault("QT_QPA_PLATFORM", "offscreen")
with warnings.catch_warnings():
    warnings.simplefilter("ignore")
    pytest.importorskip("napari")
    from napari.components import ViewerModel
    from napari.qt import get_qapp
    from npe2 import PluginManager, PluginManifest
    from npe2.manifest.utils import import_python_name

    from yeastfit.corrections.editor import OutlineEditor
    from yeastfit.corrections.reader import reader_of
    from yeastfit.measure.reading.outline_files import read_outline


@pytest.fixture(scope="module")
def folders(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    """Read only."""
    return measured(tmp_path_factory.mktemp("measured"))


@pytest.fixture
def viewer() -> Any:
    """The model of a viewer: its window would need OpenGL, which the platform `offscreen` has not everywhere."""
    get_qapp()
    PluginManager.instance().discover()
    return ViewerModel()


def test_a_folder_is_opened_corrected_and_saved(viewer: Any, folders: tuple[Path, Path], tmp_path: Path) -> None:
    shutil.copytree(folders[0].parent, tmp_path / "copy")
    data, results = tmp_path / "copy" / "data", tmp_path / "copy" / "results"
    before = (data / "manifest.csv").read_bytes()
    viewer.open(str(results), plugin="yeastfit")  # by the reader
    assert [layer.name for layer in viewer.layers] == ["b.png", "outline of b.png"]
    editor = OutlineEditor(viewer)
    assert "several objects" in editor._remarks.value
    editor.reset_choices()  # as the window does
    assert editor._choice.choices == (0, 1, 2)
    assert editor._choice.value == 1
    labels = viewer.layers[-1]
    assert labels is viewer.layers.selection.active
    assert labels.mode == "paint"
    assert not editor.unsaved

    labels.data = np.zeros_like(labels.data)
    labels.brush_size = 40
    labels.paint((90, 90), 1)  # with the brush
    assert editor.unsaved
    editor.next_doubtful()  # not before it is saved
    assert [layer.name for layer in viewer.layers] == ["b.png", "outline of b.png"]
    assert "save it" in editor._status.value
    painted = np.asarray(labels.data) > 0
    editor.save()
    assert editor._status.value.startswith("Saved")
    np.testing.assert_array_equal(read_outline(data / "corrected" / "b.png", (SIDE, SIDE)), painted)
    assert (disc(20, 90, 90) == painted).mean() > 0.98

    editor.next_doubtful()
    assert [layer.name for layer in viewer.layers] == ["c.png", "outline of c.png"]
    editor.save()
    assert "nothing is painted" in editor._status.value
    viewer.layers[-1].data = disc(10).astype(np.uint8)
    editor.discard()
    assert not editor.unsaved
    assert not viewer.layers[-1].data.any()
    viewer.layers[-1].data = disc(10).astype(np.uint8)
    editor.save()
    editor.next_doubtful()
    assert "None is doubtful" in editor._status.value
    assert (data / "manifest.csv").read_bytes() != before


def test_a_folder_is_chosen_in_the_widget(viewer: Any, folders: tuple[Path, Path], tmp_path: Path) -> None:
    _, results = folders
    editor = OutlineEditor(viewer)
    editor.open(tmp_path)
    assert "no results of yeastfit measure" in editor._status.value
    editor.save()
    assert "Choose a folder" in editor._status.value
    editor._place.value = results
    assert [layer.name for layer in viewer.layers] == ["b.png", "outline of b.png"]
    editor._choice.value = 0
    assert [layer.name for layer in viewer.layers] == ["a.png", "outline of a.png"]
    assert editor._remarks.value == "Nothing is doubtful."
    viewer.layers.remove(viewer.layers[-1])  # by hand
    editor.next_doubtful()
    assert viewer.layers[-1].name == "outline of b.png"


def test_napari_finds_reader_and_widget() -> None:
    found = PluginManifest.from_distribution("yeastfit").contributions
    commands = {one.id: import_python_name(one.python_name) for one in found.commands}
    assert commands[found.readers[0].command] is reader_of
    assert commands[found.widgets[0].command] is OutlineEditor
