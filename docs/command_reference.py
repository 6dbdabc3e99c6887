"""Writes the reference of all commands in docs/commands.md, from the command line itself.

Run it after a change of a command; a test fails otherwise.
"""

from pathlib import Path

from coheft.app.cli.base import EXIT_MEANINGS
from coheft.app.cli.main import app

PAGE = Path(__file__).with_name("commands.md")

_MARK = "<!-- All that follows is written by docs/command_reference.py -->\n"
_STATUSES = """
## Exit status

It is the same for all commands, with two exceptions: `coheft view` ends with 0 after Ctrl-C, and `coheft agent` with 2
if an estimator or a motion of your own fails.

| status | meaning |
|---|---|
"""


def page() -> str:
    """Return the page in Markdown: the part by hand up to the mark, and then the reference."""
    by_hand, mark, _ = PAGE.read_text().partition(_MARK)
    statuses = "".join(f"| {status} | {meaning} |\n" for status, meaning in EXIT_MEANINGS.items())
    sections = sorted(app.generate_docs(usage_name="coheft").split("\n## coheft ")[1:])
    return "".join([by_hand, mark, _STATUSES, statuses, *map(_section, sections)])


def _section(text: str) -> str:
    name, _, rest = text.partition("\n")
    return f"\n## `coheft {name}`\n\n{rest.strip()}\n"


if __name__ == "__main__":
    PAGE.write_text(page())
