"""What `agents=` takes for a run in compiled code."""

from collections.abc import Collection

from aimd_des.engine.control_unit import ControlUnit, SampledUnit
from aimd_des.engine.control_unit.sampled import Looks
from aimd_des.engine.environment import Maker
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
    ) -> Maker:
        """Bring the agents into a run."""
        agents = CompiledAgents(system, absent, observer.overshoot)
        system.join(agents)
        table = compiled_table(control_unit)
        if table is not None:
            return ControlProcess(agents, control_unit, table, observer).process
        if isinstance(control_unit, SampledUnit) and type(control_unit).process is SampledUnit.process:
            looks = Looks(control_unit, system)
            system.parts["control"] = looks
            return looks.process
        return lambda again: control_unit.process(system)
