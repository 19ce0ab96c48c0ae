"""Datasets part by part, which need not fit into memory: as tables, and what is counted in them."""

from pathlib import Path
from typing import TYPE_CHECKING, Any

from ..host import heading, with_progress, write_about, written_whole
from .grid import chunks_of

if TYPE_CHECKING:
    import xarray


def write_table(dataset: "xarray.Dataset", path: str | Path) -> None:
    """Write a dataset as CSV: a column each dimension and variable, a row each grid point.

    Lines that begin with # say what it was computed from, the heads name the units. Part by
    part, so that the table need not fit into memory. An existing file is replaced.

    Parameters
    ----------
    dataset : xarray.Dataset
        From `resonance_spectrum` or any other function of this package.
    path : str or path

    Raises
    ------
    ValueError
        If `path` cannot be written.
    """
    path = Path(path)
    with (
        written_whole("path", path.parent, [path.name], overwrite=True) as scratch,
        open(scratch / path.name, "w", newline="", encoding="utf-8") as file,
    ):
        write_about(file, {n: v for n, v in dataset.attrs.items() if n != "Conventions"})
        for index, part in enumerate(with_progress(parts_of(dataset), "table")):
            frame = dataset.isel(part).to_dataframe().reset_index()
            heads = [heading(str(n), dataset[n].attrs.get("units", "")) for n in frame.columns]
            frame.to_csv(
                file, header=heads if index == 0 else False, index=False, na_rep="nan"
            )


def overturned_share(dataset: "xarray.Dataset") -> float:
    """Compute the share of the scenes in a spectrum that overturn under unlimited pulses."""
    margin = dataset.overturning_margin
    parts = with_progress(parts_of(dataset), "overturned")
    return sum(int((margin.isel(part) <= 0).sum()) for part in parts) / margin.size


def parts_of(dataset: "xarray.Dataset", largest: int = 2**18) -> list[dict[Any, slice]]:
    """Parts of at most `largest` points, in the order of the rows."""
    names = tuple(dataset.sizes)
    sizes = tuple(dataset.sizes.values())
    return [dict(zip(names, at, strict=True)) for at in chunks_of(sizes, largest)]
