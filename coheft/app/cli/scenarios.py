"""Commands about scenarios."""

import re
import textwrap

from coheft.app.cli.base import RUN, SHELL, app

_WIDTH = 80
"""Width of the output in columns."""


@app.command(group=RUN)
def scenarios() -> None:
    """List the shipped scenarios."""
    from coheft.wire.scenario.file import available_scenarios, load_scenario

    shipped = available_scenarios()
    column = max(map(len, shipped)) + 2
    for name in sorted(shipped, key=_by_number):
        text = f"{name:{column}}{load_scenario(shipped[name]).description}"
        print(textwrap.fill(text, _WIDTH, subsequent_indent=" " * column))


def _by_number(name: str) -> list[tuple[int, str]]:
    """Return a key that sorts ring3 before ring12."""
    return [(int(part), "") if part.isdigit() else (0, part) for part in re.split(r"(\d+)", name)]


@app.command(group=SHELL)
def schema() -> None:
    """Print the JSON schema of scenarios, with which editors complete, explain and check keys.

    docs/own.md shows how to set up an editor.
    """
    import json

    from coheft.wire.scenario.json_schema import scenario_schema

    print(json.dumps(scenario_schema(), indent=2, ensure_ascii=False))
