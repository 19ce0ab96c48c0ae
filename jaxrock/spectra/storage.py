"""Datasets larger than memory: NetCDF filled as values come, tables written part by part."""

import math
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ..host import with_progress, written_whole
from .grid import chunks_of

if TYPE_CHECKING:
    import xarray


def stored(
    path: Path, template: "xarray.Dataset", fill: Callable[[Mapping[str, Any]], None]
) -> "xarray.Dataset":
    """A dataset like `template` in a NetCDF file, whose variables `fill` puts the values into."""
    import netCDF4
    import xarray

    with written_whole("store", path.parent, [path.name], overwrite=True) as scratch:
        template.drop_vars(list(template)).reset_coords().to_netcdf(scratch / path.name)
        with netCDF4.Dataset(scratch / path.name, "a") as file:
            for name, variable in template.items():
                dims = [str(dim) for dim in variable.dims]
                missing = math.nan if variable.dtype.kind == "f" else None
                target = file.createVariable(str(name), variable.dtype, dims, fill_value=missing)
                target.setncatts(variable.attrs)
                scalars = [str(other) for other in variable.coords if other not in variable.dims]
                if scalars:
                    target.coordinates = " ".join(scalars)
            fill(file.variables)
    return xarray.open_dataset(path)


def write_table(dataset: "xarray.Dataset", path: str | Path) -> None:
    """Write a spectrum as CSV: a column each dimension and variable, a row each grid point.

    Part by part, so that the table need not fit into memory. An existing file is replaced.

    Parameters
    ----------
    dataset : xarray.Dataset
        From `resonance_spectrum`.
    path : str or path
        The file to write.

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
        for index, part in enumerate(with_progress(_parts(dataset), "table")):
            dataset.isel(part).to_dataframe().to_csv(file, header=index == 0)


def overturned_share(dataset: "xarray.Dataset") -> float:
    """The share of the scenes in a spectrum that overturn under unlimited pulses."""
    margin = dataset.overturning_margin
    parts = with_progress(_parts(dataset), "overturned")
    return sum(int((margin.isel(part) <= 0).sum()) for part in parts) / margin.size


def _parts(dataset: "xarray.Dataset", largest: int = 2**18) -> list[dict[str, slice]]:
    """Parts of at most `largest` points, in the order of the rows."""
    dims = [str(dim) for dim in dataset.overturning_margin.dims]
    chunks = chunks_of([dataset.sizes[dim] for dim in dims], largest)
    return [dict(zip(dims, chunk, strict=True)) for chunk in chunks]
