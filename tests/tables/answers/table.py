"""The table of today's answers, and what a computed answer has to be to count as the same."""

import contextlib
import io
import json
import math
import warnings
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from jaxrock.cli import main

FILE = Path(__file__).parent.parent / "answers.jsonl"


class Answer(NamedTuple):
    """Numbers, booleans or strings, in lists that nest like an array, or several by names."""

    value: Any
    tolerance: float


class Group(NamedTuple):
    """Answers of one room that share programs."""

    compute: Callable[[], Iterator[tuple]]
    tolerance: float
    by_default: bool


GROUPS: dict[str, Group] = {}


def group(name: str, tolerance: float = 1e-12, *, by_default: bool = False) -> Callable:
    """Register a function that yields names and values of answers, some with a tolerance."""

    def register(compute):
        GROUPS[name] = Group(compute, tolerance, by_default)
        return compute

    return register


def compute_group(name: str) -> dict[str, Answer]:
    """Compute the answers of a group by their names."""
    answers = {}
    with warnings.catch_warnings():
        # Remarks about a scene are no part of its answer.
        warnings.simplefilter("ignore", UserWarning)
        for ending, value, *own in GROUPS[name].compute():
            tolerance = own[0] if own else GROUPS[name].tolerance
            assert f"{name}/{ending}" not in answers, ending
            answers[f"{name}/{ending}"] = Answer(as_lists(value, tolerance), tolerance)
    return answers


def find_group(name: str) -> str:
    """Find the group of an answer."""
    return next(group for group in GROUPS if name.startswith(f"{group}/"))


def as_lists(value: Any, tolerance: float) -> Any:
    """Write a value as the table has it: numbers with three digits beyond the tolerance."""
    if isinstance(value, dict):
        return {name: as_lists(value[name], tolerance) for name in sorted(value)}
    array = np.asarray(value)
    if np.iscomplexobj(array):
        array = np.stack([array.real, array.imag])
    if array.dtype.kind != "f":
        return array.tolist()
    digits = 3 - round(math.log10(tolerance))
    rounded = [float(f"{number:.{digits}g}") for number in array.ravel().tolist()]
    # A zero has no sign.
    return (np.reshape(rounded, array.shape) + 0.0).tolist()


def describe_change(new: Answer, old: Answer) -> str:
    """Describe how an answer differs from the one in the table; empty where it does not.

    The tolerance is relative to the number itself, or to a thousandth of the largest number
    of the answer where that is more.
    """
    if new.tolerance != old.tolerance:
        return f"tolerance {old.tolerance:g} is now {new.tolerance:g}"
    if isinstance(new.value, dict) and isinstance(old.value, dict):
        if new.value.keys() != old.value.keys():
            return f"parts {list(old.value)} are now {list(new.value)}"
        changes = {
            name: describe_change(
                new._replace(value=value), old._replace(value=old.value[name])
            )
            for name, value in new.value.items()
        }
        return ", ".join(f"{name}: {change}" for name, change in changes.items() if change)
    after, before = np.asarray(new.value), np.asarray(old.value)
    if after.shape != before.shape:
        return f"shape {before.shape} is now {after.shape}"
    differs = after != before
    if "f" in (after.dtype.kind, before.dtype.kind):
        size = np.where(np.isfinite(before), np.abs(before), 0.0)
        bound = old.tolerance * np.maximum(size, 1e-3 * size.max(initial=0.0))
        with np.errstate(invalid="ignore"):
            near = np.abs(after - before) <= bound
        differs &= ~near & ~(np.isnan(after) & np.isnan(before))
    if not differs.any():
        return ""
    place = tuple(np.argwhere(differs)[0])
    at = f" at {list(map(int, place))}" if place else ""
    # Without their types, which NumPy prints.
    pair = f"{before[place].item()!r} is now {after[place].item()!r}"
    return f"{pair}{at}, {differs.sum()} of {differs.size} differ"


def read_table() -> dict[str, Answer]:
    """Read the answers of the table by their names."""
    lines = FILE.read_text(encoding="utf-8").splitlines()
    entries = map(json.loads, lines)
    return {entry["name"]: Answer(entry["value"], entry["tolerance"]) for entry in entries}


def write_table(answers: dict[str, Answer]) -> None:
    """Replace the table: a line for each answer, so that a diff shows which have changed."""
    lines = [
        json.dumps({"name": name, "tolerance": tolerance, "value": value})
        for name, (value, tolerance) in sorted(answers.items())
    ]
    FILE.write_text("\n".join(lines) + "\n", encoding="utf-8")


def list_changes(name: str) -> list[str]:
    """List what differs in a group from the table."""
    new = compute_group(name)
    old = {key: answer for key, answer in read_table().items() if key.startswith(f"{name}/")}
    lines = [f"{key}: new" for key in new.keys() - old.keys()]
    lines += [f"{key}: missing" for key in old.keys() - new.keys()]
    changes = {key: describe_change(new[key], old[key]) for key in new.keys() & old.keys()}
    return sorted(lines + [f"{key}: {change}" for key, change in changes.items() if change])


# For the rooms


def list_fields(
    result: Any, names: str, prefix: str = "", *tolerance: float
) -> Iterator[tuple]:
    """List some attributes of a result."""
    for name in names.split():
        yield prefix + name, getattr(result, name), *tolerance


def stack_fields(results: Any, names: str, prefix: str = "") -> Iterator[tuple]:
    """List some attributes that several results have, those of all results as one answer."""
    results = list(results)
    for name in names.split():
        yield prefix + name, stack([getattr(result, name) for result in results])


def stack(values: list) -> np.ndarray:
    """Stack numbers, or lists of them, of which shorter ones are filled with NaN."""
    arrays = [np.asarray(value) for value in values]
    if len({array.shape for array in arrays}) > 1:
        longest = max(array.size for array in arrays)
        fill = {"constant_values": np.nan}
        arrays = [np.pad(a.astype(float), (0, longest - a.size), **fill) for a in arrays]
    return np.stack(arrays)


def list_variables(dataset: Any, prefix: str = "") -> Iterator[tuple]:
    """List the variables of a dataset as flat arrays, without its coordinates."""
    for name, variable in dataset.data_vars.items():
        # There are several periods: a name that says which is better than the one of today.
        full_name = "stabilized_period" if name == "period" else name
        yield f"{prefix}{full_name}", variable.values.ravel()


def run_command(*words: Any) -> dict:
    """Run a command in this process; its answer as JSON."""
    printed, said = io.StringIO(), io.StringIO()
    with contextlib.redirect_stdout(printed), contextlib.redirect_stderr(said):
        try:
            main([*map(str, words), "--json"])
        except SystemExit as refused:
            raise ValueError(said.getvalue()) from refused
    return json.loads(printed.getvalue())
