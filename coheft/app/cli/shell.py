"""Commands about the command line itself."""

from pathlib import Path
from typing import Annotated, Literal

from cyclopts import Parameter

from coheft.app.cli import options
from coheft.app.cli.base import SHELL, app
from coheft.errors import UsageError

Shell = Literal["bash", "zsh", "fish"]


@app.command(name="help", group=SHELL)
def help_(command: Annotated[str | None, Parameter(show_default=False)] = None) -> None:
    """Show what a command does and its options; without a name, list all commands.

    Args:
        command: Name of the command.
    """
    if command is not None and command not in list(app):
        raise UsageError(f"there is no command {command!r}; 'coheft help' lists all")
    app.help_print([command] if command else [])


@app.command(group=SHELL)
def completion(shell: Shell | None = None, *, install: options.Flag = False) -> None:
    """Print a script that lets the Tab key complete commands and options: source <(coheft completion bash).

    Args:
        shell: bash, zsh or fish; without it, the one that is running.
        install: Instead of printing the script, install it where the shell looks for such scripts, and load it from the
            shell's startup file.
    """
    if install:
        path: Path = app.install_completion(shell=shell)
        print(f"installed {path}; it works in new terminals")
    else:
        print(app.generate_completion(prog_name="coheft", shell=shell))
