"""Derivatives of the mean of an ensemble."""
