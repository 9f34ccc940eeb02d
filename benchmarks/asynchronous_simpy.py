"""Continuous agents as a SimPy program the way SimPy's documentation teaches it.

A process per camera waits on a Store of its own. Every message in flight is a process with a Timeout
("Event Latency" in the documentation's examples). The control unit has a process for each resource.
"""

from collections.abc import Generator
from typing import Any

import numpy as np
import simpy

from aimd_des import Problem
from benchmarks.harness import FloatArray, IntArray

__all__ = ["run"]

Life = Generator[simpy.Event, Any, None]

# Nearer than this to the threshold is there: a wait so short might not move the clock at all.
SOON = 1e-9


class Camera:
    """One camera: for each resource what it held when it last answered, and what it has held so far."""

    def __init__(self, env: simpy.Environment, problem: Problem, slopes: FloatArray, agent: int) -> None:
        self.env = env
        self.inbox = simpy.Store(env)
        self.increase: list[float] = problem.increase[agent].tolist()
        self.decrease: list[float] = problem.decrease[agent].tolist()
        self.normalization: list[float] = problem.normalization.tolist()
        self.slopes: list[list[float]] = slopes[::-1, agent].T.tolist()
        self.held = [0.0] * problem.n_resources
        self.area = [0.0] * problem.n_resources
        self.since = [0.0] * problem.n_resources
        self.received = 0

    def demand(self, j: int) -> float:
        return self.held[j] + self.increase[j] * (self.env.now - self.since[j])

    def settle(self, j: int) -> None:
        """Bring demand and its integral up to now."""
        demand = self.demand(j)
        self.area[j] += (self.env.now - self.since[j]) * (self.held[j] + demand) / 2
        self.held[j] = demand
        self.since[j] = self.env.now

    def average(self, j: int) -> float:
        return self.area[j] / self.env.now

    def probability(self, j: int) -> float:
        average, gradient = self.average(j), 0.0
        for coefficient in self.slopes[j]:
            gradient = gradient * average + coefficient
        return self.normalization[j] * gradient / average

    def process(self, luck: np.random.Generator) -> Life:
        while True:
            j = yield self.inbox.get()
            self.received += 1
            self.settle(j)
            if luck.random() < self.probability(j):
                self.held[j] *= self.decrease[j]


class Channel:
    """Loses some messages and delays the others."""

    def __init__(
        self, env: simpy.Environment, latency: float, loss: float, luck: np.random.Generator
    ) -> None:
        self.env = env
        self.latency = latency
        self.loss = loss
        self.luck = luck

    def message(self, camera: Camera, j: int, delay: float) -> Life:
        yield self.env.timeout(delay)
        camera.inbox.put(j)

    def broadcast(self, cameras: list[Camera], j: int) -> None:
        arrives = (self.luck.random(len(cameras)) >= self.loss).tolist()
        delays = self.luck.exponential(self.latency, len(cameras)).tolist()
        for camera, arriving, delay in zip(cameras, arrives, delays, strict=True):
            if arriving:
                self.env.process(self.message(camera, j, delay))


class ControlUnit:
    """Signals when the total reaches its threshold, and holds off."""

    def __init__(self, env: simpy.Environment, problem: Problem, hold_off: float) -> None:
        self.env = env
        self.limit: list[float] = problem.limit.tolist()
        self.slope: list[float] = problem.increase.sum(axis=0).tolist()
        self.hold_off = hold_off
        self.signals = [0] * problem.n_resources

    def process(self, j: int, cameras: list[Camera], channel: Channel) -> Life:
        while True:
            total = sum(camera.demand(j) for camera in cameras)
            wait = (self.limit[j] - total) / self.slope[j]
            if wait > SOON:  # responses only lower the total, so it cannot get there earlier
                yield self.env.timeout(wait)
            else:
                self.signals[j] += 1
                channel.broadcast(cameras, j)
                yield self.env.timeout(self.hold_off)


def run(
    problem: Problem,
    slopes: FloatArray,
    until: float,
    latency: float,
    loss: float,
    hold_off: float,
    seed: int,
) -> tuple[IntArray, FloatArray, int]:
    """Return the number of signals, shape (m,), the averages at the end, (n, m), and the deliveries.

    `slopes` are the derivatives' coefficients, (terms, n, m), lowest power first.
    """
    env, luck = simpy.Environment(), np.random.default_rng(seed)
    cameras = [Camera(env, problem, slopes, agent) for agent in range(problem.n_agents)]
    channel = Channel(env, latency, loss, luck)
    unit = ControlUnit(env, problem, hold_off)
    for camera in cameras:
        env.process(camera.process(luck))
    for j in range(problem.n_resources):
        env.process(unit.process(j, cameras, channel))
    env.run(until=until)
    for camera in cameras:
        for j in range(problem.n_resources):
            camera.settle(j)
    averages = [[camera.average(j) for j in range(problem.n_resources)] for camera in cameras]
    return np.array(unit.signals), np.array(averages), sum(camera.received for camera in cameras)
