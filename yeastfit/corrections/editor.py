"""The widget in napari: one photograph after the other, its outline under the brush, saved into the data set."""

from pathlib import Path
from typing import Any

import numpy as np
from magicgui.widgets import ComboBox, Container, FileEdit, Label, PushButton
from napari.layers import Labels, Layer

from yeastfit.corrections.measured_folder import Mask, MeasuredFolder
from yeastfit.corrections.reader import layers_of, place_in
from yeastfit.errors import InputError

BRUSH = 12  # pixels of the image

NOTHING = "Choose a folder of results of yeastfit measure."
HOW = "Paint with label 1 (key 2), erase with 0 (key 1)."


class OutlineEditor(Container):
    """Correct the outlines of a folder of results.

    Layers of this widget are replaced when another photograph is shown; an outline that has been changed is saved or
    given up before.
    """

    def __init__(self, napari_viewer: Any) -> None:
        """Take over what the reader has opened in `napari_viewer`, now or later."""
        self._viewer = napari_viewer
        self._folder: MeasuredFolder | None = None
        self._number = 0
        self._layers: list[Layer] = []
        self._shown: Mask | None = None  # as it was opened or saved
        self._place = FileEdit(label="Results", mode="d")
        self._choice = ComboBox(label="Photograph", choices=self._photographs)
        self._remarks, self._status = Label(value=""), Label(value=NOTHING)
        self._next, self._save = PushButton(text="Next doubtful one"), PushButton(text="Save outline")
        self._discard = PushButton(text="Give up changes")
        super().__init__(
            widgets=[
                *(self._place, self._choice, self._remarks),
                *(self._next, self._save, self._discard, self._status),
            ]
        )
        for label in (self._remarks, self._status):
            label.native.setWordWrap(True)
        self._place.changed.connect(self.open)
        self._choice.changed.connect(self._chosen)
        self._next.changed.connect(self.next_doubtful)
        self._save.changed.connect(self.save)
        self._discard.changed.connect(self.discard)
        self._viewer.layers.events.inserted.connect(self._adopt)
        self._adopt()

    @property
    def unsaved(self) -> bool:
        """Whether the outline that is shown was changed since it was opened or saved."""
        return self._shown is not None and not np.array_equal(self._painted(), self._shown)

    def open(self, path: str | Path) -> None:
        """Show the first doubtful photograph of a folder."""
        if self._may_go_on():
            try:
                folder = MeasuredFolder.of(path)
            except InputError as error:
                self._status.value = str(error)
                return
            self._folder = folder
            self._offer()
            self.show_photograph(folder.next_doubtful() or 0)

    def show_photograph(self, number: int) -> None:
        """Show one photograph, unless changes of another were not saved."""
        if self._folder is None or not self._may_go_on():
            return
        try:
            tuples = layers_of(self._folder, number)
        except InputError as error:
            self._status.value = str(error)
            return
        for layer in self._layers:
            if layer in self._viewer.layers:
                self._viewer.layers.remove(layer)
        self._layers = []  # nothing is adopted while they come
        self._number, self._shown = number, None
        self._take([self._viewer.add_layer(Layer.create(*one)) for one in tuples])
        self._viewer.reset_view()

    def next_doubtful(self) -> None:
        """Show the next photograph that somebody should look at."""
        if self._folder is None:
            self._status.value = NOTHING
            return
        number = self._folder.next_doubtful(self._number)
        if number is None:
            self._status.value = "None is doubtful any more. Measure again, into the same folder."
        else:
            self.show_photograph(number)

    def save(self) -> None:
        """Save the outline that is shown and name it in the manifest."""
        if self._folder is None or self._shown is None:
            self._status.value = NOTHING
            return
        painted = self._painted()
        try:
            self._folder = self._folder.corrected(self._number, painted)
        except (InputError, OSError) as error:
            self._status.value = str(error)
            return
        self._shown = painted
        self._offer()
        self._tell()
        self._status.value = "Saved. The next yeastfit measure takes it."

    def discard(self) -> None:
        """Show the outline again as it was opened or saved."""
        if self._shown is not None:
            self._outline.data = self._shown.astype(np.uint8)
            self._status.value = HOW

    @property
    def _outline(self) -> Labels:
        return next(layer for layer in self._layers if isinstance(layer, Labels))

    def _painted(self) -> Mask:
        """What is painted now; where its layer was removed, what was shown."""
        assert self._shown is not None
        layers = [layer for layer in self._layers if isinstance(layer, Labels) and layer in self._viewer.layers]
        return np.asarray(layers[0].data) > 0 if layers else self._shown

    def _may_go_on(self) -> bool:
        if self.unsaved:
            self._status.value = "This outline was changed: save it, or give up changes."
            with self._choice.changed.blocked():
                self._choice.value = self._number
        return not self.unsaved

    def _adopt(self, event: Any = None) -> None:
        """Take over the layers that the reader has made."""
        found = {type(one): one for one in self._viewer.layers if place_in(one.metadata) is not None}
        place = next((place_in(one.metadata) for one in found.values()), None)
        if self._folder is None and place is not None and any(issubclass(kind, Labels) for kind in found):
            self._folder, self._number = place
            self._offer()
            self._take(list(found.values()))

    def _take(self, layers: list[Layer]) -> None:
        """Make these the layers that are edited."""
        self._layers = layers
        labels = self._outline
        self._shown = np.asarray(labels.data) > 0
        labels.selected_label, labels.brush_size, labels.mode = 1, BRUSH, "paint"
        self._viewer.layers.selection.active = labels
        self._tell()

    def _photographs(self, widget: Any = None) -> list[tuple[str, int]]:
        """What to choose from, doubtful ones marked; napari asks again with every new layer."""
        each = self._folder.photographs if self._folder else ()
        return [(one.image.label + ("  (doubtful)" if one.doubtful else ""), k) for k, one in enumerate(each)]

    def _offer(self) -> None:
        """Show the photographs of the folder."""
        assert self._folder is not None
        with self._choice.changed.blocked():
            self._choice.reset_choices()
            self._choice.value = self._number
        with self._place.changed.blocked():
            self._place.value = self._folder.path

    def _tell(self) -> None:
        """What is doubtful about the photograph that is shown."""
        assert self._folder is not None
        with self._choice.changed.blocked():
            self._choice.value = self._number
        self._remarks.value = "\n".join(self._folder.photographs[self._number].remarks) or "Nothing is doubtful."
        self._status.value = HOW

    def _chosen(self, number: int | None) -> None:
        if number is not None and number != self._number:
            self.show_photograph(number)
