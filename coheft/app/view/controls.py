"""Controls that act on the run, as the operator; a notification reports the result of each action."""

import os
import signal
import threading
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import viser

from coheft.app.run.folder import RunFile, find_run
from coheft.app.run.observer import ask_server, set_link
from coheft.app.view import words
from coheft.app.view.disturbing import Disturbing
from coheft.app.view.geometry import resting_place
from coheft.app.view.model import Edge, ViewModel
from coheft.app.view.page import Page
from coheft.errors import CoheftError
from coheft.wire.messages.requests import (
    EstimatorRequest,
    InjectRequest,
    PauseRequest,
    RemoveRequest,
    Request,
    RunState,
    StopRequest,
)
from coheft.wire.messages.truth import LoadState

_NOTE_SECONDS = 6.0
_TAKE_AWAY = "Take a load away"
_NO_LOAD = "nothing on it"
_CHOOSE = "choose one"
_MASSES = (0.1, 10.0, 0.1, 3.0)
"""Lowest, highest, step and initial value [kg]."""


class Controls:
    """The controls on the page.

    Callbacks run in viser's threads; a lock allows one action at a time.
    """

    def __init__(self, page: Page, model: ViewModel, run_file: RunFile, folder: Path) -> None:
        self._page = page
        self._model = model
        self._run_file = run_file
        self._folder = folder
        self._lock = threading.Lock()
        self._place = resting_place(page.stage.surface, model.scene.translations.mean(axis=0), _edge(_MASSES[3]))
        self._has_hit = False
        self._buttons: list[Any] = []
        gui = page.server.gui
        with page.controls:
            with gui.add_folder("Load"):
                self._add_load_controls(gui)
            with gui.add_folder("Run"):
                self._add_run_controls(gui)
            with gui.add_folder("Robots and links"):
                self._add_team_controls(gui)
            with gui.add_folder("Disturb", expand_by_default=False):  # or the legend does not fit on the first screen
                self._disturbing = Disturbing(gui, model, run_file, self._act)
        self._buttons += self._disturbing.buttons

    def _add_load_controls(self, gui: viser.GuiApi) -> None:
        least, most, step, first = _MASSES
        self._mass = gui.add_slider("Mass, kg", least, most, step, first)
        self._where = gui.add_html("")
        self._drop = gui.add_button(f"Drop {first:g} kg", icon=viser.Icon.DOWNLOAD, color="yellow")
        self._loads = LoadChoice(gui)
        self._remove = gui.add_button(_TAKE_AWAY, icon=viser.Icon.UPLOAD, disabled=True)
        self._buttons += [self._drop, self._remove]
        self._tell_place()

        @self._mass.on_update
        def _(_: object) -> None:
            self._drop.label = f"Drop {self._mass.value:g} kg"
            self._settle_place()

        @self._drop.on_click
        def _(event: Any) -> None:
            size = _edge(self._mass.value)
            request = InjectRequest(mass=float(self._mass.value), position=self._place, size=(size, size, size))
            self._ask(event, request, f"dropped {request.mass:g} kg")

        self._loads.dropdown.on_update(lambda _: self._tell_what_is_taken())
        self._remove.on_click(lambda event: self._act(event, self._take_away))

        @self._page.stage.on_payload_click
        def _(hit: Any) -> None:
            self._place = hit[0], hit[1], hit[2]
            self._has_hit = True
            self._settle_place()

    def _add_run_controls(self, gui: viser.GuiApi) -> None:
        self._pause = gui.add_button("Pause", icon=viser.Icon.PLAYER_PAUSE)
        stop = gui.add_button("Stop the run", icon=viser.Icon.PLAYER_STOP, color="red")
        status = self._model.status
        choice = gui.add_dropdown("Estimator", status.estimators, initial_value=status.estimator)
        begin_anew = gui.add_button(
            f"Restart with {status.estimator}",
            icon=viser.Icon.REFRESH,
            hint="All robots discard their estimates and use this estimator from the next block on",
        )

        self._buttons += [self._pause, stop, begin_anew]

        @self._pause.on_click
        def _(event: Any) -> None:
            pause = self._model.status.state is not RunState.PAUSED
            self._ask(event, PauseRequest(paused=pause), "paused" if pause else "resumed")

        stopped = "stopped; the terminal that started the run shows its report"
        stop.on_click(lambda event: self._ask(event, StopRequest(), stopped))

        @choice.on_update
        def _(_: object) -> None:
            begin_anew.label = f"Restart with {choice.value}"

        @begin_anew.on_click
        def _(event: Any) -> None:
            request = EstimatorRequest(estimator=str(choice.value))
            self._ask(event, request, f"the robots start again with {request.estimator}")

    def _add_team_controls(self, gui: viser.GuiApi) -> None:
        kill = gui.add_button(
            "Kill the chosen robot's agent",
            icon=viser.Icon.SKULL,
            color="red",
            disabled=not self._run_file.pids,
            hint="'coheft run' restarts it, with an empty memory",
        )
        names = ["-".join(edge) for edge in self._model.edges]
        link = gui.add_dropdown("Link", names or ["none"])
        change = gui.add_button_group("", ("Cut", "Mend"), disabled=not names)

        self._buttons += [kill]
        self._change = change

        kill.on_click(lambda event: self._act(event, self._kill, self._page.chosen))

        @change.on_click
        def _(event: Any) -> None:
            edge = self._model.edges[names.index(link.value)]
            self._act(event, self._set_link, edge, change.value == "Cut")

    def end(self, ask_again: Callable[[], None] | None) -> None:
        """Disable the controls, because the run has ended, and offer another one, unless ``ask_again`` is None."""
        for button in self._buttons:
            button.disabled = True
        self._change.visible = False  # a group cannot be disabled
        with self._page.controls:
            gui = self._page.server.gui
            gui.add_html(words.small(words.ENDED), order=-2.0)
            if ask_again is None:
                return
            again = gui.add_button("Run it again", icon=viser.Icon.REFRESH, color="teal", order=-1.0)

        @again.on_click
        def _(_: object) -> None:
            again.disabled = True
            ask_again()

    def update(self) -> None:
        """Update the controls to the state of the run."""
        status = self._model.status
        self._pause.label = "Resume" if status.state is RunState.PAUSED else "Pause"
        loads = self._model.loads
        self._loads.show(loads)
        self._remove.disabled = not loads
        self._tell_what_is_taken()
        self._disturbing.update()

    def _tell_what_is_taken(self) -> None:
        """Name the load that a click removes on the button, because the browser's list may be newer than ours."""
        chosen = self._loads.dropdown.value
        self._remove.label = f"Take {chosen} away" if chosen.startswith("#") else _TAKE_AWAY

    def _settle_place(self) -> None:
        """Place the load on top of the clicked point, for its present size."""
        self._place = resting_place(self._page.stage.surface, np.array(self._place), _edge(self._mass.value))
        self._tell_place()

    def _tell_place(self) -> None:
        x, y, z = self._place
        hint = "" if self._has_hit else " · click on the payload to choose another place"
        self._where.content = words.small(f"at {x:z.2f} {y:z.2f} {z:z.2f} m{hint}")
        self._page.stage.show_place(self._place, _edge(self._mass.value))

    def _ask(self, event: Any, request: Request, done: str) -> None:
        def ask() -> str:
            self._model.note_status(ask_server(self._run_file, request))
            return done

        self._act(event, ask)

    def _take_away(self) -> str:
        number = self._loads.number
        self._model.note_status(ask_server(self._run_file, RemoveRequest(load=number)))
        return f"took load {number} away"

    def _kill(self, robot: str) -> str:
        pid = find_run(self._folder).pids.get(robot)  # it may have been started again since
        if pid is None:
            raise CoheftError(f"the process of {robot} is not known here: it was started separately")
        os.kill(pid, signal.SIGKILL)
        return f"killed {robot}'s agent"

    def _set_link(self, edge: Edge, cut: bool) -> str:
        set_link(self._run_file, self._model.scene, *edge, cut=cut)
        return f"{'cut' if cut else 'mended'} the link {edge[0]}-{edge[1]}"

    def _act(self, event: Any, act: Callable[..., str], *arguments: Any) -> None:
        """Perform an action, and report the result to the client that clicked."""
        with self._lock:
            try:
                title, text, colour = "Done", act(*arguments), "teal"
            except (CoheftError, OSError) as error:
                title, text, colour = "Not done", str(error), "red"
        if event.client is not None:
            event.client.add_notification(title, text, auto_close_seconds=_NOTE_SECONDS, color=colour)


