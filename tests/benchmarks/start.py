"""How long it takes to start: ``import jaxrock`` beside ``import jax``, and ``jaxrock assess``.

Run as ``python tests/benchmarks/start.py``. Each in processes of its own, in turn; medians.
"""

import statistics
import subprocess
import sys
import time

REPEATS = 9
BLOCK = ["assess", "--width", "0.8", "--height", "4", "--restitution", "0.7"]
COMMANDS = {
    "import jax": ["-c", "import jax"],
    "import jaxrock": ["-c", "import jaxrock"],
    "jaxrock assess": ["-m", "jaxrock", *BLOCK],
}


def main():
    """Print the median of each, and the bar beside what has one."""
    times = {name: [] for name in COMMANDS}
    for repeat in range(REPEATS + 1):
        for name, arguments in COMMANDS.items():
            begin = time.perf_counter()
            subprocess.run([sys.executable, *arguments], check=True, capture_output=True)
            if repeat:
                times[name].append(time.perf_counter() - begin)
    medians = {name: statistics.median(taken) for name, taken in times.items()}
    for name, median in medians.items():
        print(f"{name:20} {median:.2f} s, least {min(times[name]):.2f} s")
    added = [b - a for a, b in zip(times["import jax"], times["import jaxrock"], strict=True)]
    print(f"jaxrock adds {statistics.median(added):.2f} s to jax (bar: less than 0.3 s)")
    print(f"jaxrock assess takes {medians['jaxrock assess']:.2f} s (bar: less than 3 s)")


if __name__ == "__main__":
    main()
