"""Rules of large colonies as operations that numba has compiled; `with_compiled_rules` puts them into a model."""
