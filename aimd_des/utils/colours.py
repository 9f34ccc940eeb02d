"""The colours of resources, the same in figures and in pages."""

#: After Okabe and Ito, whose colours stay apart for all common kinds of colour blindness; yellow is left out,
#: and three are darker than theirs.  The contrast with white is at least 3, and so is that with the dark
#: ground of a page, for all except black.  They repeat where there are more resources.
COLOURS = ("#0072B2", "#D55E00", "#009E73", "#C76D9F", "#C08400", "#3D98D3", "#000000")
