"""Errors with messages for users."""


class UserError(Exception):
    """An error that the user can correct.

    The text is one or two sentences: what, which value, what was expected, what to do next. The command
    line prints it without a traceback and ends with exit code 2.
    """
