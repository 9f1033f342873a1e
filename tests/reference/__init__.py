"""An independent plain NumPy/SciPy reading of the hard model, to hold the package against."""
