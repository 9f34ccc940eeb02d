"""What `agents=` takes for a run in compiled code."""

from collections.abc import Collection

from aimd_des.engine.control_unit import ControlUnit, Crossing, Sampled
from aimd_des.engine.delivery import ProcessGenerator
from aimd_des.engine.observers import Observer
from aimd_des.engine.system import System
from aimd_des.fleet.compiled_agents import CompiledAgents
from aimd_des.fleet.control_process import ControlProcess

__all__ = ["Fleet"]


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
            What decides; the built-in ones look in compiled code.
        observer : Observer
            What totals are recorded by.

        Returns
        -------
        generator
            The SimPy process of the control unit.

        Raises
        ------
        InputError
            If costs are functions that cannot be called by compiled code.
        """
        agents = CompiledAgents(system, absent, observer.overshoot)
        system.join(agents)
        # Not `isinstance`: a subclass may decide otherwise in its `process`, which then has to be run.
        if type(control_unit) is Sampled or type(control_unit) is Crossing:
            return ControlProcess(agents, control_unit, observer).process()
        return control_unit.process(system)
