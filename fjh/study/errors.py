"""What ends a command: each kind has one sentence and an exit code."""


class WrongInput(Exception):
    """The command cannot do what it is asked to; the message says why."""


class OutputError(Exception):
    """The output folder cannot be used; the message says why."""


class Interrupted(Exception):
    """Ctrl-C, by a command that has more to say of it than all others."""


class Unsound(Exception):
    """The run ended, but its numbers cannot be trusted."""
