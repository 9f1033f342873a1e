"""What a picture of a simulated colony shows, for `yeastfit.plot` to draw."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Shaped


@dataclass(frozen=True, eq=False)
class Panel:
    """One panel of a picture.

    Attributes:
        title: Above it.
        values: Along x and then y, y upwards: which of `kinds` is there, or values from 0 to 1.
        half_width: From the middle to an edge of `values`, µm.
        label: Of the scale of colours, where `values` are from 0 to 1.
        kinds: What 0, 1, … stand for, nothing being the first; empty where `values` are from 0 to 1.
        grey: Whether values from 0 to 1 are those of a photograph, from black to white.
    """

    title: str
    values: Shaped[np.ndarray, "x y"]
    half_width: float
    label: str = ""
    kinds: tuple[str, ...] = ()
    grey: bool = False
