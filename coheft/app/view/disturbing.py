"""Controls that disturb links and clocks, and restore them."""

from collections.abc import Callable
from typing import Any

import viser

from coheft.app.run.folder import RunFile
from coheft.app.run.observer import ask_server, disturb_links
from coheft.app.view import words
from coheft.app.view.model import ViewModel
from coheft.wire.messages.requests import ClockRequest
from coheft.wire.scenario.network import LinkQuality

_LATEST = 1000  # [ms]


class Disturbing:
    """A list of links and robots, how they are to be disturbed, and what is disturbed now.

    Attributes:
        clock: Slider of how far a robot's clock is ahead [ms].
        where: The list. For a robot, all of its links are disturbed, and its clock.
    """

    def __init__(self, gui: viser.GuiApi, model: ViewModel, run_file: RunFile, act: Callable[..., None]) -> None:
        self._model, self._run_file = model, run_file
        self._edges = {"-".join(edge): edge for edge in model.edges}
        self.where = gui.add_dropdown("Link or robot", (*self._edges, *model.scene.robots))
        self._loss = gui.add_slider("Loss, %", 0, 100, 1, 0)
        self._delay = gui.add_slider("Delay, ms", 0, _LATEST, 10, 0)
        self._jitter = gui.add_slider("Jitter, ms", 0, _LATEST, 10, 0, hint="Largest additional delay")
        self.clock = gui.add_slider("Clock, ms", 0.0, 20.0, 0.1, 0.0, hint="How far the robot's clock is ahead")
        disturb = gui.add_button("Disturb", icon=viser.Icon.WAVE_SAW_TOOL, color="yellow")
        restore = gui.add_button("Restore", icon=viser.Icon.WAVE_SINE)
        self._state = gui.add_html("")
        self.buttons = [disturb, restore]
        self._allow_clock()

        self.where.on_update(lambda _: self._allow_clock())
        restore.on_click(lambda event: act(event, self.set, LinkQuality(), 0.0))

        @disturb.on_click
        def _(event: Any) -> None:
            quality = LinkQuality(1e-2 * self._loss.value, 1e-3 * self._delay.value, 1e-3 * self._jitter.value)
            act(event, self.set, quality, self.clock.value)

    def update(self) -> None:
        """Show what is disturbed."""
        self._state.content = words.disturbances(self._model)

    def set(self, quality: LinkQuality, clock: float) -> str:
        """Set the chosen link, or the links and the clock [ms] of the chosen robot; return what was done."""
        where, scene = self.where.value, self._model.scene
        edge = self._edges.get(where)
        if edge is not None:
            disturb_links(self._run_file, scene, *edge, quality)
        else:
            disturb_links(self._run_file, scene, where, None, quality)
            ask_server(self._run_file, ClockRequest(robot=where, ahead=1e-3 * clock))
        is_right = quality.is_ideal and not (clock and edge is None)
        return f"{'restored' if is_right else 'disturbed'} {'the link ' if edge is not None else ''}{where}"

    def _allow_clock(self) -> None:
        self.clock.disabled = self.where.value in self._edges
