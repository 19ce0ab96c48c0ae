"""Cells that do not meet their bounds, and why. One that meets them must not be here."""

from typing import NamedTuple


class Limit(NamedTuple):
    subject: str  # a closed form, "respond" or "respond_batch"
    precision: str
    quantity: str  # value, gradient or Hessian
    corners: tuple[str, ...]
    reason: str


LIMITS = (
    Limit(
        "respond",
        "float64",
        "gradient",
        ("for an hour",),
        "4,914 half-cycles without loss: the errors of the steps add up to 1e-5 s at the end."
        " The final rotation is within its bound; its derivatives are those of a slightly earlier"
        " time.",
    ),
    Limit(
        "respond",
        "float32",
        "gradient",
        ("for an hour",),
        "all 4,914 peaks are equal, and float32 reports a later one as the largest: its derivative"
        " with respect to C is that of a block after two hundred impacts. At the end the motion is"
        " five half-cycles behind.",
    ),
    Limit(
        "respond_batch",
        "float64",
        "gradient",
        ("for an hour",),
        "4,914 half-cycles without loss: the errors of the steps add up. The final rotation is"
        " within its bound; its derivatives are off by 1.2e-4.",
    ),
    Limit(
        "respond_batch",
        "float32",
        "gradient",
        ("for an hour",),
        "as in float64: the derivatives of the final rotation are off by a fifth.",
    ),
)
KNOWN = {
    (limit.subject, corner, limit.precision, limit.quantity): number
    for number, limit in enumerate(LIMITS, 1)
    for corner in limit.corners
}


def of(subject: str, precision: str, quantities: tuple[str, ...]) -> set[tuple[str, str]]:
    """Corner and quantity of the known limits of a subject."""
    return {
        (corner, quantity)
        for about, corner, bits, quantity in KNOWN
        if (about, bits) == (subject, precision) and quantity in quantities
    }
