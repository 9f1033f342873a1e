"""Settings as a page says them."""

from yeastfit.report.pictures import as_words


def test_settings_are_said_in_words() -> None:
    rules = {"births": {"rule": "collocated", "nodes": 512}, "uptake": {"rule": "biomass"}}
    said = as_words({"rules": rules, "seen_at": [1.0, 2.5], "hard": False, "area": None, "own": ()})
    assert said == {"rules": "births collocated (nodes 512), uptake biomass", "seen at": "1.0, 2.5", "hard": "False"}
