"""Print the table of corners: `python tests/extremes/table.py` writes README.md beside it."""

import sys
from pathlib import Path

HERE = Path(__file__).parent
FILE = HERE / "README.md"
if __name__ == "__main__":
    sys.path.insert(0, str(HERE.parent))

import corners
import driven
import limits

HEAD = f"""# Corners

Printed by `python tests/extremes/table.py`; not to be edited. `test_extremes.py` evaluates
every cell: where it says "within", all functions are within the bounds below, and where it
has a number, what the number stands for is not, with the reason below the tables. Numbers not
in the name of a corner are b = 0.4 m, λ = 5, g = 9.81 m/s², C = 0.7, I = 0.15 m/s.

## Closed forms

Launch, half-cycle and stabilized velocity, period, rotation, rotation ratio, amplification,
overturning margin, overturning half-cycle, and critical intensity for 1, 10⁶ and unlimited
half-cycles; linearized and nonlinear; against mpmath at exactly the same arguments.

- Values: 2 (1 + K) units in the last place, K the sum of the magnitudes of all elasticities.
  C counts with the smaller of C and 1 - C.
- Gradients: {corners.OF_DERIVATIVES} eps of each entry; over 1 - x² for what has no value
  beyond the verge, x being the stabilized velocity over the critical one.
- Hessians: {corners.OF_DERIVATIVES} eps, over 1 - x² likewise, of the sum of all entries, each
  times both its arguments.
- Where the block overturns, values are NaN or infinite and derivatives 0. If x is closer to 1
  than rounding allows to tell, either is right.
- Up to {corners.FLUSHED} times the smallest normal number may be 0.
- "1 - 1e-15" is in float32 the number next below 1.
"""
DRIVEN = """
## Driven motion

One block under a rectangular pulse, or launched at 0.6 of its critical velocity: peak, margin,
first impact, final rotation, against the motion of a pendulum in tilted gravity in mpmath. A
block that is "pushed" gets half of its critical intensity. Errors are relative to the answer
and all its elasticities together:

| | value | gradient | Hessian |
|---|---|---|---|
"""
QUANTITIES = {"float64": corners.QUANTITIES, "float32": ("value", "gradient")}


def text() -> str:
    bounds = "".join(
        f"| {solver}, {precision} | "
        + " | ".join(
            f"{bound[what]:.0e}" if what in bound else "-" for what in corners.QUANTITIES
        )
        + " |\n"
        for (solver, precision), bound in driven.BOUNDS.items()
    )
    of_closed = [
        (precision, what) for precision in corners.PRECISIONS for what in corners.QUANTITIES
    ]
    of_driven = [
        (solver, precision, what)
        for solver, precision in driven.BOUNDS
        for what in QUANTITIES[precision]
    ]
    closed_rows = {
        corner: [_cell(corner, None, *column) for column in of_closed]
        for corner in corners.CORNERS
    }
    driven_rows = {
        name: [_cell(name, *column) for column in of_driven]
        for name in driven.CASES["float64"]
    }
    return "\n".join(
        (
            HEAD,
            _table([" ".join(column) for column in of_closed], closed_rows) + DRIVEN + bounds,
            _table([" ".join(column) for column in of_driven], driven_rows),
            "## Known limits\n",
            *(
                f"{number}. {_sentence(limit)}"
                for number, limit in enumerate(limits.LIMITS, 1)
            ),
            "",
        )
    )


def _cell(corner, solver, precision, quantity):
    subjects = [solver] if solver else corners.FUNCTIONS
    numbers = {limits.KNOWN.get((about, corner, precision, quantity)) for about in subjects}
    return ", ".join(str(number) for number in sorted(numbers - {None})) or "within"


def _table(columns, rows):
    lines = [("corner", *columns), ("---",) * (1 + len(columns))]
    lines += [(corner, *cells) for corner, cells in rows.items()]
    return "".join(f"| {' | '.join(line)} |\n" for line in lines)


def _sentence(limit):
    return f"`{limit.subject}`, {limit.quantity} in {limit.precision}: {limit.reason}"


if __name__ == "__main__":
    FILE.write_text(text(), encoding="utf-8")
