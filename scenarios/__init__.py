"""Studies to run: one question each, with a quick size; ``python -m scenarios`` lists them."""
