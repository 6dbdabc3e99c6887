"""Writes docs/commands.md, the reference of all commands, from the command line itself.

To be run again after a change of a command; a test tells when that was forgotten.
"""

from __future__ import annotations

from pathlib import Path

from coheft.app.cli.base import EXIT_MEANINGS
from coheft.app.cli.main import app

PAGE = Path(__file__).with_name("commands.md")

_INTRODUCTION = """# Commands

`coheft --help` lists the commands, `coheft COMMAND --help` all options of one. This page is made from the same text, by
`python docs/command_reference.py`.

## Exit status

The same for all commands; but `coheft view` ends with 0 after Ctrl-C, which is how it is ended, and `coheft agent` with
2 if an estimator or a motion of your own fails:

| status | meaning |
|---|---|
{statuses}

## Output

- **Terminal.** A live display that fits 80 columns; errors are one sentence, without a traceback, on standard error.
- Windows of other sizes: tables that do not fit get a line for each value. In one of few lines `coheft run` shows the
  robots that are worst off, and how many more there are; in one that has no room for a row, a line about all.
- **No terminal** (a pipe, a file, a log): plain lines, without colours and without drawing anything twice.
- Standard output that is closed, or a full disk: a run goes on to its end and saves its files; then comes an error.
  If whoever reads has gone, as with `coheft run | head -1`, the same without a word; `coheft watch` ends then.
- Files: `coheft run` ends with a line for each that it has written.
- `NO_COLOR=1`: no colours.
- `--quiet`: nothing but errors. The exit status says how it went.
- `--json FILE`: the results for programs; with `--json -` standard output has the JSON and nothing else, and all that
  is for people goes to standard error:

  ```
  coheft run ring3 --json - 2> progress.txt | python -m json.tool
  ```

## Runs and their folders

Every run has a folder with the logs of its processes, and with the file by which other commands find it. It is below
`~/.local/state/coheft/runs` on Linux (or `$XDG_STATE_HOME`), `~/Library/Application Support/coheft/runs` on macOS; the
newest 20 are kept. `--logs DIR` puts it elsewhere. Commands on a run that goes on take your newest one, but
none that would change it if several go on: they list them, and `--run` says
which instead.

Robots are called `r1`, `r2`, … in the order of the scenario; in larger teams
`r01` or `r001`, so that their names are in order.

## Completion with the Tab key

For bash, zsh and fish. Once for good:

```
coheft completion --install
```

This puts a script where your shell looks for such scripts, and adds a line to its startup file. To try it in one
terminal only: `source <(coheft completion bash)`, or with fish `coheft completion fish | source`.
"""


def page() -> str:
    """The whole page, in Markdown."""
    statuses = "\n".join(f"| {status} | {meaning} |" for status, meaning in EXIT_MEANINGS.items())
    sections = sorted(app.generate_docs(usage_name="coheft").split("\n## coheft ")[1:])
    return _INTRODUCTION.format(statuses=statuses) + "".join(map(_section, sections))


def _section(text: str) -> str:
    name, _, rest = text.partition("\n")
    return f"\n## `coheft {name}`\n\n{rest.strip()}\n"


if __name__ == "__main__":
    PAGE.write_text(page())