class LoadChoice:
    """A list of the loads' numbers, and a line with their masses.

    Attributes:
        dropdown: The list. It has numbers only: with a leaking mass in it, an option would change, and viser would
            select the first one instead.
    """

    def __init__(self, gui: viser.GuiApi) -> None:
        self.dropdown: viser.GuiDropdownHandle[str] = gui.add_dropdown("Loads", (_NO_LOAD,))
        self.masses = gui.add_html("")

    @property
    def number(self) -> int:
        """Number of the chosen load; raises ``CoheftError`` if none is chosen."""
        value = self.dropdown.value
        if not value.startswith("#"):
            raise CoheftError("there is no load" if value == _NO_LOAD else "choose a load first")
        return int(value[1:])

    def show(self, loads: Sequence[LoadState]) -> None:
        """Show the loads.

        If the chosen load is gone, the user has to choose again: if another one were selected, a late click would
        remove it.
        """
        names = tuple(f"#{load.id}" for load in loads)
        is_gone = self.dropdown.value not in (_NO_LOAD, *names)
        options = ((_CHOOSE, *names) if is_gone else names) if names else (_NO_LOAD,)
        if self.dropdown.options != options:
            self.dropdown.options = options
        self.masses.content = words.loads(loads)


def _edge(mass: float) -> float:
    """Return the edge of a cube with the density of water [m], so that heavy loads look larger."""
    return float(round((mass / 1000.0) ** (1.0 / 3.0), 3))
