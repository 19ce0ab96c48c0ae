"""The status of a result: how the computation of it ended."""

import enum

import jax
import numpy as np

from ..validation import is_traced


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

    COMPLETE = 0  # nothing ran out
    LIST_FULL = 1  # all is right, but not all impacts are listed
    STOPPED = 2  # the integrator ran out of steps or impacts, or could not go on: NaN
    INVALID = 3  # an argument was out of its range: NaN
    # All is right, but for a time the block was in unstable balance, in which none stays.
    BALANCED = 4
    NOT_CONVERGED = 5  # a search ended without an answer: numbers are where it ended
    NOT_VALIDATED = 6  # a search has converged, but a check contradicts its answer

    @property
    def description(self) -> str:
        """The meaning of the status in words."""
        return _DESCRIPTIONS[self]


_DESCRIPTIONS = {
    Status.COMPLETE: "complete",
    Status.LIST_FULL: "complete, but not all impacts are listed",
    Status.STOPPED: "ran out of steps, or could not go on",
    Status.INVALID: "an argument is out of range",
    Status.BALANCED: "complete; the block was in unstable balance for a time",
    Status.NOT_CONVERGED: "the search has not converged",
    Status.NOT_VALIDATED: "a check contradicts the answer of the search",
}


def describe_status(status: int | np.ndarray | jax.Array) -> str:
    """Describe a status in words, or how often each one occurs in an array.

    Parameters
    ----------
    status : array_like of int, shape (...)

    Returns
    -------
    str
        Empty where all are COMPLETE.
    """
    if is_traced(status):
        return f"traced {jax.typeof(status)}"
    values = np.asarray(status)
    members = [Status(int(value)) for value in np.unique(values) if value != Status.COMPLETE]
    if not values.ndim:
        return "".join(member.description for member in members)
    return ", ".join(
        f"{member.description}: {(values == member).sum():,} of {values.size:,}"
        for member in members
    )
