"""How pages of the documentation are read by the tests that run their commands."""

from __future__ import annotations

import pytest

from tests.docs_blocks import missing_line

PRINTED = """\
  robot   mass
     left  5.003 kg
     right  4.998 kg
The run has ended at 24.00 s.
"""


@pytest.mark.parametrize(
    "shown",
    [
        ["robot mass", "left 5.1 kg", "right 4 kg"],
        ["left 5.003 kg", "…", "The run has ended at 3 s."],
        ["The run … at 24.00 s."],
        [],
    ],
)
def test_what_is_shown_has_been_printed_but_for_numbers_and_spaces(shown: list[str]) -> None:
    assert missing_line(shown, PRINTED) is None


@pytest.mark.parametrize(
    ("shown", "missing"),
    [
        (["third 5.003 kg"], "third 5.003 kg"),
        (["left 5.003 g"], "left 5.003 g"),
        (["right 4.998 kg", "left 5.003 kg"], "left 5.003 kg"),
        (["left 5.003 kg", "left 5.003 kg"], "left 5.003 kg"),
        (["mass"], "mass"),
    ],
)
def test_what_is_not_printed_so_or_in_another_order_is_found(shown: list[str], missing: str) -> None:
    assert missing_line(shown, PRINTED) == missing
