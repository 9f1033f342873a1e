"""What can go wrong: bad input, and computations that failed."""


class InputError(ValueError):
    """Bad input: one line that names the argument or file, the value received and what would be right."""


class PixelSizeError(InputError):
    """An image is fine but for the size of its pixels, which neither it nor the user states."""


class SimulationError(RuntimeError):
    """A computation that failed with valid input: what failed, for which values, and what to try instead."""
