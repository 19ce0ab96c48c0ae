"""Seismic hazard: how often a year a level of shaking is exceeded."""

import math
import os
from pathlib import Path

import jax
import jax.core
import jax.numpy as jnp
import numpy as np

from ..host import Printed, is_number, numbered_lines
from ..validation import POSITIVE, Checked, Number, Numbers, Reals, as_real, quantity


class Hazard(Printed, Checked):
    """A hazard curve: the yearly rate at which levels of an intensity measure are exceeded.

    Straight between its points in logarithms of both, and without a value beyond them.

    Parameters
    ----------
    levels : array_like, shape (n,)
        Increasing levels of the measure, greater than 0 [m/s2 or m/s].
    rates : array_like, shape (n,)
        Rates of exceedance [1/yr], greater than 0 and falling.

    Raises
    ------
    ValueError
        If there are less than two points or not as many rates as levels, if a value is not
        greater than 0, if the levels do not increase or the rates do not fall.

    Examples
    --------
    >>> import jaxrock as jr
    >>> hazard = jr.Hazard(levels=[0.1, 1.0], rates=[1e-2, 1e-4])
    >>> print(f"{hazard(0.3162):.5f} 1/yr")
    0.00100 1/yr
    """

    levels: Reals = quantity(POSITIVE)
    rates: Reals = quantity(POSITIVE)

    def __init__(self, levels: Numbers, rates: Numbers):
        self.levels = as_real("levels", levels)
        self.rates = as_real("rates", rates)
        shape, of_rates = self.levels.shape, self.rates.shape
        if len(shape) != 1 or shape[0] < 2:
            must = "levels must be one-dimensional, of at least two values"
            raise ValueError(f"{must}, got an array of shape {shape}")
        if of_rates != shape:
            raise ValueError(f"rates must be as many as levels, {shape[0]}, got {of_rates}")
        self.check()
        for name, values, sign, does in (
            ("levels", self.levels, 1, "increase"),
            ("rates", self.rates, -1, "fall"),
        ):
            if isinstance(values, jax.core.Tracer):
                continue
            steps = sign * np.diff(np.asarray(values))
            if (steps <= 0).any():
                at = int(np.argmax(steps <= 0))
                got = f"got {values[at]:.6g} and then {values[at + 1]:.6g}"
                raise ValueError(f"{name} must {does} from each to the next, {got}")

    def __str__(self) -> str:
        (low, high), (often, seldom) = (
            self.levels[:: len(self.levels) - 1],
            self.rates[:: len(self.rates) - 1],
        )
        return f"hazard from {often:.4g} 1/yr at {low:.4g} to {seldom:.4g} 1/yr at {high:.4g}"

    def __call__(self, level: Number) -> Reals:
        """The rate of exceedance.

        Parameters
        ----------
        level : array_like
            Of the intensity measure.

        Returns
        -------
        Array, shape (...)
            [1/yr]; NaN outside of the levels of the curve.
        """
        level = as_real("level", level)
        x, y = jnp.log(self.levels), jnp.log(self.rates)
        inside = (level >= self.levels[0]) & (level <= self.levels[-1])
        at = jnp.log(jnp.where(inside, level, self.levels[0]))
        return jnp.where(inside, jnp.exp(jnp.interp(at, x, y)), jnp.nan)


def read_hazard(path: str | os.PathLike[str]) -> Hazard:
    """Read a hazard curve from a .csv file.

    Parameters
    ----------
    path : str or path
        A file with two columns separated by commas, the level [m/s2 or m/s] and the rate of
        exceedance [1/yr], below one line with their names and perhaps lines that begin with #.

    Returns
    -------
    Hazard

    Raises
    ------
    ValueError
        With file and line, if the file cannot be read or holds no hazard curve.
    """
    path = Path(path)
    lines = numbered_lines(path)
    if lines and is_number(lines[0][1].split(",")[0]):
        must = "a line with the names of the two columns was expected"
        raise ValueError(f"{str(path)!r}, line {lines[0][0]}: {must}, got {lines[0][1][:60]!r}")
    rows = [_level_and_rate(path, *line) for line in lines[1:]]
    if len(rows) < 2:
        must = "at least two lines of a level and a rate below their names were expected"
        raise ValueError(f"{str(path)!r}: {must}, got {len(rows)}")
    try:
        return Hazard(*np.array(rows).T)
    except ValueError as error:
        raise ValueError(f"{str(path)!r}: {error}") from None


def _level_and_rate(path: Path, number: int, line: str) -> tuple[float, float]:
    fields = line.split(",")
    must = "a level and a rate were expected, separated by a comma"
    if len(fields) == 2 and all(map(is_number, fields)):
        level, rate = map(float, fields)
        if 0 < level < math.inf and 0 < rate < math.inf:
            return level, rate
        must = "a level and a rate must be finite and greater than 0"
    raise ValueError(f"{str(path)!r}, line {number}: {must}, got {line[:60]!r}")
