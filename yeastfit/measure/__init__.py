"""From an image or a simulated colony to numbers."""
