"""What parts of one's own need: order of events, addressed draws, the run in progress, portable mathematics.

These names are promised like those of `aimd_des` itself. Nothing else inside the package is.
"""

from aimd_des.channel import Broadcast, Channel, Copies, DrawnLink, Draws, Link
from aimd_des.channel.latency.own_latency import quantile_table
from aimd_des.channel.loss.own_loss import lost_table
from aimd_des.dynamics.responses import response_probability
from aimd_des.engine.control_unit import ControlUnit, CrossingTable, SampledTable, SampledUnit
from aimd_des.engine.delivery import Agent, ProcessGenerator, Signal
from aimd_des.engine.environment import EventKind, OrderedEnvironment
from aimd_des.engine.run_in_progress import Run, resume
from aimd_des.engine.system import System
from aimd_des.problem.lookup import agent_indices
from aimd_des.synchronous import SynchronousRun, start_synchronous
from aimd_des.utils.parts import part
from aimd_des.utils.portable_math import exp, expm1, exps, log, log1p, logs, standard_normal
from aimd_des.utils.rng import Purpose, generator, key, uniforms
from aimd_des.utils.validation import FloatArray

__all__ = [
    "Agent",
    "Broadcast",
    "Channel",
    "ControlUnit",
    "Copies",
    "CrossingTable",
    "DrawnLink",
    "Draws",
    "EventKind",
    "FloatArray",
    "Link",
    "OrderedEnvironment",
    "ProcessGenerator",
    "Purpose",
    "Run",
    "SampledTable",
    "SampledUnit",
    "Signal",
    "SynchronousRun",
    "System",
    "agent_indices",
    "exp",
    "expm1",
    "exps",
    "generator",
    "key",
    "log",
    "log1p",
    "logs",
    "lost_table",
    "part",
    "quantile_table",
    "response_probability",
    "resume",
    "standard_normal",
    "start_synchronous",
    "uniforms",
]

#: The old name of `EventKind`.
Kind = EventKind
