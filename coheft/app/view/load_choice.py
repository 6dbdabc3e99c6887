"""The list of loads to choose from."""

from collections.abc import Sequence

import viser

from coheft.app.view import words
from coheft.errors import CoheftError
from coheft.wire.messages.truth import LoadState

_NO_LOAD = "nothing on it"
_CHOOSE = "choose one"


class LoadChoice:
    """A list of the loads' numbers, and a line with their masses.

    Attributes:
        dropdown: The list. It has numbers only: with a leaking mass in it, an option would change, and viser would
            select the first one instead.
        masses: The line with the masses.
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
