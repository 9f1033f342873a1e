"""From numbers to parameters: targets, fits and their errors."""
