"""Outline the colony in a photograph."""
