"""A run that goes on where another one stands: what every part of that keeps is loaded into it."""

from collections.abc import Collection, Iterator
from typing import Any

from aimd_des.engine.arguments import Begun
from aimd_des.engine.observers import ConstantPieces, observer_of
from aimd_des.engine.planned_changes import Agenda, is_planned
from aimd_des.utils import validation
from aimd_des.utils.errors import InputError

_GENERATOR = "which keep where they are in generators of Python, and these cannot be copied"


def check_data(run: Begun) -> None:
    """Refuse a run in which something is kept that is no data, to be forked or saved; say what, and why."""
    simulation = run.simulation
    if not hasattr(simulation.agents, "populate"):
        name = getattr(simulation.agents, "__name__", simulation.agents)
        raise InputError.of(
            "agents", name, f"Fleet: agents are processes otherwise, {_GENERATOR}", "the events are the same"
        )
    if simulation.special:
        raise InputError.of("special", sorted(simulation.special), f"empty: they are processes, {_GENERATOR}")
    if simulation.processes:
        remedy, given = "derive an intervention from interventions.Planned", simulation.processes
        raise InputError.of("processes", given, f"empty: they are processes, {_GENERATOR}", remedy)
    for place, intervention in enumerate(simulation.interventions):
        if not is_planned(intervention):
            remedy = "derive it from interventions.Planned, and give changes() in place of process()"
            allowed = f"a list of changes, and no process of its own, {_GENERATOR}"
            raise InputError.of(f"interventions[{place}]", intervention, allowed, remedy)
    if "control" not in run.system.parts:
        allowed = f"a Crossing, or derived from SampledUnit: others are processes, {_GENERATOR}"
        remedy = "give it table() in place of process()"
        raise InputError.of("control_unit", simulation.control_unit, allowed, remedy)


def take_over(fresh: Begun, run: Begun, given: Collection[str]) -> None:
    """Let a fork, in which nothing has happened, stand where its run does, but for parts that are given."""
    before, simulation = run.simulation, fresh.simulation
    state = state_of(run)
    # What an intervention has put in force in the meantime is not what the simulation was made of.
    retimed = run.system.conditions.retimed
    changed = {
        "control": simulation.control_unit is not before.control_unit
        or (retimed and "control_unit" in given),
        "link": "channel" in given and simulation.channel is not run.system.channel,
    }
    if simulation.response is not before.response:
        state["agents"]["memory"] = None
    new = {name for name, is_new in changed.items() if is_new}
    new.update(_new_interventions(run, fresh))
    for name in new:
        state.pop(name, None)
        state["environment"]["processes"].pop(name, None)
    load(fresh, state, new - {"link"} | _handed_over(run, fresh, state))


def state_of(run: Begun) -> dict[str, Any]:
    """Return all that a run has come to, by the names of its parts; nothing of it may be written to."""
    parts, env = run.system.parts, run.system.env
    return {**{name: part.state() for name, part in parts.items()}, "environment": env.state()}


def load(fresh: Begun, state: dict[str, Any], anew: set[str]) -> None:
    """Let a run that has just begun stand where another one does; processes that are named begin anew."""
    system, parts = fresh.system, fresh.system.parts
    if state["environment"]["beginning"]:
        # Nothing has happened but that some processes have begun, as they do in any run.
        while system.env.beginning > state["environment"]["beginning"] and not anew:
            system.env.run_to(system.until, one=True)
        return
    for name, part in parts.items():
        if name in state:
            part.resume(state[name])
    control: Any = parts.get("control")
    if hasattr(control, "resume_observer"):
        control.resume_observer()
    system.env.resume(state["environment"], sorted(anew))
    system.transmitter.resume_events(state["transmitter"], same_link="link" in state)
    if "control" in state and hasattr(control, "resume_events"):
        control.resume_events(state["control"])


def _new_interventions(run: Begun, fresh: Begun) -> Iterator[str]:
    """Yield the names of interventions that the run has not had; refuse what would act before now."""
    before, now = run.simulation.interventions, float(run.system.env.now)
    for place, intervention in enumerate(fresh.simulation.interventions):
        if place < len(before) and intervention is before[place]:
            continue
        name = f"interventions[{place}]"
        agenda = run.system.parts.get(name)
        if isinstance(agenda, Agenda) and agenda.done:
            allowed = f"as it was: it has acted before the present, {now!r}"
            raise InputError.of(name, intervention, allowed)
        _check_begin(name, intervention, fresh, now)
        yield name
    if len(fresh.simulation.interventions) < len(before):
        raise InputError.of("interventions", fresh.simulation.interventions, "no fewer than before")


def _check_begin(name: str, intervention: Any, run: Begun, now: float) -> None:
    """Refuse an intervention that would act before a time."""
    begins = getattr(intervention, "begins", now)
    if is_planned(intervention):
        first = next(iter(intervention.changes(run.system, {"name": name})), None)
        begins = now if first is None else first[0]
    if begins < now:
        allowed = f"one that acts at {now!r} or later: all before that has happened"
        raise InputError.of(name, intervention, allowed, f"it would act at {begins!r}")


def _handed_over(run: Begun, fresh: Begun, state: dict[str, Any]) -> set[str]:
    """Let rows and ticks be followed by whom it is up to now; return the processes that begin for it."""
    begun = set()
    processes = state["environment"]["processes"]
    for name, follows in (("totals", _keeps_totals), ("ticks", _follows_ticks)):
        was, is_now = follows(run), follows(fresh)
        if was and not is_now:
            processes.pop(name, None)
        elif is_now and not was:
            begun.add(name)
    return begun


def _keeps_totals(run: Begun) -> bool:
    return observer_of(run.system).watching


def _follows_ticks(run: Begun) -> bool:
    overshoot = run.system.parts.get("overshoot")
    return isinstance(overshoot, ConstantPieces) and overshoot.following


def salted(salts: tuple[int, ...], salt: int | None) -> tuple[int, ...]:
    """Return the salts of a fork."""
    return salts if salt is None else (*salts, validation.integer("salt", salt, low=0))
