"""Compute today's answers anew: ``python tests/tools/write_answers.py [--only PREFIX ...]``.

Only answers whose names begin with one of the prefixes are replaced, so that a change that is
meant is made by name. Prints what has changed, and the processor time of each group.
"""

import argparse
import sys
import time
from pathlib import Path

import jax

if __name__ == "__main__":
    sys.path.insert(0, str(Path(__file__).parent.parent))
jax.config.update("jax_enable_x64", True)

from tables.answers.table import (
    GROUPS,
    compute_group,
    describe_change,
    read_table,
    write_table,
)


def main() -> None:
    """Write the groups that are named, or that have answers that are."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--only", nargs="+", default=[""], metavar="PREFIX")
    prefixes = tuple(parser.parse_args().only)
    old = read_table()
    table = {name: old[name] for name in old if not name.startswith(prefixes)}
    for group in GROUPS:
        if not (
            group.startswith(prefixes) or any(p.startswith(f"{group}/") for p in prefixes)
        ):
            continue
        begun = time.process_time()
        answers = compute_group(group)
        print(
            f"{time.process_time() - begun:6.1f} s  {group}: {len(answers)} answers",
            flush=True,
        )
        for name, answer in answers.items():
            if name.startswith(prefixes):
                change = describe_change(answer, old[name]) if name in old else "new"
                # What is the same keeps the digits that it had.
                table[name] = answer if change else old[name]
                if change:
                    print(f"{name}: {change}")
    for name in old.keys() - table.keys():
        print(f"{name}: removed")
    write_table(table)


if __name__ == "__main__":
    main()
