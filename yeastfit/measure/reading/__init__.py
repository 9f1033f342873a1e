"""Read image files, the size of their pixels, data sets, and what a user says about the colony's outline."""
