"""Rules beyond the source's own, one mechanism a file; `yeastfit.model.model.RULES` lists them by question.

The source's rules are in the folder above, one file a law: `budding`, `growth`, `contact`, `uptake`, `death`.
"""
