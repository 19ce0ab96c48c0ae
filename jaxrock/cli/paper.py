"""``jaxrock paper``."""

from dataclasses import dataclass
from pathlib import Path

from ..reports import paper
from .options import Answer, Writing


@dataclass(frozen=True, kw_only=True)
class Paper(Writing):
    """Regenerate the paper's tables and figures and compare them with what it prints.

    Writes report.md, the tables as CSV and the figures as PNG. Exits with 1 if anything
    disagrees that is not a known fault of the paper.

    Example: jaxrock paper --out paper
    """

    FILES = paper.FILES

    out: Path = Path("paper")

    def run(self) -> Answer:
        """Recompute and compare."""
        with self.written() as scratch:
            report = paper.regenerate()
            paper.write(report, scratch)
        data = {
            "printed": len(report.entries),
            "agreeing": sum(entry.agrees for entry in report.entries),
            "known_faults_in_tables": sum(bool(entry.fault) for entry in report.entries),
            "claims_that_hold": sum(claim.valid for claim in report.claims),
            "claims": len(report.claims),
            "faults_reproduced": sum(fault.valid for fault in report.faults),
            "faults": len(report.faults),
            "mismatches": report.mismatches,
        }
        mismatches = [f"mismatch: {line}" for line in report.mismatches]
        text = "\n".join([paper.summary(report), *mismatches])
        return self.finished(text, data, code=1 if mismatches else 0)
