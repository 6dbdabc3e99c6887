"""Equations of the documentation are drawn as they are meant."""

from __future__ import annotations

import runpy
from pathlib import Path

import pytest

pytest.importorskip("sphinx", reason="equations need what builds the documentation")
MATHML = runpy.run_path(str(Path(__file__).parents[1] / "docs" / "mathml.py"))
NAMESPACE = 'xmlns="http://www.w3.org/1998/Math/MathML"'


def drawn(letter: str, above: str) -> str:
    text: str = MATHML["with_accents"](
        f"<math {NAMESPACE}><munderover>{letter}<mi>i</mi><mo>{above}</mo></munderover></math>"
    )
    return text


def test_a_subscript_stands_beside_a_letter_with_a_dot() -> None:
    expected = '<msub><mover accent="true"><mi>x</mi><mo>˙</mo></mover><mi>i</mi></msub>'
    assert drawn("<mi>x</mi>", "˙") == f"<math {NAMESPACE}>{expected}</math>"


def test_limits_of_sums_stay_where_they_are() -> None:
    assert "<munderover><mo>∑</mo><mi>i</mi><mo>n</mo></munderover>" in drawn("<mo>∑</mo>", "n")


def test_characters_may_have_the_names_that_html_has_for_them() -> None:
    assert "\xa0" in MATHML["with_accents"](f"<math {NAMESPACE}><mtext>&nbsp;&lt;</mtext></math>")
