"""The table of claims: ``python docs/claims.py`` writes it; ``--check`` compares only."""

import sys
from pathlib import Path

ROOT = Path(__file__).parents[1]
PAGE = ROOT / "docs" / "speed_and_accuracy.md"
MARKS = "<!-- claims: begin -->\n", "<!-- claims: end -->"
EACH = "each change"
# What is claimed, what shows it, and when that was measured last.
CLAIMS = (
    ("their derivatives: 1e-10, until 1e-4 of the barrier is left", "test_accuracy.py", EACH),
    ("no impact missed in free rocking, times to 1e-9", "test_response.py", EACH),
    ("peaks of 3,000 random pulses to 3e-9, all outcomes equal", "test_batch.py", EACH),
    ("published thresholds and their derivatives to 1e-6", "test_boundaries.py", EACH),
    ("the paper's worst train from all random starts", "test_worst.py", EACH),
    ("no certified outcome wrong, of 15.6 million", "test_within.py", "2026-11-26"),
    (
        "errors of derivatives as stated, but for 1 of 32,317",
        "test_derivatives.py",
        "2026-11-29",
    ),
    (
        "a gradient of a whole record in 2 to 4 responses",
        "benchmarks/reverse_sweep.py",
        "2026-11-29",
    ),
    ("93 % of 490 measured outcomes", "benchmarks/outcomes.py", "2026-11-29"),
)


def make_table():
    """Write the rows; a test that is not there is an error."""
    missing = [where for _, where, _ in CLAIMS if not (ROOT / "tests" / where).exists()]
    if missing:
        sys.exit(f"not there: {', '.join(missing)}")
    rows = [f"| {claim} | `tests/{where}` | {when} |\n" for claim, where, when in CLAIMS]
    return "".join(["| claim | shown by | last measured |\n|---|---|---|\n", *rows])


def main():
    """Write the table into the page, or compare it."""
    text = PAGE.read_text(encoding="utf-8")
    before, rest = text.split(MARKS[0])
    table, after = rest.split(MARKS[1])
    if "--check" in sys.argv:
        sys.exit("run python docs/claims.py" if table != make_table() else 0)
    PAGE.write_text(before + MARKS[0] + make_table() + MARKS[1] + after, encoding="utf-8")


if __name__ == "__main__":
    main()
