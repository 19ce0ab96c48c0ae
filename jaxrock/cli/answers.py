"""Answers of commands: what they print, and the files that they write."""

import contextlib
import json
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ..grids import write_table
from ..tables import write_csv

if TYPE_CHECKING:
    import xarray

    from .options import Output


@dataclass(frozen=True)
class Answer:
    """Answer of a command: text, or the same as data where ``--json`` is given.

    Attributes
    ----------
    text : object
        For people: a result, or lines.
    data : mapping
        For programs.
    output : Output
        The options that say how it is printed.
    files : sequence of Path
        The files that were written.
    code : int
        Exit code of the process.
    """

    text: object
    data: Mapping[str, object]
    output: "Output"
    files: Sequence[Path] = ()
    code: int = 0

    def __str__(self) -> str:
        paths = [str(path) for path in self.files]
        if not self.output.json:
            return "\n".join([str(self.text), *paths])
        data = {**self.data, "files": paths} if paths else self.data
        # Python writes NaN and Infinity, which JSON does not have and other parsers refuse.
        finite = json.loads(json.dumps(data), parse_constant=lambda _: None)
        return json.dumps(finite, indent=2)


@dataclass(frozen=True)
class Files:
    """Files that a command writes, each with the version and the command line.

    The dataset of a command has the name of its folder.
    """

    name: str
    folder: Path
    about: Mapping[str, str]
    paths: Sequence[Path]

    def write_csv(
        self, name: str, columns: Mapping[str, Sequence[object]], **about: object
    ) -> None:
        """Write the columns of a result as a table."""
        write_csv(self.folder / name, columns, {**self.about, **about})

    def write_dataset(
        self,
        dataset: "xarray.Dataset",
        drawn: Any,
        title: str = "",
        table: "xarray.Dataset | None" = None,
    ) -> None:
        """Write a dataset as NetCDF, its picture, and a table: by default of the same."""
        dataset = dataset.assign_attrs(self.about)
        # A large dataset has been written already, part by part.
        if not (self.folder / f"{self.name}.nc").exists():
            dataset.to_netcdf(self.folder / f"{self.name}.nc")
        chosen = dataset if table is None else table.assign_attrs(self.about)
        write_table(chosen, self.folder / f"{self.name}.csv")
        self.save_picture(f"{self.name}.png", drawn, title)

    def save_picture(self, name: str, drawn: Any, title: str = "") -> None:
        """Write the figure, or the one that axes belong to, with a title above its legend."""
        import matplotlib.pyplot as plt

        if title:
            drawn.figure.suptitle(title, fontsize="medium", wrap=True)
        drawn.figure.savefig(self.folder / name, dpi=150)
        # pyplot keeps every figure until it is closed.
        plt.close(drawn.figure)


def show_message(text: str) -> None:
    """Print a line on standard error."""
    # It may be closed or full; the exit code says the same. Without a standard error `print`
    # would write to the standard output.
    if sys.stderr is not None:
        with contextlib.suppress(OSError):
            print(f"jaxrock: {text}", file=sys.stderr)


def list_rows(columns: Mapping[str, Sequence[object]]) -> list[dict[str, object]]:
    """List the rows of a table as dictionaries."""
    rows = zip(*columns.values(), strict=True)
    return [dict(zip(columns, row, strict=True)) for row in rows]
