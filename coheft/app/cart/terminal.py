"""Results of ``coheft cart`` in the terminal."""

from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.table import Table

from coheft.app.cart.identify import CartIdentification
from coheft.app.cart.table import CLAIMS, HEADER, CartStudy, rows, sentences
from coheft.app.terminal.digits import error_and_std
from coheft.app.terminal.wide_table import print_table

_SHOWN = 8
"""Largest number of changes that are listed."""


def print_study(console: Console, study: CartStudy) -> None:
    """Print a table with the worst run of each test, below the paper's claims."""
    title = "Largest errors in all runs of a test, with the estimator, and without it"
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
        console.print(f"Worse than expected: {text}", style="red", highlight=False)


def print_identification(console: Console, found: CartIdentification) -> None:
    """Print the identification of a cart."""
    table = Table(box=SIMPLE_HEAD, title=f"The cart after {found.duration_s:g} s", title_justify="left")
    for name in ("quantity", "value", "standard deviation"):
        table.add_column(name, justify="left" if name == "quantity" else "right")
    for name, quantity in found.quantities.items():
        if quantity.not_known:
            table.add_row(name, "not known", "")
        else:
            table.add_row(name, *error_and_std(quantity.value, quantity.std, quantity.unit))
    print_table(console, table)
    for advice in dict.fromkeys(quantity.not_known for quantity in found.quantities.values() if quantity.not_known):
        console.print(f"{advice}.", highlight=False)
    if found.changes_s:
        times = ", ".join(f"{time:.2f}" for time in found.changes_s[:_SHOWN])
        more = len(found.changes_s) - _SHOWN
        times += f" and {more} times more" if more > 0 else " s"
        console.print(f"The cart changed at about {times}; the values are those at the end.", highlight=False)
    for doubt in found.doubts:
        console.print(f"Does not fit: {doubt}", style="red", highlight=False)
