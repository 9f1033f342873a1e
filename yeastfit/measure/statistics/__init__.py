"""From a mask, or a simulated colony, to numbers."""
