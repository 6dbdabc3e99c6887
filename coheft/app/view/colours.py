"""Colours, each with one meaning, for the scene and the panel."""

from coheft.wire.messages.structs import Validity

Colour = tuple[int, int, int]

ACCENT: Colour = (56, 189, 248)
"""The chosen robot, and its estimate."""
TRUTH: Colour = (236, 240, 245)
"""The truth, which no robot knows."""
GOOD: Colour = (52, 211, 153)
"""Valid estimates, links that work."""
WAITING: Colour = (148, 163, 184)
"""No estimate yet."""
BAD: Colour = (248, 113, 113)
"""Stale estimates, silent links."""
LOAD: Colour = (251, 191, 36)
FORCE: Colour = (250, 204, 21)
TORQUE: Colour = (168, 85, 247)
PAYLOAD: Colour = (100, 116, 139)
ARM: Colour = (203, 213, 225)
JOINT: Colour = (71, 85, 105)
STAND: Colour = (51, 65, 85)

STATUS = {Validity.STARTING: WAITING, Validity.VALID: GOOD, Validity.STALE: BAD}
LINK: dict[str, Colour] = {"up": GOOD, "silent": BAD, "unknown": WAITING}


def css(colour: Colour) -> str:
    """Return the colour for HTML."""
    return "#{:02x}{:02x}{:02x}".format(*colour)
