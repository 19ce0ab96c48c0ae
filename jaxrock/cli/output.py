"""What commands write: pictures, tables, JSON."""

import csv
import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

Row = dict[str, Any]  # of a table, by column


def picture(draw: Any, path: Path, **options: Any) -> None:
    """Write a figure to a file, or what `draw` draws on new axes."""
    import matplotlib

    matplotlib.use("agg")
    import matplotlib.pyplot as plt

    figure = draw
    if callable(draw):
        figure, axes = plt.subplots(layout="constrained", **options)
        draw(axes)
    figure.savefig(path, dpi=150)
    plt.close(figure)


def rows_of(**columns: Any) -> list[Row]:
    """The rows of a table given by its columns."""
    table = zip(*(np.asarray(column).tolist() for column in columns.values()), strict=True)
    return [dict(zip(columns, row, strict=True)) for row in table]


def write_rows(rows: Sequence[Row], path: Path, names: Sequence[str]) -> None:
    """Write rows as CSV, a column each name."""
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.DictWriter(file, fieldnames=names)
        writer.writeheader()
        writer.writerows(rows)


def dumps(value: Any) -> str:
    """JSON; null stands for numbers that are not finite."""
    # Python writes them as constants that JSON does not have, and reads them by what is passed.
    finite = json.loads(json.dumps(value), parse_constant=lambda _: None)
    return json.dumps(finite, indent=2)
