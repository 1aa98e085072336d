"""What ends a command early: wrong use, or data that cannot be used."""


class UsageError(Exception):
    """The command was called wrongly; exit code 2."""

    exit_code = 2


class DataError(Exception):
    """The data or a file cannot be used; exit code 1."""

    exit_code = 1
