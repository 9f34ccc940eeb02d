"""The table of closed forms as one figure: how far each formula is from simulation."""

import pandas as pd
from matplotlib.figure import Figure

from aimd_des.plots import REFERENCE, colour, frame, number_axis, shared_legend


def deviations(table: pd.DataFrame) -> Figure:
    """Draw the deviation of every row that has one, in % of the prediction, a line for each formula.

    Bars are two standard errors to either side.
    """
    rows = table[table["relative_deviation"].notna()]
    formulas = rows["formula"].drop_duplicates().tolist()
    figure = Figure(figsize=(11.0, 0.5 + 0.36 * len(formulas)), layout="constrained")
    axes = figure.subplots()
    for first_order in (False, True):
        chosen = rows[rows["formula"].str.endswith("first order alone") == first_order]
        within = (
            chosen.groupby("formula").cumcount()
            - (chosen.groupby("formula")["formula"].transform("size") - 1) / 2
        )
        axes.errorbar(
            100.0 * chosen["relative_deviation"],
            chosen["formula"].map(formulas.index) + 0.02 * within,
            xerr=200.0 * (chosen["standard_error"] / chosen["predicted"]).abs(),
            fmt="s" if first_order else "o",
            color=colour(int(first_order)),
            markersize=3.5,
            elinewidth=0.8,
            label="first order alone" if first_order else "theory",
        )
    axes.axvline(0.0, color=REFERENCE, linewidth=1.0)
    axes.set_yticks(range(len(formulas)), formulas, fontsize="small")
    axes.invert_yaxis()
    axes.set_xlabel("simulation over theory - 1 (%), ± 2 standard errors")
    number_axis(axes.xaxis)
    frame(axes)
    shared_legend(figure)
    return figure
