"""Least squares: parameters with standard errors."""
