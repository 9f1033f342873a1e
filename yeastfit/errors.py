"""What a user can cause."""


class InputError(ValueError):
    """Bad input: one line that names the argument or file, the value received and what would be right."""


class PixelSizeError(InputError):
    """An image is fine but for the size of its pixels, which neither it nor the user states."""
