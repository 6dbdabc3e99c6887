"""Results of ``coheft cart`` in the terminal."""

from __future__ import annotations

from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.table import Table

from coheft.app.cart.table import CLAIMS, HEADER, CartStudy, rows, sentences
from coheft.app.terminal.wide_table import print_table


def print_study(console: Console, study: CartStudy) -> None:
    """Print a table with the worst run of each test, beside the paper's claims."""
    title = "Largest errors in all runs of a test: of pushers who learn, and of others who believe their first guess"
    table = Table(box=SIMPLE_HEAD, title=title, title_justify="left")
    for index, name in enumerate(HEADER):
        table.add_column(name, justify="left" if index == 0 else "right")
    table.add_row(*CLAIMS, style="dim", end_section=True)
    for row in rows(study.reports):
        table.add_row(*row)
    print_table(console, table)
    for sentence in sentences(study.reports):
        console.print(sentence, highlight=False)
    for text in study.missed:
        console.print(f"Worse than it should be: {text}", style="red", highlight=False)
