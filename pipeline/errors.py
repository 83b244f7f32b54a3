"""Errors with messages for users: theirs to correct, or failures of the machine."""

LONGEST_SHOWN = 200  # characters of a value in a message


class UserError(Exception):
    """An error that the user can correct.

    The text is one or two sentences: what, which value, what was expected, what to do next. The command
    line prints it without a traceback and ends with exit code 2.
    """


class MachineError(Exception):
    """A failure of the machine, such as too little memory: told like a `UserError`, with exit code 1."""


def shown(value: object) -> str:
    """Format a value for a message: its beginning, if it is long."""
    return shortened(repr(value))


def shortened(text: str) -> str:
    """Cut a text that is too long for a sentence."""
    return text if len(text) <= LONGEST_SHOWN else f"{text[:LONGEST_SHOWN]}…"
