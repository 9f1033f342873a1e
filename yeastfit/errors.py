"""The one error a user can cause."""


class InputError(ValueError):
    """Bad input: one line that names the argument or file, the value received and what would be right."""
