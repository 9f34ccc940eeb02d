"""Studies to run: one question a file, each with a quick size; ``python -m scenarios`` lists them."""
