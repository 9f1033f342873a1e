"""What surrounds every command: numbers as typed, signals, errors in one line, progress, kept programs."""
