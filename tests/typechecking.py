"""The run-time type checker of the tests: beartype, taking whole numbers for real ones as static checkers do."""

from beartype import BeartypeConf, beartype

check = beartype(conf=BeartypeConf(is_pep484_tower=True))
