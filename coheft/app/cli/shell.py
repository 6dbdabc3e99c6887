"""Commands about the command line itself."""

from pathlib import Path
from typing import Literal

from coheft.app.cli import options
from coheft.app.cli.base import SHELL, app
from coheft.errors import UsageError

Shell = Literal["bash", "zsh", "fish"]


@app.command(name="help", group=SHELL)
def help_(*command: str) -> None:
    """Show what a command does and its options; without a name, list all commands.

    Args:
        command: Name of the command, for instance run, or cart identify.
    """
    _, _, unknown = app.parse_commands(command)
    if unknown:
        raise UsageError(f"there is no command {' '.join(command)!r}; 'coheft help' lists all")
    app.help_print(command)


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
