"""The page in the browser: scene, numbers and plots of a view model."""

import time

import viser

from coheft.app.view import words
from coheft.app.view.model import ViewModel
from coheft.app.view.plots import Plots
from coheft.app.view.stage import Stage
from coheft.wire.scenario.plugins import estimator_names

FRAME = 0.05
"""Shortest time between two drawings [s]."""
_TEXT_EVERY = 0.2
_PLOT_EVERY = 0.25
_LAST = 1e9  # order of the last element


class Page:
    """The whole page; ``draw`` updates it."""

    def __init__(self, server: viser.ViserServer, model: ViewModel) -> None:
        server.gui.configure_theme(dark_mode=True, control_width="large", show_logo=False, show_share_button=False)
        server.gui.main_panel.dock_right()
        server.gui.set_panel_label("coheft")
        self.server = server
        self.stage = Stage(server, model)
        gui = server.gui
        self._header = gui.add_html(words.header(model))
        self._choice = gui.add_dropdown("Robot", model.scene.robots, hint="The robot whose estimate is shown")
        self._belief = gui.add_html(words.belief(None))
        self._plots = Plots(server, estimator_names(model.status.estimator))
        self._texts_at = self._plots_at = 0.0
        self._drawn: object = None
        self._plotted: object = None
        side = gui.add_panel()
        side.dock_left()
        side.set_width(290)
        self.controls = side.add_tab("Controls")
        with self.controls:
            self._legend = gui.add_html(words.legend(self.stage.doubt_scale), order=_LAST)
        with side.add_tab("Team"):
            self._team = gui.add_html("")
            self._disturbances = gui.add_html("")
            self._problems = gui.add_html("")
            doubt = gui.add_dropdown("Ellipsoid", ("1 ×", "10 ×", "100 ×"), initial_value="10 ×")

        @doubt.on_update
        def _(_: object) -> None:
            self.stage.doubt_scale = float(doubt.value.split()[0])
            self._legend.content = words.legend(self.stage.doubt_scale)

    @property
    def chosen(self) -> str:
        """The robot whose estimate is shown."""
        return str(self._choice.value)

    def draw(self, model: ViewModel, note: str = "") -> None:
        """Show the present state: the scene each time, texts and plots less often."""
        if not self.server.get_clients():
            return
        now = time.monotonic()
        with self.server.atomic():
            picture = model, model.changes, self.chosen, self.stage.doubt_scale
            if picture != self._drawn:
                self._drawn = picture
                self.stage.draw(model, self.chosen)
            if now > self._texts_at + _TEXT_EVERY:
                self._texts_at = now
                self._draw_texts(model, note)
            if now > self._plots_at + _PLOT_EVERY:
                self._plots_at = now
                if picture != self._plotted:
                    self._plotted = picture
                    self._plots.draw(model.traces[self.chosen], model.record.time)

    def _draw_texts(self, model: ViewModel, note: str) -> None:
        for handle, text in (
            (self._header, words.header(model, note)),
            (self._belief, words.beliefs(model, self.chosen)),
            (self._team, words.team(model, self.chosen)),
            (self._disturbances, words.disturbances(model)),
            (self._problems, words.problems(model)),
        ):
            handle.content = text
