"""Approximate Bayesian computation: chains and populations."""
