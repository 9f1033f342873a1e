"""The summary statistics of Li et al. 2024."""
