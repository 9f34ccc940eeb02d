"""A run of the synchronous algorithm in progress: taken as far as one likes, looked at, forked and ended."""

import math
from typing import TYPE_CHECKING, Any, Literal, NamedTuple, get_args

import numpy as np

from aimd_des.dynamics.averaging import Averaging
from aimd_des.dynamics.custom_response import check_returned, with_address
from aimd_des.dynamics.demand import DISCRETE
from aimd_des.dynamics.responses import Response, memory_columns
from aimd_des.dynamics.state import AgentParameters, State, agent_parameters
from aimd_des.dynamics.totals import observe
from aimd_des.problem.costs import CostTable, cost_table
from aimd_des.problem.problem import Problem
from aimd_des.results.kept_rows import Kept
from aimd_des.results.metrics import Stretch, overshoot_of
from aimd_des.results.overload import Opportunities
from aimd_des.results.result import Result
from aimd_des.results.run_data import Account, Observations, Signals
from aimd_des.synchronous.answers import AHEAD, StepBuffers
from aimd_des.synchronous.kernels import RecordBuffers, StepControl, take_custom_steps, take_steps
from aimd_des.utils import rng, validation
from aimd_des.utils.errors import SimulationError
from aimd_des.utils.locked_arrays import locked
from aimd_des.utils.rng import FOUR, Key, Purpose
from aimd_des.utils.validation import BoolArray, FloatArray

if TYPE_CHECKING:
    import pandas as pd

StepKind = Literal["step", "signal"]

# Demands that are added up, about, before Python is asked whether Ctrl-C was pressed: a tenth of a second.
_IN_ONE_GO = 3 * 10**7

# Rows are filled up to a multiple of this many agents: four vectors of four numbers, or two of eight.
_PASS = 16


class Law(NamedTuple):
    """What agents do, for compiled code."""

    table: CostTable  # empty where the costs have no formula that compiled code knows
    parameters: AgentParameters


class StepsSetting(NamedTuple):
    """What a run was asked for."""

    problem: Problem
    steps: int
    seed: int
    lag: int
    averaging: Averaging | None
    response: Response | None

    def law(self) -> Law:
        """Lay out what agents do."""
        parameters = _parameters(self.problem, self.averaging, self.response)
        answering = with_address(self.response, parameters.response)
        table = cost_table(self.problem.costs)
        if table.n_agents:
            table = _filled_table(table, self.problem.n_agents)
        return Law(table, parameters._replace(response=answering))


