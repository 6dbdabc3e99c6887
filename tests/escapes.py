"""Escape sequences: what a terminal gets beside the text."""

from __future__ import annotations

import re

SEQUENCE = re.compile(r"\x1b\[[0-9;?]*[a-zA-Z]")
COLOUR = re.compile(r"\x1b\[(?:\d+;)*(?:3[0-8]|4[0-8]|9[0-7]|10[0-7])(?:;\d+)*m")
"""Sets a colour, of letters or of what is behind them: one of the eight, one of the 256, or any."""
