"""A scenario run for real: agents as tasks of processes, signals as datagrams."""

from aimd_des.emulate.conductor import Collected, Conductor
from aimd_des.emulate.folder import load_emulation, write_emulation
from aimd_des.emulate.hosts import Listener, check_token, join
from aimd_des.emulate.network_frames import lateness_words, network_frames
from aimd_des.emulate.outcome import outcome
from aimd_des.emulate.replay import Replay, replay
from aimd_des.emulate.replay_figure import replay_figure
from aimd_des.emulate.served import MOST_PROCESSES, Emulation, check_setting
from aimd_des.emulate.wire import parsed_address

__all__ = [
    "MOST_PROCESSES",
    "Collected",
    "Conductor",
    "Emulation",
    "Listener",
    "Replay",
    "check_setting",
    "check_token",
    "join",
    "lateness_words",
    "load_emulation",
    "network_frames",
    "outcome",
    "parsed_address",
    "replay",
    "replay_figure",
    "write_emulation",
]
