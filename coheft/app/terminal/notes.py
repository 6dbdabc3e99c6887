"""Notes about contradictory settings, printed before a run."""

from rich.console import Console

from coheft.wire.scenario.notes import notes
from coheft.wire.scenario.schema import Scenario


def print_notes(console: Console, scenario: Scenario) -> None:
    """Print a line for each note on a scenario."""
    for note in notes(scenario):
        console.print(
            f"Note: {note}.", style="yellow", markup=False, highlight=False, soft_wrap=not console.is_terminal
        )
