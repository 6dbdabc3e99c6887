"""Lists of names."""

from __future__ import annotations

from coheft.app.names import few


def test_a_large_team_does_not_fill_the_screen() -> None:
    names = [f"r{number:02}" for number in range(1, 49)]
    assert few(names) == "r01, r02, r03, r04, r05, r06, r07 and 41 more"
    assert few(names[:8]) == "r01, r02, r03, r04, r05, r06, r07, r08"
    assert few(["r1"]) == "r1"
