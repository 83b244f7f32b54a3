"""Errors with messages for users: theirs to correct, or failures of the machine."""


class UserError(Exception):
    """An error that the user can correct.

    The text is one or two sentences: what, which value, what was expected, what to do next. The command
    line prints it without a traceback and ends with exit code 2.
    """


class MachineError(Exception):
    """A failure of the machine, such as too little memory: told like a `UserError`, with exit code 1."""
