"""Which cameras are there when, if they come and go one by one."""

import numpy as np

from aimd_des import lowlevel
from aimd_des.interventions import Absence, Crash, Intervention, Join

#: A camera stays for a time of mean T and is away for one of half of that: two thirds are present.
PRESENT, _AWAY = 2 / 3, 0.5


def schedule(
    stay: float, until: float, returns: type[Absence] | type[Crash], seed: int, n: int = 60
) -> list[Intervention]:
    """Draw which of n cameras are there when, declared before the run; time 0 finds the long run.

    Draw k of camera i has the address (k, i): runs of the same seed share it, for any mean stay.
    Continuous agents have no clocks, so that the stream of the clocks is free for this.
    """
    key = lowlevel.key(seed, lowlevel.Purpose.CLOCK)
    here = lowlevel.uniforms(key, 0, 0, n) < PRESENT
    found: list[Intervention] = []
    if np.isinf(stay):
        away = np.flatnonzero(~here).tolist()
        return [Absence(away, 0.0)] if away else []
    time, number = np.zeros(n), 0
    while (time < until).any():
        number += 1
        lasts = np.where(here, stay, _AWAY * stay) * -np.log1p(-lowlevel.uniforms(key, 0, number, n))
        for i in np.flatnonzero(~here & (time < until)).tolist():
            end = float(time[i] + lasts[i])
            found.append(returns(i, float(time[i]), end) if number > 1 else Join(i, end))
        time, here = time + lasts, ~here
    return found
