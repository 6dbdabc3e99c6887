"""The command for editors."""

from __future__ import annotations

from coheft.app.cli.base import SHELL, app


@app.command(group=SHELL)
def schema() -> None:
    """Print the JSON schema of scenarios, with which editors complete, explain and check keys.

    docs/own.md shows how to set up an editor.
    """
    import json

    from coheft.wire.scenario.json_schema import scenario_schema

    print(json.dumps(scenario_schema(), indent=2, ensure_ascii=False))
