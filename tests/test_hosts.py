"""Ports for the parts of a run on one machine."""

from __future__ import annotations

import pytest

from coheft.app.run.hosts import free_ports
from coheft.errors import LinkError


def test_only_ports_that_may_be_used_are_chosen(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("COHEFT_PORTS", "31000-31019")
    assert set(free_ports(5)) <= set(range(31000, 31020))
    with pytest.raises(LinkError, match=r"found .* free ports from 31000 to 31019, but the run needs 21"):
        free_ports(21)


@pytest.mark.parametrize("text", ["31000", "1-2", "31019-31000", "31000-70000", "a-b"])
def test_what_names_no_ports_is_refused(text: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("COHEFT_PORTS", text)
    with pytest.raises(LinkError, match=r"COHEFT_PORTS is .*, expected two ports"):
        free_ports(1)
