"""`python -m yeastfit` is the command `yeastfit`."""

from yeastfit.cli import main

main()
