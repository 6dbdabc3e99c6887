"""Writes docs/commands.md, the reference of all commands, from the command line itself.

To be run again after a change of a command; a test tells when that was forgotten.
"""

from __future__ import annotations

from pathlib import Path

from coheft.app.cli.base import EXIT_MEANINGS
from coheft.app.cli.main import app

PAGE = Path(__file__).with_name("commands.md")

_INTRODUCTION = """# Commands

`coheft --help` lists the commands, `coheft COMMAND --help` all options of one. This page is generated from the same
text by `python docs/command_reference.py`.

## Exit status

It is the same for all commands, with two exceptions: `coheft view` ends with 0 after Ctrl-C, and `coheft agent` with 2
if an estimator or a motion of your own fails.

| status | meaning |
|---|---|
{statuses}

## Output

- **Terminal.** The live display needs 80 columns. Errors are one sentence on standard error, without a traceback.
- **Small windows.** Tables that do not fit get one line per value. With few lines, `coheft run` shows the robots with
  the largest problems and the number of the others; with even fewer, one line about all.
- **No terminal** (a pipe, a file, a log): plain lines, without colours.
- **Closed standard output or a full disk**: a run continues to its end, saves its files, and then reports an error.
  If the reader of a pipe has ended, as in `coheft run | head -1`, there is no error; `coheft watch` ends then.
- **Files.** `coheft run` ends with one line for each file that it has written.
- `NO_COLOR=1`: no colours.
- `--quiet`: only errors; use the exit status.
- `--json FILE`: the results for programs. With `--json -`, standard output has only the JSON, and everything else goes
  to standard error:

  ```
  coheft run ring3 --json - 2> progress.txt | python -m json.tool
  ```

## Runs and their folders

Every run has a folder with the logs of its processes, and with the file by which other commands find it. It is below
`~/.local/state/coheft/runs` on Linux (or `$XDG_STATE_HOME`), `~/Library/Application Support/coheft/runs` on macOS; the
newest 20 are kept. `--logs DIR` chooses another folder. Commands for a run in progress use your newest one. If there
are several, commands that would change one list them, and need `--run`.

Robots are called `r1`, `r2`, … in the order of the scenario; in larger teams `r01` or `r001`, so that their names sort
in order.

## Completion with the Tab key

For bash, zsh and fish, to install it permanently:

```
coheft completion --install
```

This writes a script to the place where your shell looks for it, and adds a line to its startup file. For one terminal
only: `source <(coheft completion bash)`, or with fish `coheft completion fish | source`.
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
