"""Worst trains without JAX: what SciPy's differential evolution found over all times and pulses.

The motion between pulses was exponentials (linearized) or Jacobi's elliptic functions as SciPy
has them (the pendulum about its upright position), two runs of 500 generations each. The
intensities that overturn were found by bisection and regula falsi, and are a hair larger here.
"""

import json
from pathlib import Path
from typing import NamedTuple

FOUND = Path(__file__).parent.parent / "tables" / "train_cases.jsonl"


class Case(NamedTuple):
    """A problem for both searches."""

    half_width: float
    slenderness: float
    restitution: float
    count: int
    model: str
    goal: str
    impacts_between: int
    spacing: float
    latest: float | None
    largest: float | None


class Found(NamedTuple):
    """What differential evolution came to: an intensity [m/s] or the final velocity ratio."""

    reached: float
    times: list
    intensities: list


def found():
    """What is frozen, case by case."""
    lines = map(json.loads, FOUND.read_text(encoding="utf-8").splitlines())
    return {Case(*case): Found(*answer) for case, answer in lines}


# The first six share one compiled program of `worst_train`, and are in the default run.
TELLING = list(found())[:17]
DEFAULT = 6
