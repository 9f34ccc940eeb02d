"""The discrete-step algorithm as a SimPy program: a process per camera, which ticks at every step."""

import random
from collections.abc import Generator
from dataclasses import dataclass, field

import numpy as np
import simpy

from aimd_des import Problem
from benchmarks.harness import FloatArray, IntArray

__all__ = ["run"]

Ticks = Generator[simpy.Event, None, None]


@dataclass
class ControlUnit:
    """Watches the cameras; `signal` is S(k), which they read."""

    limit: list[float]
    signal: list[bool] = field(init=False)
    signals: list[int] = field(init=False)

    def __post_init__(self) -> None:
        self.signal = [False] * len(self.limit)
        self.signals = [0] * len(self.limit)

    def process(self, env: simpy.Environment, cameras: "list[Camera]") -> Ticks:
        upcoming = self.signal
        while True:
            self.signal = upcoming
            upcoming = [sum(camera.demand[j] for camera in cameras) > c for j, c in enumerate(self.limit)]
            self.signals = [sent + due for sent, due in zip(self.signals, upcoming, strict=True)]
            yield env.timeout(1)


class Camera:
    """One camera with its parameters, a value for each resource, as plain Python numbers."""

    def __init__(self, problem: Problem, slopes: FloatArray, agent: int) -> None:
        self.increase: list[float] = problem.increase[agent].tolist()
        self.decrease: list[float] = problem.decrease[agent].tolist()
        self.normalization: list[float] = problem.normalization.tolist()
        self.slopes: list[list[float]] = slopes[::-1, agent].T.tolist()
        self.demand = [0.0] * problem.n_resources
        self.average = [0.0] * problem.n_resources

    def probability(self, j: int) -> float:
        average, gradient = self.average[j], 0.0
        for coefficient in self.slopes[j]:
            gradient = gradient * average + coefficient
        return self.normalization[j] * gradient / average

    def process(self, env: simpy.Environment, unit: ControlUnit, luck: random.Random) -> Ticks:
        steps = 1
        while True:
            steps += 1
            for j, signal in enumerate(unit.signal):
                if not signal:
                    self.demand[j] += self.increase[j]
                elif luck.random() < self.probability(j):
                    self.demand[j] *= self.decrease[j]
                self.average[j] += (self.demand[j] - self.average[j]) / steps
            yield env.timeout(1)


def run(problem: Problem, slopes: FloatArray, steps: int, seed: int) -> tuple[IntArray, FloatArray]:
    """Return the number of capacity events, shape (m,), and the averages over x(0)..x(K), (n, m).

    `slopes` are the derivatives' coefficients, (terms, n, m), lowest power first.
    """
    env, luck = simpy.Environment(), random.Random(seed)
    unit = ControlUnit(problem.limit.tolist())
    cameras = [Camera(problem, slopes, agent) for agent in range(problem.n_agents)]
    env.process(unit.process(env, cameras))  # first, so that it looks before the cameras tick
    for camera in cameras:
        env.process(camera.process(env, unit, luck))
    env.run(until=steps)
    return np.array(unit.signals), np.array([camera.average for camera in cameras])
