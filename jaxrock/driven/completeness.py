"""The requirement that all integrations of a batch have finished."""

from collections.abc import Sequence

import numpy as np

from ..validation import AnyArray

# The names or the values along an axis of a batch. None numbers its elements from 1 on. A text
# describes all elements at once, and stands for no axis.
Labels = Sequence[str] | Sequence[float] | np.ndarray | str | None


def require_complete(complete: AnyArray | np.bool_, **labels: Labels) -> None:
    """Check that the integrations of a batch have finished.

    Parameters
    ----------
    complete : array_like of bool, shape (...)
        Whether each integration has finished.
    **labels : sequence of str or of float, str, or None
        For each axis of `complete`, in order, what an element along it is called, with the
        names or the values along it; None numbers them from 1 on. A text belongs to no axis:
        it says what all integrations have in common.

    Raises
    ------
    ValueError
        If an integration has not finished. The message names the first one by its labels.

    Examples
    --------
    >>> complete = np.array([[True, True], [True, False]])
    >>> require_complete(complete, record=["cape mendocino", "napa north"], level=[0.4, 0.8])
    Traceback (most recent call last):
    ValueError: integration did not finish for record 'napa north', level 0.8
    """
    failed = ~np.asarray(complete)
    if not failed.any():
        return
    first = iter(np.argwhere(failed)[0])
    subjects = []
    for noun, along in labels.items():
        label = along
        if not isinstance(along, str):
            index = int(next(first))
            label = index + 1 if along is None else along[index]
            label = f"'{label}'" if isinstance(label, str) else f"{float(label):.6g}"
        subjects.append(f"{noun.replace('_', ' ')} {label}")
    remaining = int(failed.sum()) - 1
    more = f" (and {remaining:,} other{'s' if remaining > 1 else ''})" if remaining else ""
    raise ValueError(f"integration did not finish for {', '.join(subjects)}{more}")
