"""From a photograph to the mask of its colony."""
