"""What the studies share: their command, their runs, their theory and their figures."""
