"""Correct outlines by hand: a folder of results of `yeastfit measure`, in napari, and back into the data set.

`measured_folder` and `manifest_masks` know the files, `reader` makes layers of them, and `editor` is the widget. napari
finds the last two by `napari.yaml` and imports them when they are used; nothing else in the package does. Only
`editor` needs napari.
"""
