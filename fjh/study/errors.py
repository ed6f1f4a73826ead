"""Exceptions that end a command with one sentence and an exit code."""


class WrongInput(Exception):
    """Error that an input of a command is invalid; the message states the reason."""


class OutputError(Exception):
    """Error that an output folder or file cannot be written; the message states the reason."""


class Interrupted(Exception):
    """Interruption by Ctrl-C of a command that has its own message."""


class Unsound(Exception):
    """Error that a command has no valid numbers: a check failed, or a simulation diverged."""
