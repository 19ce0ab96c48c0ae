"""The status of a result: how the computation of it ended."""

import enum


class Status(enum.IntEnum):
    """The end of a computation, and the reason if there is no result.

    Results are valid where the status is COMPLETE, LIST_FULL or BALANCED. `description`
    explains the status in words.

    Examples
    --------
    >>> import jaxrock as jr
    >>> print(jr.Status(2).name, "-", jr.Status(2).description)
    STOPPED - ran out of steps, or could not go on
    """

    COMPLETE = 0, "complete"
    LIST_FULL = 1, "complete, but not all impacts are listed"
    STOPPED = 2, "ran out of steps, or could not go on"  # numbers are NaN
    INVALID = 3, "an argument is out of range"  # numbers are NaN
    # A state in which no block stays.
    BALANCED = 4, "complete; the block was in unstable balance for a time"
    NOT_CONVERGED = 5, "the search has not converged"  # numbers are where it ended
    NOT_VALIDATED = 6, "a check contradicts the answer of the search"

    description: str

    def __new__(cls, value: int, description: str) -> "Status":
        """Make a member of its number and its meaning in words."""
        member = int.__new__(cls, value)
        member._value_ = value
        member.description = description
        return member
