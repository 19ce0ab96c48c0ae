"""Printing of arguments and results: numbers with units, arrays as ranges."""

import importlib
from collections.abc import Iterable, Sequence
from typing import Any, ClassVar

import jax
import numpy as np

from ..validation import FINITE, Checked, Domain, is_traced, iterate_quantities
from .status import Status, describe_status


def format_number(value: object, unit: str = "") -> str:
    """Write a number with its unit; the range of an array, the type of a traced value."""
    if is_traced(value):
        return f"traced {jax.typeof(value)}"
    if isinstance(value, dict):
        return ", ".join(f"{name} {format_number(part)}" for name, part in value.items())
    if not isinstance(value, jax.Array | np.ndarray | np.generic | float | int):
        return str(value)

    values = np.asarray(value)
    if values.dtype == bool:
        return f"{values.sum()} of {values.size}" if values.ndim else "yes" if values else "no"
    unit = f" {unit}" if unit else ""
    if not values.ndim:
        return f"{values:.6g}{unit}"
    # NaN stands for blocks that overturn, and must not become the range of the others.
    present = values[~np.isnan(values)]
    if not present.size:
        return f"none of {values.size}"
    # A dictionary, so that ends that print alike are written once.
    ends = dict.fromkeys(f"{end:.6g}" for end in (present.min(), present.max()))
    missing = values.size - present.size
    return (
        " to ".join(ends) + unit + (f", NaN in {missing} of {values.size}" if missing else "")
    )


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
        pictures = importlib.import_module("jaxrock.plot")
        return getattr(pictures, self.picture)(self, ax)


def format_outside(module: Checked) -> str:
    """Write a module some of whose numbers are outside of their domains; nothing for others.

    `jax.grad` returns derivatives with respect to a block in a `Block`, and tree operations of
    JAX make blocks that nobody has checked. Only the numbers tell one from the other:
    derivatives have any sign and size, so that many of them cannot be a quantity, while a
    mistake is in one number. So they are written as derivatives if a third of the numbers that
    have bounds are outside; if fewer are, these are named.
    """
    numbers = [part for part in iterate_quantities(module) if part[1] is not None]
    outside = [part for part in numbers if _is_outside(*part[1:3])]
    bounded = [part for part in numbers if part[2] is not FINITE]
    if 3 * len(outside) < len(bounded):
        texts = [f"{name} {format_number(value, unit)}" for name, value, _, unit in outside]
        return f"outside of its domain: {', '.join(texts)}" if texts else ""
    lines = []
    for name, value, _, unit in numbers:
        per = f"1/({unit})" if "/" in unit else f"1/{unit}" if unit else ""
        words = name.replace("half_", "half-").replace("_", " ")
        lines.append(f"d/d {words} {format_number(value, per)}")
    return "\n".join(lines)


def _is_outside(value: object, domain: Domain) -> bool:
    """Return whether a concrete number other than NaN is outside of its domain."""
    # Some transformations put other objects in the place of arrays.
    if is_traced(value) or not isinstance(value, jax.Array | np.ndarray | float):
        return False
    inside = domain.contains(np.asarray(value)) | np.isnan(value)
    return not np.all(inside)


def format_table(first: str, names: Sequence[str], **columns: Iterable[object]) -> str:
    """Write a table: the first line, then one for each name, a column for each keyword."""
    heads = ["", *(label.replace("_", " ") for label in columns)]
    body = ([v if isinstance(v, str) else f"{v:.6g}" for v in c] for c in columns.values())
    rows = [heads, *zip(names, *body, strict=True)]
    least = [(20, 2), *[(14, 1)] * len(columns)]
    widths = [
        max(width, *(len(row[k]) + gap for row in rows))
        for k, (width, gap) in enumerate(least)
    ]
    lines = [first]
    for name, *cells in rows:
        line = (f"{cell:>{width}}" for cell, width in zip(cells, widths[1:], strict=True))
        lines.append(f"{name:{widths[0]}}{''.join(line)}")
    return "\n".join(lines)


def format_fields(result: object, **units: str) -> str:
    """Write the named fields of a result with their units, one per line.

    A line about its status follows, where it has one that is not COMPLETE.
    """
    texts = {name: format_number(getattr(result, name), unit) for name, unit in units.items()}
    status = describe_status(getattr(result, "status", Status.COMPLETE))
    if status:
        texts["status"] = status
    return "\n".join(f"{name.replace('_', ' '):20}{text}" for name, text in texts.items())
