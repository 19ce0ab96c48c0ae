"""Datasets that need not fit into memory, read part by part: written as tables, counted."""

from pathlib import Path
from typing import TYPE_CHECKING

from ..host import defer_interrupts, show_progress, write_whole
from ..tables import format_heading, write_inputs
from ..validation import check_kind
from .axes import expand_scalars
from .grid import divide

if TYPE_CHECKING:
    import xarray

_LARGEST = 2**18  # number of points that are read at once


def write_table(dataset: "xarray.Dataset", path: str | Path) -> None:
    """Write a dataset as CSV, a column for each dimension and variable, a row for each point.

    Lines that begin with # list the inputs, the column heads give the units. The table is
    written in parts, so that it need not fit into memory. An existing file is replaced.

    Parameters
    ----------
    dataset : xarray.Dataset
        From `resonance_spectrum` or any other function of jaxrock that returns a dataset.
    path : str or path

    Raises
    ------
    ValueError
        If `dataset` is not a dataset, or `path` cannot be written.

    Examples
    --------
    >>> import pathlib, tempfile
    >>> import jaxrock as jr
    >>> spectrum = jr.resonance_spectrum([3.0, 10.0], [0.4, 1.2], 0.6, 0.15)
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     path = pathlib.Path(folder) / "spectrum.csv"
    ...     jr.grids.write_table(spectrum[["rotation_ratio"]], path)
    ...     print(path.read_text().splitlines()[6])
    slenderness [-],width [m],rotation_ratio [-],restitution [-],intensity [m/s]
    """
    import xarray

    hint = "; resonance_spectrum and other functions over grids give one"
    check_kind("dataset", dataset, xarray.Dataset, hint=hint)
    # A single point has no dimension, and would have no row.
    if not dataset.dims:
        dataset = expand_scalars(dataset, *map(str, dataset.coords))
    path = Path(path)
    with (
        write_whole("path", path.parent, [path.name], overwrite=True) as scratch,
        open(scratch / path.name, "w", newline="", encoding="utf-8") as file,
    ):
        write_inputs(file, {n: v for n, v in dataset.attrs.items() if n != "Conventions"})
        for index, part in enumerate(show_progress(divide(dataset.sizes, _LARGEST), "table")):
            with defer_interrupts():  # of reading from a file
                frame = dataset.isel(part).to_dataframe().reset_index()
            heads = [
                format_heading(str(n), dataset[n].attrs.get("units", ""))
                for n in frame.columns
            ]
            # All parts make one table, with the head above the first part.
            frame.to_csv(
                file, header=heads if index == 0 else False, index=False, na_rep="nan"
            )


def compute_overturned_fraction(dataset: "xarray.Dataset") -> float:
    """Compute the fraction of scenes in a spectrum that overturn under unlimited pulses."""
    # The margin alone is read, and a dataset in a file can be larger than memory.
    margin = dataset.overturning_margin
    regions = show_progress(divide(dataset.sizes, _LARGEST), "overturned")
    return sum(int((margin.isel(region) <= 0).sum()) for region in regions) / margin.size
