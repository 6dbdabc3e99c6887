"""Lengths that cannot be meant: payloads that no one could carry, hands that are nowhere near."""

from __future__ import annotations

import numpy as np
import pytest

from coheft.errors import ScenarioError
from coheft.wire.scenario.file import parse_scenario
from coheft.wire.scenario.payload import Box, MassProperties
from coheft.wire.scenario.payload_extent import Extent

BOX = "boxes = [{ mass = 2.0, size = [0.4, 0.3, 0.1], position = [0.1, 0.0, 0.0] }]"
PLATE = "properties = { mass = 6.0, com = [0.1, 0.0, 0.0], principal = [0.03, 0.08, 0.1] }"
SOFT = "stiffness = [50.0, 1.0]\ndamping = [2.0, 0.1]"
"""Arms that shake nothing apart, however far out they hold it."""
GRASPS = "grasps = [{ position = [0.0, 0.0, 0.0] }, { position = [%s, 0.0, 0.0] }]"


def parse(payload: str, robots: str) -> None:
    parse_scenario(f'name = "x"\n[payload]\n{payload}\n[robots]\n{SOFT}\n{robots}\n', "x.toml")


def test_a_box_of_the_same_mass_properties_is_the_box() -> None:
    box = Box(mass=3.0, size=(0.6, 0.2, 0.1), position=(0.3, -0.1, 0.2), rotation_deg=(0.0, 0.0, 90.0))
    x, y, z = np.diag(box.inertia().tensor).tolist()
    extent = Extent.like(MassProperties(mass=3.0, com=(0.3, -0.1, 0.2), principal=(x, y, z)))
    np.testing.assert_allclose(extent.lower, [0.2, -0.4, 0.15])
    np.testing.assert_allclose(extent.upper, [0.4, 0.2, 0.25])
    assert extent.length == pytest.approx(0.6)


def test_distance_is_that_to_the_nearest_point() -> None:
    extent = Extent.around(np.array([[-1.0, -1.0, -1.0], [1.0, 1.0, 1.0]]))
    assert extent.complaint((0.5, 0.9, -1.0)) == ""
    assert extent.complaint((4.0, 5.0, 0.0)).startswith("is 5 m outside the payload")


@pytest.mark.parametrize("x", ["-0.1", "0.3", "0.69", "-0.49"])
def test_hands_near_a_payload_are_fine(x: str) -> None:
    parse(BOX, GRASPS % x)


@pytest.mark.parametrize(("x", "distance"), [("0.71", "0.41"), ("3.3", "3"), ("-200.0", "200")])
def test_a_hand_far_outside_is_named(x: str, distance: str) -> None:
    with pytest.raises(ScenarioError) as error:
        parse(BOX, GRASPS % x)
    assert str(error.value) == (
        f"x.toml: key 'robots.grasps[1].position': found [{x}, 0.0, 0.0], which is {distance} m outside the payload, "
        f"which is 0.4 m long; expected at most 0.4 m: positions are in metres, in the payload's frame"
    )


def test_what_is_known_by_its_mass_properties_may_reach_further_but_not_a_thousand_times() -> None:
    parse(PLATE, GRASPS % "3.0")
    with pytest.raises(ScenarioError, match=r"robots.grasps\[1\].position': found \[400.0, .* m outside the payload"):
        parse(PLATE, GRASPS % "400.0")


def test_a_rim_far_outside_is_refused() -> None:
    parse(BOX, "perimeter = { count = 3, extent = [1.0, 1.0] }")
    with pytest.raises(
        ScenarioError, match=r"'robots.perimeter.extent': found \[1.0, 300.0\], of which a side is 150 m"
    ):
        parse(BOX, "perimeter = { count = 3, extent = [1.0, 300.0] }")


@pytest.mark.parametrize(("payload", "near", "far"), [(BOX, 0.6, 0.8), (PLATE, 3.0, 400.0)])
def test_loads_are_put_where_hands_may_be(payload: str, near: float, far: float) -> None:
    robots = GRASPS % "0.1"
    change = "[[load_changes]]\nat = 1.0\nmass = 1.0\nposition = [%s, 0.0, 0.0]"
    parse(payload, f"{robots}\n{change % near}")
    message = rf"'load_changes\[1\].position': found \[{far}, 0.0, 0.0\], which is .* m outside the payload, which is"
    with pytest.raises(ScenarioError, match=message):
        parse(payload, f"{robots}\n{change % near}\n{change % far}")
    parse(payload, f"{robots}\n{change % near}\n[[load_changes]]\nat = 2.0\nremove = 1")
    with pytest.raises(
        ScenarioError, match=r"'load_changes\[0\].size': found \[900.0, 0.1, 0.1\], which is 900 m long"
    ):
        parse(payload, f"{robots}\n{change % near}\nsize = [900.0, 0.1, 0.1]")


@pytest.mark.parametrize(
    ("payload", "message"),
    [
        (
            BOX.replace("0.4, 0.3, 0.1", "400, 300, 100"),
            "'payload.boxes': the payload is 400 m long, expected at most 20",
        ),
        (BOX.replace("0.4", "1e300"), "'payload.boxes': the payload is 1e+300 m long"),
        (
            PLATE.replace("0.03, 0.08, 0.1", "30e3, 80e3, 100e3"),
            "'payload.properties': a box with such mass properties is",
        ),
    ],
)
def test_payloads_that_nobody_could_carry(payload: str, message: str) -> None:
    with pytest.raises(ScenarioError) as error:
        parse(payload, GRASPS % "0.2")
    assert message in str(error.value)
