"""Tables of objects from files, and the example that comes with the library."""

import os
from importlib.resources import as_file, files
from pathlib import Path

import numpy as np

from ..block import RECTANGLE_INERTIA_RATIO, Block
from ..ground_motion import FLOOR_DAMPING, FLOOR_PERIOD
from ..impact import ONE_SIDED_RESTITUTION, compute_restitution_by_size
from ..sensitivity import Uncertain
from ..tables import Column, read_table
from ..validation import AT_LEAST_ONE, BELOW_ONE, NON_NEGATIVE, POSITIVE
from .hazard import Hazard
from .hazard_files import read_hazard
from .inventory import Inventory

# The names of the files of the example, as a user finds them.
EXAMPLE_FILES = ("objects.csv", "hazard.csv")
_DATA = files("jaxrock") / "data"


_COEFFICIENT = "restitution coefficient of variation"
_COLUMNS = {
    "name": Column(required=True, synonyms=("object",)),
    "width": Column("length", POSITIVE, required=True),
    "height": Column("length", POSITIVE, required=True),
    "depth": Column("length", POSITIVE),
    "inertia ratio": Column("ratio", AT_LEAST_ONE),
    "restitution": Column("ratio", ONE_SIDED_RESTITUTION, synonyms=("c",)),
    _COEFFICIENT: Column("ratio", NON_NEGATIVE, synonyms=("restitution cov",)),
    "one-sided": Column("flag"),
    "floor period": Column("time", FLOOR_PERIOD),
    # Above critical damping (1) the number is one of per cent.
    "floor damping": Column("ratio", BELOW_ONE),
}


def read_inventory(
    path: str | os.PathLike[str], *, samples: int = 16, seed: int = 0
) -> Inventory:
    r"""Read a table of objects from a text file, as .csv.

    Parameters
    ----------
    path : str or path
        A file with columns separated by commas, semicolons or tabs, in any order, below a
        line with their names, and their units in brackets, such as
        ``name,width [cm],height [m]``. Titles may stand above that line. Lines that begin with
        # are comments, and rows of empty cells are left out. Decimals stand behind a point, or
        behind a comma in all numbers of a table with semicolons or tabs.

        Each object has a ``name`` of its own, a ``width`` and a ``height``, which is twice
        the height of the centre of mass. It may have a ``depth``; it then rocks over the
        shorter of the two sides of its base. A missing ``inertia ratio`` stands for 4/3. A
        missing ``restitution`` stands for Housner's, and the inventory marks it as assumed. A
        missing ``restitution coefficient of variation``, also ``restitution cov``, stands for
        0. Only name, width and height may not be missing.

        The column ``one-sided`` has yes, true, 1 or x for an object against a wall, such as a
        facade, and no, false, 0 or nothing for all others. Its width is its side at right
        angles to the wall; it has no depth. Its restitution may be negative; if it is
        missing, `one_sided_restitution` gives it. An object on an upper floor has a ``floor
        period``, at most 20 s; without one, or with 0, it stands on the ground floor. It may
        have a ``floor damping``, 0.05 if it is missing.

        Lengths are in m, cm, mm, in or ft, periods in s or ms; ratios are numbers, or in % if
        their heads state it. All other columns are kept as words, in ``others``.
    samples, seed : int
        Number and seed of the samples of uncertain restitutions; see `Uncertain`.

    Returns
    -------
    Inventory

    Raises
    ------
    ValueError
        With file and line, if the file cannot be read, or a column states no unit or another
        one; with a line for each row in which a value is missing, no number or out of range, or
        an object is so stocky that Housner's restitution is negative, or that a wall does not
        throw it back.

    Examples
    --------
    >>> import pathlib, tempfile
    >>> import jaxrock as jr
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     path = pathlib.Path(folder) / "objects.csv"
    ...     _ = path.write_text("name,width [cm],height [m]\nvase,20,0.6\nbust,30,0.9\n")
    ...     print(jr.risk.read_inventory(path))
    2 objects: vase, bust
    """
    contents = read_table(path, _COLUMNS)
    values = contents.values
    one_sided = values["one-sided"]
    depth = values["depth"]
    contents.require(
        np.isnan(depth) | ~one_sided,
        "a one-sided object must have no depth: its width is at right angles to the wall",
    )
    damping = values["floor damping"]
    period = np.nan_to_num(values["floor period"])
    contents.require(np.isnan(damping) | (period > 0), "floor damping needs a floor period")
    # The shorter side of the base is the width: over the longer one it is harder to overturn.
    sizes = {
        "width": np.fmin(values["width"], depth),
        "height": values["height"],
        "inertia_ratio": _fill(values["inertia ratio"], RECTANGLE_INERTIA_RATIO),
    }
    block, wall = (Block.from_size(**sizes, one_sided=flag) for flag in (False, True))
    by_size = np.where(one_sided, *map(compute_restitution_by_size, (wall, block)))
    is_assumed = np.isnan(values["restitution"])
    restitution = _fill(values["restitution"], by_size)
    contents.require(
        (restitution >= 0) | (one_sided & ~is_assumed),
        "width and height exchanged? If not, a restitution of at least 0 must be given",
    )
    coefficient = np.nan_to_num(values[_COEFFICIENT])
    uncertain = None
    if coefficient.any():
        uncertain = Uncertain({"restitution": coefficient}, samples=samples, seed=seed)
    try:
        return Inventory(
            values["name"].tolist(),
            block,
            restitution,
            uncertain,
            one_sided=one_sided.tolist(),
            floor_period=period,
            floor_damping=_fill(damping, FLOOR_DAMPING),
            restitution_assumed=is_assumed.tolist(),
            others=contents.others,
        )
    except ValueError as error:
        raise contents.table.text.error(str(error)) from None


def _fill(values: np.ndarray, otherwise: np.ndarray | float) -> np.ndarray:
    """Put other numbers where there are none."""
    return np.where(np.isnan(values), otherwise, values)


def read_example_inventory() -> tuple[Inventory, Hazard]:
    """Read the objects and the hazard of the example; both are made up, and the hazard says so."""
    with as_file(_DATA) as folder:
        objects, hazard = (folder / f"example_{name}" for name in EXAMPLE_FILES)
        statistic = "EXAMPLE hazard, of no real place:"
        return read_inventory(objects), read_hazard(hazard, statistic=statistic)


def write_example_inventory(folder: Path) -> None:
    """Write the files of the example, for users to replace objects and hazard by theirs."""
    for name in EXAMPLE_FILES:
        (folder / name).write_bytes((_DATA / f"example_{name}").read_bytes())
