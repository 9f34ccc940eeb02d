"""What `agents=` takes for a run in compiled code."""

from collections.abc import Collection

from aimd_des.engine.control_unit import ControlUnit
from aimd_des.engine.delivery import ProcessGenerator
from aimd_des.engine.observers import Observer
from aimd_des.engine.system import System
from aimd_des.fleet.compiled_agents import CompiledAgents
from aimd_des.fleet.control_process import ControlProcess
from aimd_des.fleet.control_table import compiled_table


class Fleet:
    """The standard agents of a run in compiled code: what an `AgentProcess` each would do, event for event.

    Give the class itself: ``Simulation(..., agents=Fleet)``.
    """

    @staticmethod
    def populate(
        system: System, absent: Collection[int], control_unit: ControlUnit, observer: Observer
    ) -> ProcessGenerator:
        """Bring the agents into a run."""
        agents = CompiledAgents(system, absent, observer.overshoot)
        system.join(agents)
        table = compiled_table(control_unit)
        if table is None:
            return control_unit.process(system)
        return ControlProcess(agents, control_unit, table, observer).process()
