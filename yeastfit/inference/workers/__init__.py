"""Simulations in other processes, on this machine or on many: the same bits on any number of them."""
