"""The colours of resources, the same in figures and in pages."""

#: Okabe and Ito's, which stay apart for all common kinds of colour blindness; yellow is left out as too pale
#: for lines.  They repeat where there are more resources.
COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#000000")
