"""Error messages of the command line: what was found, what was expected, what to do."""

import difflib
import re
import shutil
import sys
import textwrap

import cyclopts

from coheft.wire.scenario.expected import KINDS, expected_number

_KINDS = {int: KINDS["int"], float: KINDS["float"], bool: "nothing, or true or false"}


def explain_usage(error: cyclopts.CycloptsError) -> str:
    """Explain an error in the arguments, and name the command that shows help."""
    command = " ".join(["coheft", *(error.command_chain or ())])
    what = _what(error, command).rstrip(".")
    return f"{what}{'' if what.endswith('?') else '.'} See '{command} --help'"


def _what(error: cyclopts.CycloptsError, command: str) -> str:
    match error:
        case cyclopts.UnknownCommandError():
            return str(error).partition(" Available commands:")[0].replace('"', "'")
        case cyclopts.UnusedCliTokensError():
            return f"'{command}' does not know what to do with {' '.join(error.unused_tokens or [])!r}"
        case cyclopts.MissingArgumentError(argument=cyclopts.Argument() as argument):
            count, _ = argument.token_count()
            values = "a value" if count == 1 else f"{count} values"
            found = f"; found {len(error.tokens_so_far)}" if error.tokens_so_far else ""
            if argument.name in (error.unused_tokens or ()):
                return f"{_name(argument)} needs {values}{found}"
            words = [word.partition("=")[0] for word in error.unused_tokens or () if word.startswith("-")]
            misspelt = difflib.get_close_matches(argument.name, words, n=1)
            if misspelt:
                return f"Unknown option: {misspelt[0]}. Did you mean {argument.name}?"
            return f"'{command}' needs {_name(argument)}" + (f", with {values}" if count > 1 else "")
        case cyclopts.CoercionError(argument=cyclopts.Argument() as argument, token=token) if token is not None:
            expected = _KINDS.get(error.target_type) if isinstance(error.target_type, type) else None
            if expected is not None:
                return f"{_name(argument)}: expected {expected}; found {token.value!r}"
        case cyclopts.ValidationError(argument=cyclopts.Argument() as argument):
            return f"{_name(argument)}: {_complaint(error, argument)}"
    return str(error).replace('"', "'")


def _complaint(error: cyclopts.ValidationError, argument: cyclopts.Argument) -> str:
    """Return a validator's message, with those of numerical ranges rephrased."""
    match = re.fullmatch(r"Must be (<=?|>=?) (.*)\.", error.exception_message)
    if match is None:
        return error.exception_message
    found = argument.tokens[0].value
    return f"{expected_number(type(argument.value).__name__, match[1], match[2])}; found {found}"


def _name(argument: cyclopts.Argument) -> str:
    is_positional = argument.index is not None
    return argument.name.lstrip("-").upper() if is_positional else argument.name


def complain(text: str) -> None:
    """Print why a command failed: wrapped between words in a terminal, otherwise unchanged."""
    text = f"coheft: {text}"
    if sys.stderr.isatty():
        width = shutil.get_terminal_size().columns
        lines = [
            textwrap.fill(line, width, break_long_words=False, break_on_hyphens=False) for line in text.split("\n")
        ]
        text = "\n".join(lines)
    print(text, file=sys.stderr)