class SynchronousRun:
    """A run of the synchronous algorithm in progress, made by `start_synchronous`.

    It may be advanced in any number of pieces: the result is that of `run_synchronous`, to the last bit.

    Parameters
    ----------
    setting : StepsSetting
        What was asked for.
    law : Law
        What agents do.
    salts : tuple of int
        Of the forks that have led here and were given draws of their own.
    key : tuple of two uint64
        What responses are drawn with.
    state : State
        Of all agents, as arrays of this run.
    control : StepControl
        The control unit, as arrays of this run.
    records : RecordBuffers
        What is still to be recorded.

    Examples
    --------
    >>> from aimd_des.lowlevel import start_synchronous
    >>> from models import smart_cameras
    >>> run = start_synchronous(smart_cameras(0), steps=100, seed=0)
    >>> run.advance(to=40)
    >>> run.time, run.until
    (40, 100)
    >>> run.totals().index.tolist()
    ['memory', 'disk', 'bandwidth']
    >>> run.result().until
    100.0
    """

    def __init__(
        self,
        setting: StepsSetting,
        law: Law,
        salts: tuple[int, ...],
        key: Key,
        state: State,
        control: StepControl,
        records: RecordBuffers,
    ) -> None:
        self._setting, self._law, self._salts, self._key = setting, law, salts, key
        self._state, self._control, self._records = state, control, records
        self._buffers = _step_buffers(state, setting.problem.n_agents)
        self._taken = 0
        self._looks = (records.demand_steps, records.allocation_steps)
        # What a run that this one was forked of has recorded.
        self._sent: tuple[BoolArray, ...] = ()
        self._totals, self._pages = Kept(), Kept()
        self._result: Result | None = None
        self._failed = False

    @property
    def until(self) -> int:
        """K, the number of steps of the whole run."""
        return self._setting.steps

    @property
    def time(self) -> int:
        """How many steps have been taken: k, where agents hold x(k) and the look at it is still to come."""
        return self._taken

    def peek(self) -> float:
        """Tell when the next step is taken.

        Returns
        -------
        float
            The present; infinity if the run stands at its end.
        """
        return float(self._taken) if self._taken < self.until else math.inf

    def advance(self, to: int | None = None) -> None:
        """Take steps until some number of them has been taken in all.

        Parameters
        ----------
        to : int, optional
            Not less than have been taken, and at most K; default: K.

        Raises
        ------
        InputError
            If the number is out of its range, or a part of one's own hands back what it cannot.
        SimulationError
            If an earlier piece of the run has failed.
        """
        goal = self.until if to is None else validation.integer("to", to, low=self._taken, high=self.until)
        if self._failed:
            raise SimulationError(f"the run has failed at step {self._taken}: start another one")
        self._failed = True
        block = max(1, _IN_ONE_GO // (self._setting.problem.n_agents * self._setting.problem.n_resources))
        while self._taken < goal:
            last = min(self._taken + block, goal)
            self._take(last)
            self._taken = last
        self._failed = False

    def _take(self, last: int) -> None:
        table, parameters = self._law
        span = self._taken, last, self._setting.lag, self._key
        memory = self._control, self._records, self._buffers
        if table.n_agents:
            take_steps(self._state, parameters, table, *span, *memory)
        else:
            take_custom_steps(self._setting.problem.costs, self._state, parameters, *span, *memory)
        # Steps keep the anchor of the first agent alone; it is that of all.
        self._state.anchor[:] = self._state.anchor[:, :1]
        check_returned(self._setting.response, parameters.response)

    def step(self, kind: StepKind = "step") -> bool:
        """Take the next step, or all up to the next one whose look broadcasts a signal.

        Parameters
        ----------
        kind : {"step", "signal"}
            What to go on to.

        Returns
        -------
        bool
            Whether there was one before the end; if not, the run stands at its end.

        Raises
        ------
        InputError, SimulationError
            As for `advance`.
        """
        validation.choice("kind", kind, get_args(StepKind))
        while self._taken < self.until:
            self.advance(self._taken + 1)
            if kind == "step" or self._control.broadcast[self._taken - 1].any():
                return True
        return False

    def totals(self) -> "pd.DataFrame":
        """Look at the whole of each resource as it is now; this changes nothing in the run.

        Returns
        -------
        DataFrame
            Indexed by resource: ``demand`` and ``average``, both summed over the agents, and ``capacity``, in
            units of the resource, and the number of ``signals`` broadcast so far.
        """
        import pandas as pd

        problem, state = self._setting.problem, self._state
        demand, average = np.empty_like(state.demand), np.empty_like(state.demand)
        observe(state, self._law.parameters, np.array([float(self._taken)]), DISCRETE, demand, average)
        n = problem.n_agents
        return pd.DataFrame(
            {
                "demand": demand[:, :n].sum(axis=1),
                "average": average[:, :n].sum(axis=1),
                "capacity": problem.capacity,
                "signals": self._broadcast().sum(axis=0),
            },
            index=pd.Index(problem.resource_names, name="resource"),
        )

    def fork(self, salt: int | None = None, *, response: Response | None = None) -> "SynchronousRun":
        """Begin another run where this one stands, which goes on unaffected.

        With nothing given, it ends as this one does, to the last bit.  What has been recorded is shared.

        Parameters
        ----------
        salt : int, optional
            At least 0, for other draws from now on; default: the same ones.
        response : Response, optional
            How agents answer from now on; what the one before has kept is gone.

        Returns
        -------
        SynchronousRun
            At the same step, with the same end.

        Raises
        ------
        InputError
            If the salt or the response is none.
        SimulationError
            If the run has failed, or is over.
        """
        if self._failed or self._result is not None:
            what = "has failed" if self._failed else "is over"
            raise SimulationError(f"the run {what} at step {self._taken}: only one in progress can be forked")
        salts, key = self._salts, self._key
        if salt is not None:
            salts = (*salts, validation.integer("salt", salt, low=0))
            key = rng.key(self._setting.seed, Purpose.RESPONSE, salts)
        setting, law = self._setting, self._law
        state: State = _copied(self._state)
        if response is not None:
            setting = setting._replace(response=response)
            law = setting.law()
            columns = memory_columns(law.parameters.response, law.parameters.averaging)
            state = state._replace(memory=np.zeros((*state.demand.shape, columns)))
        broadcast = self._control.broadcast
        control: StepControl = _copied(self._control._replace(broadcast=broadcast[:0]))
        control = control._replace(broadcast=np.zeros(broadcast.shape, dtype=np.bool_))
        fork = SynchronousRun(setting, law, salts, key, state, control, self._records_left())
        fork._looks = self._looks
        fork._taken, taken = self._taken, sum(map(len, self._sent))
        fork._sent = (*self._sent, self._control.broadcast[taken : self._taken])
        row, page, _ = self._records.cursor[0]
        records = self._records
        fork._totals = Kept(*self._totals.with_more(records.total_demand[:row], records.total_average[:row]))
        fork._pages = Kept(*self._pages.with_more(records.demand[:page], records.average[:page]))
        return fork

    def _records_left(self) -> RecordBuffers:
        """Make buffers for what is still to be recorded."""
        # Between two steps all resources have been recorded equally far.
        records, (row, page, following) = self._records, self._records.cursor[0]
        m, n = len(records.cursor), self._setting.problem.n_agents
        rows, pages = len(records.demand_steps) - row, len(records.allocation_steps) - page
        return RecordBuffers(
            demand_steps=records.demand_steps[row:],
            total_demand=np.zeros((rows, m)),
            total_average=np.zeros((rows, m)),
            allocation_steps=records.allocation_steps[page:],
            demand=np.zeros((pages, m, n)),
            average=np.zeros((pages, m, n)),
            cursor=np.array([[0, 0, following]] * m, dtype=np.int64),
        )

    def _broadcast(self) -> BoolArray:
        """Return which steps so far have broadcast for which resources."""
        taken = sum(map(len, self._sent))
        return np.concatenate([*self._sent, self._control.broadcast[taken : self._taken]])

    def result(self) -> Result:
        """Take the steps that are left, and give what `run_synchronous` gives.

        Returns
        -------
        Result
            The same object whenever it is asked for.

        Raises
        ------
        InputError, SimulationError
            As for `advance`.
        """
        if self._result is None:
            self.advance()
            self._result = self._conclude()
        return self._result

    def _conclude(self) -> Result:
        problem, steps, seed, *_ = self._setting
        signals, observations, account = self._outcome()
        # The looks at K / 2 or later, as the load that they are held against is that of the second half.
        looks = Opportunities(float(steps - (steps + 1) // 2), 1.0)
        return Result(
            problem, "discrete", seed, float(steps), signals, observations, account, opportunities=looks
        )

    def _signals(self) -> Signals:
        """Return the broadcasts in the order of an asynchronous run: by step, and then by resource."""
        # In one dimension: NumPy takes ten times as long to search two.
        m = self._setting.problem.n_resources
        places = np.flatnonzero(self._broadcast())
        step = places // m
        resource, number = places - m * step, np.empty_like(step)
        for j in range(m):
            own = np.flatnonzero(resource == j)
            number[own] = np.arange(len(own))
        return Signals(step.astype(np.float64), resource, number)

    def _outcome(self) -> tuple[Signals, Observations, Account]:
        problem, steps, control, records = (
            self._setting.problem,
            self.until,
            self._control,
            self._records,
        )
        signals = self._signals()
        measures = (control.peak, control.above, control.excess, control.used)
        stretches = (Stretch(0.0, float(steps), problem.capacity, *measures),)
        demand_steps, allocation_steps = self._looks
        observations = Observations(
            demand_steps,
            *self._totals.followed_by(records.total_demand, records.total_average),
            allocation_steps,
            *self._pages.followed_by(records.demand, records.average),
            overshoot_of(stretches),
            (control.used - control.half) / (0.5 * steps) / problem.capacity,
            stretches,
        )
        # There is no channel: every copy of every signal reaches its agent.
        n, sent = problem.n_agents, signals.counts(problem.n_resources)
        nothing = np.zeros((problem.n_resources, n), dtype=np.int64)
        account = Account(
            delivered=nothing + sent[:, None],
            lost=nothing,
            in_flight=nothing,
            duplicated=nothing,
            responses=self._state.responses[:, :n].copy(),
            saturated=self._state.saturated[:, :n].copy(),
        )
        return signals, observations, account


def _copied(arrays: Any) -> Any:
    """Copy a tuple of arrays."""
    return type(arrays)(*(array.copy() for array in arrays))


def _parameters(problem: Problem, averaging: Averaging | None, response: Response | None) -> AgentParameters:
    """Lay out the parameters of the agents."""
    if averaging is not None:
        allowed = "an averaging, such as averaging.Window(100.0)"
        validation.instance("averaging", averaging, Averaging, allowed)
    if response is not None:
        validation.instance("response", response, Response, "a response, such as responses.Derandomised()")
    parameters = agent_parameters(problem, DISCRETE, averaging, response=response)
    return parameters._replace(
        increase=locked(_filled(parameters.increase, 0.0)), decrease=locked(_filled(parameters.decrease, 1.0))
    )


def _filled(rows: FloatArray, filler: float) -> FloatArray:
    """Fill rows up to whole passes along agents."""
    n = rows.shape[-1]
    filled = np.full((*rows.shape[:-1], n + -n % _PASS), filler)
    filled[..., :n] = rows
    return filled


def _filled_table(table: CostTable, n: int) -> CostTable:
    """Fill derivatives up with agents that have none."""
    return CostTable(*(_filled(part, 0.0) if part.shape[-1] == n else part for part in table))


def _step_buffers(state: State, n: int) -> StepBuffers:
    m, width = state.demand.shape
    folded, average, gradient = np.zeros((3, m, width))
    words = np.zeros(width, dtype=np.uint64)
    draws, totals = words[: n + -n % FOUR], np.zeros(AHEAD)
    acting = np.zeros(m, dtype=np.bool_)
    return StepBuffers(folded, average, gradient, words, np.zeros((2, width)), draws, totals, acting)
