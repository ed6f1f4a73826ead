"""Exceptions that end a command with one sentence and an exit code."""


class WrongInput(Exception):
    """The input of a command is invalid; the message states the reason."""


class OutputError(Exception):
    """The output folder cannot be used; the message states the reason."""


class Interrupted(Exception):
    """Ctrl-C in a command with its own message on the interruption."""


class Unsound(Exception):
    """The run ended, but its numbers are not valid."""
