"""``jaxrock conformance``."""

from dataclasses import dataclass
from pathlib import Path

from ..reports import conformance
from .options import Answer, Writing


@dataclass(frozen=True, kw_only=True)
class Conformance(Writing):
    """Write a table of cases that other programs can be run against.

    Blocks, inputs as files, what to compare, value, tolerance and where the value comes from:
    cases.csv, the same as cases.json, and the ground motions as CSV.

    Example: jaxrock conformance --out conformance
    """

    FILES = tuple(conformance.FILES)

    out: Path = Path("conformance")

    def run(self) -> Answer:
        """Write the cases."""
        with self.written() as scratch:
            count = conformance.write(scratch)
        return self.finished(f"{count} cases", {"cases": count})
