"""Defines the exceptions of the package."""

from __future__ import annotations


class Error(Exception):
    """Is the base of all exceptions of this package."""


class ConfigError(Error, ValueError):
    """Refuses a configuration that no machine or operator can have."""


class TimeError(Error, ValueError, OverflowError):
    """Refuses an instant, a duration or another number that is out of its range."""


class DeadlineError(Error, ValueError):
    """Refuses a figure with which no deadline policy can be made."""


class ReadError(Error, ValueError):
    """Reports the first thing that is wrong with a trace, and where it is.

    >>> import fuseline
    >>> try:
    ...     fuseline.check(b"{}")
    ... except fuseline.ReadError as error:
    ...     print(error.line, error.column, error)
    1 3 <bytes>:1:3: the last line does not end in LF; it may be cut short
    """

    def __init__(self, file: str, line: int, column: int, defect: str) -> None:
        super().__init__(file, line, column, defect)
        #: The name that the trace was given.
        self.file = file
        #: The line, counted from 1.
        self.line = line
        #: The byte of the line, counted from 1.
        self.column = column
        #: The error, in a few words.
        self.defect = defect

    def __str__(self) -> str:
        return f"{self.file}:{self.line}:{self.column}: {self.defect}"


class Full(Error):
    """Refuses a message because the reader of the items lags too far behind."""


class Closed(Error):
    """Refuses a message because the operator or the input accepts no more."""


class TraceError(Error, OSError):
    """Reports a recording that ended early; the trace is whole up to there."""


class CallError(Error):
    """Describes in a few plain words why a call to a cloud failed."""


#: The greatest number of characters of an exception's text that are read.
_SHORT_LEN = 2000


def in_one_line(error: BaseException) -> str:
    """Returns an exception's text as one line of valid text, or its type if the text is empty.

    An exception whose text cannot be read is a failure like any other (D7), so this does not raise.
    """
    kind = type(error).__name__
    try:
        said = " ".join(str(error)[:_SHORT_LEN].split())
    except Exception as raised:
        return f"{kind}, whose text cannot be read ({type(raised).__name__})"
    return as_text(said) or kind


def as_text(said: str) -> str:
    """Escapes characters that cannot be encoded, such as half of a surrogate pair."""
    return said.encode("utf-8", "backslashreplace").decode()
