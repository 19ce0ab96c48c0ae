"""What mpmath says, kept as decimal strings: to compute all of it takes a quarter of an hour.

Whoever adds a case or changes a reference runs ``python tests/tools/freezing.py`` (with names
of tables, only those). A file has a line for each entry: its key, what it was asked, the
answer.
"""

import functools
import json
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import mpmath as mp

FOLDER = Path(__file__).parent / "frozen_values"


def text(number: Any, digits: int) -> str | None:
    """A number in so many digits; none where it is complex, which is no answer."""
    return (
        None
        if isinstance(number, mp.mpc)
        else mp.nstr(number, digits, min_fixed=0, max_fixed=0)
    )


def number(digits: str | None) -> Any:
    """The number again, in the digits that mpmath works with."""
    return None if digits is None else mp.mpf(digits)


@functools.cache
def table(name: str) -> dict[tuple, list]:
    """Entries by their keys, which are the strings and whole numbers that lines begin with."""
    entries = {}
    for line in (FOLDER / f"{name}.jsonl").read_text(encoding="utf-8").splitlines():
        key, *entry = json.loads(line)
        entries[tuple(key)] = entry
    return entries


def entry(name: str, *key: str | int) -> list:
    """What was asked and the answer, for one key."""
    entries = table(name)
    if key not in entries:
        raise KeyError(f"{key} is not in {name}.jsonl: python tests/tools/freezing.py {name}")
    return entries[key]


def write(name: str, entries: Iterable[tuple[tuple, list]]) -> None:
    """Replace a file."""
    lines = (json.dumps([key, *entry], separators=(",", ":")) for key, entry in entries)
    FOLDER.mkdir(exist_ok=True)
    (FOLDER / f"{name}.jsonl").write_text("\n".join(lines) + "\n", encoding="utf-8")
