"""How often loads are forgotten: if again and again, a sensor may be faulty now and then, or poses may be wrong."""

from coheft.agents.efficient.settings import RowCounts


class Restlessness:
    """Remembers when loads were forgotten.

    Args:
        rows: How soon (``calm``) and for how long (``restless``) loads are forgotten again if something is wrong.

    Attributes:
        is_troubled: Whether the last load was forgotten soon after the one before, or before it was known.
    """

    def __init__(self, rows: RowCounts) -> None:
        self._rows, self.is_troubled = rows, False
        self._last = -rows.calm
        self._since: int | None = None  # when the first of the loads was forgotten

    def forget_load(self, number: int, was_known: bool) -> bool:
        """A load is forgotten at this row; return whether that has been so for too long."""
        self.is_troubled = not was_known or number - self._last < self._rows.calm
        if self._since is None or not self.is_troubled:
            self._since = number
        self._last = number
        return self.is_troubled and number - self._since > self._rows.restless
