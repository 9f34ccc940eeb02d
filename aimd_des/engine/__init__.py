"""A run by SimPy: environment, system, control units, an agent as a process, and the simulation."""
