"""Simulations that are kept: found by parameters and seed, in memory and on disk."""
