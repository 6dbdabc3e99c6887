"""What the operator has disturbed, in the words in which agents and the server report it; observers read them again."""

from __future__ import annotations

from coheft.wire.scenario.network import LinkQuality

_LINK = "the operator has disturbed the link from "
_LINK_RESTORED = "the operator has restored the link from "
_CLOCK = "the operator has set the clock of "
_CLOCK_RESTORED = "the operator has restored the clock of "


def changed_link(sender: str, quality: LinkQuality) -> str:
    """Say that messages of a neighbour are lost or late from now on, or that they are not any more."""
    if quality.is_ideal:
        return f"{_LINK_RESTORED}{sender}"
    return f"{_LINK}{sender}: {quality.in_words}"


def set_clock(robot: str, ahead: float) -> str:
    """Say how far a robot's clock is ahead from now on [s]."""
    return f"{_CLOCK}{robot}: {ahead:g} s ahead" if ahead else f"{_CLOCK_RESTORED}{robot}"


def disturbance_in(source: str, text: str) -> tuple[tuple[str, ...], str] | None:
    """Read a report of these.

    Args:
        source: Who reports it.
        text: The report.

    Returns:
        The clock's robot, or the sender and the receiver of a link's messages, and what is disturbed; that is empty if
        it has been restored. None if it is another report.
    """
    for disturbed, restored, end in ((_LINK, _LINK_RESTORED, (source,)), (_CLOCK, _CLOCK_RESTORED, ())):
        if text.startswith(restored):
            return (text.removeprefix(restored), *end), ""
        if text.startswith(disturbed):
            name, _, what = text.removeprefix(disturbed).partition(": ")
            return (name, *end), what
    return None
