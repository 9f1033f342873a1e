"""Masks of simulated colonies, drawn as Li et al. 2024 or a camera would, and how many cells they show."""
