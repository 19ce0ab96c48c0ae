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
every cell. "Within" means that all functions are within the bounds below. A number refers to a
known limit below the tables: there a function exceeds its bound. Unless the name of a corner
states other values, b = 0.4 m, λ = 5, g = 9.81 m/s², C = 0.7, I = 0.15 m/s.

## Closed forms

These answers, linearized and nonlinear, are compared with mpmath at exactly the same arguments:
launch, half-cycle and stabilized velocity, period, rotation, rotation ratio, amplification,
overturning margin, overturning half-cycle, and critical intensity for 1, 10⁶ and unlimited
half-cycles. x is the stabilized velocity divided by the critical velocity.

- Values: 2 (1 + K) units in the last place. K is the sum of the magnitudes of all elasticities; the
  elasticity to C uses the smaller of C and 1 - C.
- Gradients: {corners.OF_DERIVATIVES} eps relative to each entry. This bound is divided by 1 - x²
  for answers that do not exist beyond the threshold.
- Hessians: {corners.OF_DERIVATIVES} eps, divided by 1 - x² likewise, relative to the sum of all
  entries, each multiplied by both its arguments.
- If the block overturns, values are NaN or infinite and derivatives are 0. If rounding hides
  whether x is below 1, either result is right.
- Answers below {corners.FLUSHED} times the smallest normal number may be 0.
- In float32, "1 - 1e-15" is the largest number below 1.
"""
DRIVEN = """
## Driven motion

One block is launched at 0.6 of its critical velocity, or "pushed" by a rectangular pulse with half
of its critical intensity. Peak, margin, first impact and final rotation are compared with a
pendulum in tilted gravity, computed by mpmath. Errors are relative to the answer and all its
elasticities together:

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
