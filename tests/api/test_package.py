"""What ``import coheft`` offers, and what it costs."""

from __future__ import annotations

import subprocess
import sys

import pytest

import coheft


@pytest.mark.parametrize("name", coheft.__all__)
def test_all_that_is_offered_is_there(name):
    assert getattr(coheft, name) is not None
    assert name in dir(coheft)


def test_what_is_not_offered_is_an_error():
    with pytest.raises(AttributeError, match="no attribute 'runn'"):
        coheft.runn  # noqa: B018


def test_importing_it_loads_nothing_else():
    code = "import sys, coheft; print(sorted({'numpy', 'msgspec', 'mujoco', 'zenoh', 'rich'} & set(sys.modules)))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"
