"""What the view's controls choose, without any browser."""

from __future__ import annotations

import pytest

from coheft.app.run.folder import RunFile
from coheft.app.view import words
from coheft.errors import CoheftError
from coheft.wire.messages.truth import LoadState

pytest.importorskip("viser", reason="the view needs viser: install 'coheft[view]'")

from coheft.app.view.controls import LoadChoice
from coheft.app.view.disturbing import Disturbing
from coheft.app.view.model import ViewModel
from coheft.app.view.place import Place
from coheft.app.view.server import open_server
from tests.ports import free_port
from tests.test_view_model import STATUS
from tests.waiting import wait_until


def load(number: int, mass: float) -> LoadState:
    return LoadState(number, mass, (0.0, 0.0, 0.1), (0.1, 0.1, 0.1))


@pytest.fixture
def choice():
    with open_server(Place.choose("127.0.0.1", free_port())) as server:
        yield LoadChoice(server.gui)


def test_the_choice_stays_while_a_load_leaks(choice):
    choice.show([load(1, 3.0), load(2, 2.0)])
    choice.dropdown.value = "#2"
    for mass in (1.9, 1.8, 0.0):
        choice.show([load(1, 3.0), load(2, mass)])
        assert choice.number == 2
        assert choice.dropdown.options == ("#1", "#2")
        assert f"#2 of {mass:.1f} kg" in choice.masses.content


def test_the_choice_stays_while_other_loads_come_and_go(choice):
    choice.show([load(1, 3.0), load(2, 2.0)])
    choice.dropdown.value = "#2"
    for others in ([1, 2, 3], [2, 3], [2], [2, 4]):
        choice.show([load(number, 1.0) for number in others])
        assert choice.number == 2


def test_nothing_takes_the_place_of_a_chosen_load_that_is_gone(choice):
    choice.show([load(1, 3.0), load(2, 2.0)])
    choice.dropdown.value = "#2"
    for there in ([load(1, 3.0)], [load(1, 3.0), load(3, 1.0)]):
        choice.show(there)
        with pytest.raises(CoheftError, match="choose a load"):
            _ = choice.number
    choice.dropdown.value = "#3"
    choice.show([load(1, 3.0), load(3, 1.0)])
    assert choice.number == 3
    assert choice.dropdown.options == ("#1", "#3"), "nobody has to choose any more"


def test_the_first_load_is_chosen_at_once(choice):
    for number in (1, 2):
        choice.show([])
        with pytest.raises(CoheftError, match="no load"):
            _ = choice.number
        choice.show([load(number, 3.0)])
        assert choice.number == number


def test_a_load_has_its_number_and_its_mass_wherever_it_is_shown():
    assert words.load(load(2, 1.96)) == "#2 of 2.0 kg"
    assert "#1 of 3.0 kg · #2 of 2.0 kg" in words.loads([load(1, 3.0), load(2, 1.96)])


def test_a_clock_belongs_to_a_robot_and_not_to_a_link():
    run_file = RunFile("run", "tcp/127.0.0.1:1", {})
    with open_server(Place.choose("127.0.0.1", free_port())) as server:
        disturbing = Disturbing(server.gui, ViewModel(STATUS), run_file, lambda *_: None)
        assert disturbing.where.options == ("r1-r2", "r2-r3", "r1", "r2", "r3")
        assert disturbing.clock.disabled
        disturbing.where.value = "r2"
        wait_until(lambda: not disturbing.clock.disabled, "the clock to be offered")
