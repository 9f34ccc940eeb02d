"""Rivals and ours, side by side."""
