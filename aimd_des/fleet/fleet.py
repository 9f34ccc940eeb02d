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
        """Bring the agents into a run.

        Parameters
        ----------
        system : System
            The run in progress.
        absent : collection of int
            Agents that are no part of it.
        control_unit : ControlUnit
            What decides; one that gives a table looks in compiled code.
        observer : Observer
            What totals are recorded by.

        Returns
        -------
        generator
            The SimPy process of the control unit.

        Raises
        ------
        InputError
            If costs or a response are functions that compiled code cannot call.
        """
        agents = CompiledAgents(system, absent, observer.overshoot)
        system.join(agents)
        table = compiled_table(control_unit)
        if table is None:
            return control_unit.process(system)
        return ControlProcess(agents, control_unit, table, observer).process()
