"""Thinning by tables of neighbourhoods, compiled by numba: of `thinning`, and of any other such algorithm."""

import numpy as np
from jaxtyping import Bool, Shaped

from yeastfit.compiled import Index, array_kernel


@array_kernel
def thin(image: Bool[np.ndarray, "row column"], removes: Bool[np.ndarray, "number code"]) -> None:
    """Thin, in place, an image with an empty margin of one pixel, until no pass in turn removes a pixel.

    The neighbours of a pixel, clockwise from the north, are the bits of its code, lowest first. A pixel that is removed
    clears its bit in the codes of its neighbours, so that a pass looks up one byte for each pixel. `pixels` lists those
    that some pass would remove, first of all, later of those and the neighbours of removed ones.

    Arguments:
        image: True on the colony, in one piece of memory.
        removes: Whether each pass removes a pixel of this code; none removes one whose neighbours are all on.
    """
    width, flat, codes = image.shape[1], image.ravel(), neighbours(image).ravel()
    around = np.array([-width, 1 - width, 1, width + 1, width, width - 1, -1, -width - 1])
    removable = np.zeros(256, dtype=np.bool_)
    for now in range(removes.shape[0]):
        removable |= removes[now]
    listed = flat & (codes != 255)
    pixels, gone = np.empty(flat.size, dtype=np.int32), np.empty(flat.size, dtype=np.int32)
    count = 0
    words = listed[: flat.size // 8 * 8].view(np.uint64)  # of eight pixels, most of them off or inside
    for word in range(words.size + 1):
        if word < words.size and words[word] == 0:
            continue
        for pixel in range(8 * word, min(8 * word + 8, flat.size)):
            listed[Index(pixel)] &= removable[codes[Index(pixel)]]
            pixels[Index(count)] = pixel
            count += listed[Index(pixel)]
    changed = True
    while changed:
        changed = False
        for now in range(removes.shape[0]):
            kept = removed = 0
            for k in range(count):
                pixel = pixels[Index(k)]
                code = codes[Index(pixel)]
                if removes[now, code]:
                    gone[Index(removed)] = pixel
                    removed += 1
                    flat[Index(pixel)] = False
                elif removable[code]:
                    pixels[Index(kept)] = pixel
                    kept += 1
                else:
                    listed[Index(pixel)] = False
            for k in range(removed):
                on = codes[Index(gone[Index(k)])]
                for bit in range(8):
                    if on >> np.uint8(bit) & np.uint8(1):
                        near = Index(gone[Index(k)] + around[bit])
                        codes[near] &= ~np.uint8(1 << (bit ^ 4))
                        if not listed[near] and removable[codes[near]]:
                            listed[near] = True
                            pixels[Index(kept)] = near
                            kept += 1
            count = kept
            changed = changed or removed > 0


@array_kernel
def neighbours(image: Bool[np.ndarray, "row column"]) -> Shaped[np.ndarray, "row column"]:
    """The code of every pixel's neighbours, as bytes; 0 on the margin."""
    codes = np.zeros(image.shape, dtype=np.uint8)
    for row in range(1, image.shape[0] - 1):
        above, here, below = image[row - 1], image[row], image[row + 1]
        for column in range(1, image.shape[1] - 1):
            codes[row, column] = (
                np.uint8(above[column])
                | np.uint8(above[column + 1]) << np.uint8(1)
                | np.uint8(here[column + 1]) << np.uint8(2)
                | np.uint8(below[column + 1]) << np.uint8(3)
                | np.uint8(below[column]) << np.uint8(4)
                | np.uint8(below[column - 1]) << np.uint8(5)
                | np.uint8(here[column - 1]) << np.uint8(6)
                | np.uint8(above[column - 1]) << np.uint8(7)
            )
    return codes
