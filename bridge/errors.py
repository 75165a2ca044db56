"""The one exception that a user of this project ever has to read."""

from __future__ import annotations


def printable(text: str) -> str:
    """Text whose control characters are escaped: a file's names may not steer a terminal."""
    return "".join(c if c.isprintable() else ascii(c)[1:-1] for c in text)


class DsnetError(Exception):
    """A mistake that a user can mend.

    The message is one line and says three things: what was received, what was
    expected, and how to mend it. The `dsnet` command prints it without a
    traceback and exits with status 2.
    """

    def __init__(self, received: str, expected: str, remedy: str) -> None:
        self.received, self.expected, self.remedy = received, expected, remedy
        super().__init__(printable(" ".join(f"{received}; expected {expected}. {remedy}".split())))

    def __reduce__(self) -> tuple[type[DsnetError], tuple[str, str, str]]:
        """As its parts, so that it also comes back from a worker process."""
        return type(self), (self.received, self.expected, self.remedy)


class InterruptedWorkError(DsnetError):
    """Work was stopped by something other than its inputs: what was done stays, to be resumed."""
