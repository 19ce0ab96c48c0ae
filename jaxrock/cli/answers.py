"""Answers of commands: what they print, and what their files say of them."""

import dataclasses
import io
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ..ground_motion import FLOOR_DAMPING
from ..host import read_version
from .options import BlockOptions, Output, StoreOptions

if TYPE_CHECKING:
    import matplotlib.axes
    import matplotlib.figure


@dataclass(frozen=True)
class Answer:
    """Answer of a command: text, or the same as data where ``--json`` is given.

    Attributes
    ----------
    text : str
        For people.
    data : mapping
        For programs.
    output : Output
        The options that say how it is printed.
    files : sequence of Path
        The files that were written.
    code : int
        Exit code of the process.
    """

    text: str
    data: Mapping[str, object]
    output: Output
    files: Sequence[Path] = ()
    code: int = 0

    def __str__(self) -> str:
        paths = [str(path) for path in self.files]
        if not self.output.json:
            return "\n".join([self.text, *paths])
        data = {**self.data, "files": paths} if paths else self.data
        # Python writes NaN and Infinity, which JSON does not have and other parsers refuse.
        finite = json.loads(json.dumps(data), parse_constant=lambda _: None)
        return json.dumps(finite, indent=2)


def describe_options(
    command: str, options: Mapping[str, object]
) -> dict[str, str | int | float]:
    """Describe the version, the command and its options, for the files that it writes.

    Parameters
    ----------
    command : str
        Its name.
    options : mapping
        By the names of the parameters of its function; an option that is None was not given.

    Returns
    -------
    dict
        Attributes of a NetCDF file, or the lines above a table.
    """
    described: dict[str, Any] = {}
    for name, value in options.items():
        # Neither how an answer is printed nor where it is written changes a number.
        if isinstance(value, Output | StoreOptions) or name == "out":
            continue
        if isinstance(value, BlockOptions):
            described |= dataclasses.asdict(value)
            described["slenderness"] = float(value.block.slenderness)
            described["restitution"] = value.coefficient
            described["restitution_assumed"] = value.restitution is None
        elif dataclasses.is_dataclass(value) and not isinstance(value, type):
            described |= dataclasses.asdict(value)
        else:
            described[name] = value
    if described.get("floor_period") is not None and described["floor_damping"] is None:
        described["floor_damping"] = FLOOR_DAMPING
    about: dict[str, str | int | float] = {
        "source": f"jaxrock {read_version()}",
        "command": command,
    }
    return about | {
        name: _make_attribute(value)
        for name, value in described.items()
        if not (value is None or value is False or value == ())
    }


def _make_attribute(value: object) -> str | int | float:
    """Make a value an attribute of a NetCDF file: a number or text."""
    # NetCDF has no type for a bool, which Python counts as an int.
    if isinstance(value, bool):
        return int(value)
    if isinstance(value, int | float):
        return value
    return " ".join(map(str, value)) if isinstance(value, tuple) else str(value)


def list_rows(columns: Mapping[str, Sequence[object]]) -> list[dict[str, object]]:
    """List the rows of a table as dictionaries."""
    return [
        dict(zip(columns, row, strict=True)) for row in zip(*columns.values(), strict=True)
    ]


def save_picture(
    drawn: "matplotlib.axes.Axes | matplotlib.figure.Figure", file: Path | io.BytesIO
) -> None:
    """Write a figure, or the one that axes belong to, to a file."""
    import matplotlib.pyplot as plt

    figure: Any = drawn.figure
    figure.savefig(file, dpi=150)
    # pyplot keeps every figure until it is closed.
    plt.close(figure)
