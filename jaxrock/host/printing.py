"""Printing of arguments and results: numbers with units, arrays as ranges."""

import importlib
from collections.abc import Iterable, Sequence
from typing import Any, ClassVar

import jax
import numpy as np

from ..validation import Checked, is_traced, iterate_quantities
from .status import Status


def format_number(value: object, unit: str = "") -> str:
    """Write a number with its unit; the range of an array, the type of a traced value."""
    if is_traced(value):
        return f"traced {jax.typeof(value)}"
    if not isinstance(value, jax.Array | np.ndarray | np.generic | float | int):
        return str(value)
    values = np.asarray(value)
    if values.dtype == bool:
        return f"{values.sum()} of {values.size}" if values.ndim else "yes" if values else "no"
    unit = f" {unit}" if unit else ""
    # NaN stands for blocks that overturn, and must not become the range of the others.
    present = values[~np.isnan(values)] if values.ndim else values
    if not present.size:
        return f"none of {values.size}"
    # A dictionary, so that ends that print alike are written once.
    ends = dict.fromkeys(f"{end:.6g}" for end in (present.min(), present.max()))
    missing = values.size - present.size
    return " to ".join(ends) + unit + f", NaN in {missing} of {values.size}" * bool(missing)


class Printed:
    """A base of classes whose `repr` says what `print` says.

    Equinox would show the shapes of arrays instead of their numbers.
    """

    def __repr__(self) -> str:
        return str(self)


class Shown(Printed):
    """A base of results that have a picture, by the name of its function in `jaxrock.plot`."""

    picture: ClassVar[str]

    def plot(self, ax: Any = None) -> Any:
        """Draw the result.

        Parameters
        ----------
        ax : matplotlib.axes.Axes, optional
            Axes to draw on; new ones by default.

        Returns
        -------
        matplotlib.axes.Axes
            The axes drawn on.
        """
        # Imported here, since Matplotlib takes half a second, and pictures know all results.
        return getattr(importlib.import_module("jaxrock.plot"), self.picture)(self, ax)


def format_outside(module: Checked) -> str:
    """Write a module some of whose numbers are outside of their domains; nothing for others.

    `jax.grad` returns derivatives with respect to a block in a `Block`, and tree operations of
    JAX make blocks that nobody has checked. Only the numbers tell them from a block: some are
    no quantity. They are written without units, which derivatives do not share.
    """
    try:
        module.check()
    except (ValueError, TypeError):  # of numbers, and of what some transformations put there
        numbers = (part[:2] for part in iterate_quantities(module) if part[1] is not None)
        texts = (f"{name.replace('_', ' ')} {format_number(value)}" for name, value in numbers)
        return "\n".join(["derivatives, or numbers out of range:", *texts])
    return ""


def format_table(first: str, names: Sequence[str], **columns: Iterable[object]) -> str:
    """Write a table: the first line, then one for each name, a column for each keyword."""
    width = max(20, 2 + max(map(len, ("", *names))))
    aligned = [[f"{name:{width}}" for name in ("", *names)]]
    for label, values in columns.items():
        numbers = (value if isinstance(value, str) else f"{value:.6g}" for value in values)
        cells = [label.replace("_", " "), *numbers]
        width = max(14, 1 + max(map(len, cells)))
        aligned.append([f"{cell:>{width}}" for cell in cells])
    return "\n".join([first, *map("".join, zip(*aligned, strict=True))])


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
        return format_number(status)
    counts = {s.description: status == s for s in Status if s and np.any(status == s)}
    if not np.ndim(status):
        return "".join(counts)
    return ", ".join(f"{text}: {format_number(count)}" for text, count in counts.items())


def format_fields(result: object, **units: str) -> str:
    """Write the named fields of a result with their units, one per line.

    A line about its status follows, where it has one that is not COMPLETE.
    """
    texts = {name: format_number(getattr(result, name), unit) for name, unit in units.items()}
    texts["status"] = describe_status(getattr(result, "status", Status.COMPLETE))
    lines = (f"{name.replace('_', ' '):19} {text}" for name, text in texts.items() if text)
    return "\n".join(lines)
