"""The files that commands leave, one file each."""
