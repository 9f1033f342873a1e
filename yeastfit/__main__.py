"""`python -m yeastfit` is the command `yeastfit`."""

from yeastfit.commands.app import main

main()
