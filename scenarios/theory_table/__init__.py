"""How well do the closed forms predict what runs do?

Signals, utilisation and averages of the paper's system are predicted to about 1 %, the critical loss to
0.02, with loss and without. The plain formulas of first order alone give up to 7 % too many signals.
"""  # noqa: D400 - a question

from scenarios.theory_table.study import FULL, QUICK, main, study

__all__ = ["FULL", "QUICK", "main", "study"]
