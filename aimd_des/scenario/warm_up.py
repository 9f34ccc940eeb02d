"""The warm-up in a scenario file: the beginning of the run, which its measures leave out, as data."""

from typing import TYPE_CHECKING, Any

from aimd_des.scenario.kind_tables import KindTable, one_of
from aimd_des.scenario.strict_table import Table
from aimd_des.scenario.tables import ChannelSettings
from aimd_des.utils import validation

if TYPE_CHECKING:
    ControlUnitTable = KindTable
    ResponseTable = KindTable
else:
    ControlUnitTable = one_of("control_unit")
    ResponseTable = one_of("response")

#: What may be other during a warm-up, and what stands for a part that a scenario does not name.
EXCHANGED: dict[str, dict[str, Any]] = {
    "control_unit": {"kind": "sampled"},
    "channel": {},
    "response": {"kind": "randomised"},
}


class WarmUpSettings(Table):
    """``[warm_up]``: the beginning of the run, which its measures leave out.

    Attributes
    ----------
    until : float
        When it ends: after 0, and before the end of the run.
    control_unit, channel, response : table, optional
        In force until then; default: those of the scenario.
    """

    until: float
    control_unit: ControlUnitTable | None = None
    channel: ChannelSettings | None = None
    response: ResponseTable | None = None

    def check(self, until: float) -> None:
        """Refuse one that does not end within the run."""
        validation.number("warm_up.until", self.until, low=0.0, high=until, low_open=True, high_open=True)

    def given(self) -> dict[str, Any]:
        """Give the tables of the parts that are other until then."""
        return {name: table for name in EXCHANGED if (table := getattr(self, name)) is not None}
