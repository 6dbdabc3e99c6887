"""Checks of stamps: a clock that is far ahead would make its robot's agent wait for that long."""

from statistics import median_low

from coheft.errors import MessageError

LIMIT = 10 * 10**9
"""Time by which stamps may be ahead [ns]; network delays are shorter."""


class Stamps:
    """Estimates how far the clock of the robots' stamps is ahead of our own, which gives arrival times.

    How far does not matter, only that it does not grow at once. It may shrink: simulations are paused. It may grow with
    each block: recordings are played fast. And it may jump, if it does so for most robots, and more than one.
    """

    def __init__(self, robots: int) -> None:
        self._robots = robots
        self._heard: dict[str, tuple[int, int]] = {}
        self._lead = 0

    def receive(self, robot: str, stamp: int, arrival: int) -> None:
        """Note a robot's newest measurement: its stamp [ns], and its arrival [ns], by our own clock."""
        self._heard[robot] = stamp - arrival, stamp

    def settle(self, *, patient: bool) -> int | None:
        """Use the time of those robots that agree on it; return their newest stamp [ns], None if they are too few.

        So a robot whose clock is wrong does not decide when the run begins, if there are others to compare with: those
        that agree have to be more than half of all that have sent measurements, or, if ``patient``, of all robots.
        """
        if not self._heard:
            return None
        middle = self._middle
        agreeing = [heard for heard in self._heard.values() if abs(heard[0] - middle) <= LIMIT]
        if 2 * len(agreeing) <= (self._robots if patient else len(self._heard)):
            return None
        self._lead = max(lead for lead, _ in agreeing)
        return max(stamp for _, stamp in agreeing)

    @property
    def disagreement(self) -> str:
        """Name the robots whose clocks to check; empty if all agree."""
        middle = self._middle if self._heard else 0
        ahead = {name: lead - middle for name, (lead, _) in self._heard.items() if lead - middle > LIMIT}
        if not ahead:
            return ""
        return (
            f"stamps of {', '.join(ahead)} are up to {max(ahead.values()) / 1e9:.1f} s ahead of others', expected less "
            f"than {LIMIT / 1e9:g} s: check the robots' clocks"
        )

    @property
    def _middle(self) -> int:
        return median_low(lead for lead, _ in self._heard.values())

    def check(self, robot: str, stamp: int, arrival: int) -> None:
        """Check a robot's later measurement, its stamp and its arrival [ns]; ``MessageError`` if it is from the far
        future.
        """
        self.receive(robot, stamp, arrival)
        lead = self._lead
        if stamp - arrival - lead > LIMIT and self._robots > 1:
            self.settle(patient=True)
            self._lead = max(self._lead, lead)
        ahead = stamp - arrival - self._lead
        if ahead > LIMIT:
            raise MessageError(
                f"the stamp is {ahead / 1e9:.1f} s ahead of the time that has passed, expected at most "
                f"{LIMIT / 1e9:g} s: check the robot's clock; if it is right, start driver and agents again"
            )

    def trust(self, stamp: int, arrival: int) -> None:
        """Update the clock's offset by a measurement that completes a block."""
        self._lead = max(self._lead, stamp - arrival)
