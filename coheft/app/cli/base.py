"""Shared parts of all commands: the application, its groups of commands, exit statuses."""

import cyclopts

import coheft

EXIT_CONVERGED = 0
EXIT_ERROR = 1
EXIT_USAGE = 2
EXIT_NOT_CONVERGED = 3
EXIT_BROKEN_PROMISE = 4
EXIT_INTERRUPTED = 130

EXIT_MEANINGS = {
    EXIT_CONVERGED: "every robot converged (or: done)",
    EXIT_ERROR: "an error",
    EXIT_USAGE: "wrong usage or a bad scenario",
    EXIT_NOT_CONVERGED: "not every robot converged, or an estimate is further off than it claims (or: incomplete or "
    "doubtful results)",
    EXIT_BROKEN_PROMISE: "a promise was broken (coheft faults)",
    EXIT_INTERRUPTED: "stopped by Ctrl-C",
}

RUN = cyclopts.Group.create_ordered("Run")
CONTROL = cyclopts.Group.create_ordered("Control a run in progress")
EVALUATE = cyclopts.Group.create_ordered("Evaluate")
PARTS = cyclopts.Group.create_ordered("Start parts by hand, on one or several hosts")
SHELL = cyclopts.Group.create_ordered("The command line itself")

app = cyclopts.App(
    name="coheft",
    help="Identify a load that several robots hold: in a simulation, from recordings, or with real robots.",
    help_epilogue=f"Exit status: {', '.join(f'{status} {meaning}' for status, meaning in EXIT_MEANINGS.items())}.",
    version=coheft.__version__,
    group_commands=SHELL,
    suppress_keyboard_interrupt=False,  # ``run_command_line`` handles Ctrl-C
)
