"""What of mpmath is frozen: ``python tests/tools/freezing.py [TABLE ...]`` computes it anew.

An entry is a key, what was asked (numbers), and the answer in more digits than the tests
distinguish. Samples keep their arguments: a new case first needs a line with those of another one.
"""

import sys
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path
from typing import NamedTuple

import mpmath as mp

TESTS = Path(__file__).parent.parent
if __name__ == "__main__":
    sys.path.insert(0, str(TESTS))
mp.mp.dps = 70  # as in the tests; some constants of the cases are made when they are imported

import numpy as np
from tables import frozen
from tables.closed_form_cases import CASES, EDGES, ON_SCENES

sys.path.append(str(TESTS / "extremes"))
import corners

PRECISIONS = ("float64", "float32")
DIGITS = {"float64": (22, 16), "float32": (14, 10)}  # of values and of derivatives


class Table(NamedTuple):
    keys: list[tuple]
    asked: Callable[..., list]  # of a key
    answer: Callable[..., list]  # of what was asked, and a key


def _samples(name, precision):
    return frozen.entry("samples", name, precision)[0]


def _at_samples(asked, name, precision):
    return [_at(CASES[name].theirs, arguments, precision) for arguments, _ in asked]


def _at(function, arguments, precision):
    """Value and gradient."""
    exact = tuple(map(mp.mpf, arguments))
    value = function(*exact)
    slopes = [mp.diff(function, exact, tuple(map(int, row))) for row in np.eye(len(exact))]
    # What does not depend on an argument at all.
    slopes = [0 if abs(slope) < 1e-60 * abs(value) else slope for slope in slopes]
    of_value, of_slopes = DIGITS[precision]
    return [frozen.text(value, of_value), [frozen.text(slope, of_slopes) for slope in slopes]]


def _edge(name, edge):
    ((arguments, _), *_), _ = frozen.entry("samples", name, "float64")
    return list(EDGES[edge][: len(arguments)])


def _on_edge(asked, name, edge):
    if edge in ("no pulse", "neither") and "amplification" in name:
        # 0 / 0 in the reference: it is even in the pulse and tends to 1 / (1 - C)^2.
        left = 1 - mp.mpf(asked[3])
        slopes = [mp.mpf(0)] * 3 + [2 / left**3, mp.mpf(0)]
        return [frozen.text(slope, 16) for slope in slopes]
    return _at(CASES[name].theirs, asked, "float64")[1]


def _corner(name, precision, corner):
    function = corners.FUNCTIONS[name]
    return list(corners.arguments(corner, function.model_name, corners.PRECISIONS[precision]))


def _in_corner(asked, name, precision, corner):
    of_value, of_slopes = DIGITS[precision]
    exact = corners.expected(corners.FUNCTIONS[name], corner, corners.PRECISIONS[precision])
    gradient = exact.gradient
    hessian = exact.hessian
    if gradient:
        # The half of the Hessian that says all; 0 what is less than the differences can tell.
        least = 10**9 * corners.STEP * abs(exact.value)
        scale = corners.scales(asked)
        pairs = [(i, j) for i in range(5) for j in range(i + 1)]
        gradient = [
            0 if abs(g * s) < least else g for g, s in zip(gradient, scale, strict=True)
        ]
        hessian = [(hessian[i][j], scale[i] * scale[j]) for i, j in pairs]
        hessian = [0 if abs(h * s) < least else h for h, s in hessian]
    return [
        frozen.text(exact.x, 30),
        bool(exact.undecided),
        frozen.text(exact.value, of_value),
        gradient and [frozen.text(n, of_slopes) for n in gradient],
        hessian and [frozen.text(n, of_slopes) for n in hessian],
    ]


TABLES = {
    "samples": Table([(n, p) for n in CASES for p in PRECISIONS], _samples, _at_samples),
    "edges": Table([(n, e) for n in ON_SCENES for e in EDGES], _edge, _on_edge),
    "corners": Table(
        [(n, p, c) for n in corners.FUNCTIONS for p in PRECISIONS for c in corners.CORNERS],
        _corner,
        _in_corner,
    ),
}


def _entry(name, key):
    asked = TABLES[name].asked(*key)
    return asked, TABLES[name].answer(asked, *key)


def main():
    """Compute and write the tables named, or all."""
    with ProcessPoolExecutor() as pool:
        for name in sys.argv[1:] or TABLES:
            keys = TABLES[name].keys
            entries = pool.map(_entry, [name] * len(keys), keys, chunksize=4)
            frozen.write(name, zip(keys, entries, strict=True))


if __name__ == "__main__":
    main()
