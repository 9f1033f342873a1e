"""Thinning by tables of neighbourhoods, compiled by numba: of `thinning`, and of any other such algorithm."""

import numpy as np
from jaxtyping import Bool

from yeastfit.compiled import array_kernel


@array_kernel
def thin(image: Bool[np.ndarray, "row column"], removes: Bool[np.ndarray, "number code"]) -> None:
    """Thin, in place, an image with an empty margin of one pixel, until no pass in turn removes a pixel.

    `pixels` holds those that a pass may remove: at first all with a neighbour that is off, later those that another
    pass would remove and the neighbours of removed ones.

    Arguments:
        image: True on the colony.
        removes: Whether each pass removes a pixel whose neighbours have this code, clockwise from the north, lowest bit
            first; none removes one without a neighbour that is off.
    """
    passes = removes.shape[0]
    removable = np.zeros(256, dtype=np.bool_)
    for now in range(passes):
        removable |= removes[now]
    flat, width = image.ravel(), image.shape[1]
    around = np.array([-width, 1 - width, 1, width + 1, width, width - 1, -1, -width - 1])
    pixels = np.flatnonzero(flat)
    gone, listed = np.empty_like(pixels), np.zeros(flat.size, dtype=np.bool_)
    count = 0
    for pixel in pixels:
        for offset in around:
            if not flat[pixel + offset] and not listed[pixel]:
                listed[pixel] = True
                pixels[count] = pixel
                count += 1
    changed = True
    while changed:
        changed = False
        for now in range(passes):
            kept = removed = 0
            for k in range(count):
                pixel = pixels[k]
                code = 0
                for bit in range(8):
                    code |= int(flat[pixel + around[bit]]) << bit
                if removes[now, code]:
                    gone[removed] = pixel
                    removed += 1
                elif removable[code]:
                    pixels[kept] = pixel
                    kept += 1
                else:
                    listed[pixel] = False
            for k in range(removed):
                flat[gone[k]] = False
            for k in range(removed):
                for offset in around:
                    near = gone[k] + offset
                    if flat[near] and not listed[near]:
                        listed[near] = True
                        pixels[kept] = near
                        kept += 1
            count = kept
            changed = changed or removed > 0
