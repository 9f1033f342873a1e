"""Measure the outline of a colony, photographed or simulated; `registry` has all statistics."""
