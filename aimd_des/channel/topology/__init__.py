"""Networks over which broadcasts travel: graphs whose edges have a latency and a loss."""

from aimd_des.channel.topology.channels import FloodChannel, TreeChannel, flood, tree
from aimd_des.channel.topology.files import from_edges, from_graphml
from aimd_des.channel.topology.generators import balanced_tree, grid, random_geometric, star

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
