"""Networks over which broadcasts travel: graphs, and the channels that they are turned into."""

from aimd_des.channel.topology import (
    FloodChannel,
    TreeChannel,
    balanced_tree,
    flood,
    from_edges,
    from_graphml,
    grid,
    random_geometric,
    star,
    tree,
)

__all__ = [
    "FloodChannel",
    "TreeChannel",
    "balanced_tree",
    "flood",
    "from_edges",
    "from_graphml",
    "grid",
    "random_geometric",
    "star",
    "tree",
]
