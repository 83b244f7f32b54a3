"""The errors that people are meant to read."""


class UserError(Exception):
    """Something the user can put right.

    The text is one or two sentences: what, which value, what was expected, what to do next. The command
    line prints it without a traceback and ends with exit code 2.
    """
