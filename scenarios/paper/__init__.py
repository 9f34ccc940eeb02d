"""The paper's experiment: its twelve panels, and its numbers beside ours.

60 cameras share memory, disk and bandwidth for 30,000 steps of the synchronous algorithm. Runs cover
several draws of their costs, both readings of when a signal acts (``lag``), and both values of disk's
additive increase.  Written are the paper's figures 1 to 4, the table "paper / this run / mean and
standard deviation over the draws" as CSV and Markdown, and what to make of the differences.
"""

from scenarios.paper.study import FULL, MARK, QUICK, figures, main, run, write
from scenarios.paper.table import PaperStudy

__all__ = ["FULL", "MARK", "QUICK", "PaperStudy", "figures", "main", "run", "write"]
