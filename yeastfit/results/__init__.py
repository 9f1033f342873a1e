"""The folder of a command's results: whose it is, and how results come into it."""
