"""What the default tests cost in units of a first answer: machines differ, this ratio does not.

Run as ``python tests/benchmarks/default_run.py``, in an environment with what the tests need. It
measures the processor time of two commands, imports included, with no program compiled before:

- a first ``respond_batch`` of 1,000 blocks under the example record, as users compile it (five
  processes, of which the median counts);
- ``pytest -n auto``, the second command of the README; the largest process is printed too.
"""

import os
import resource
import statistics
import subprocess
import sys
import tempfile
from pathlib import Path

ROOT = Path(__file__).parents[2]
BAR = 150
FIRST_ANSWER = """
import jax, numpy
jax.config.update("jax_enable_x64", True)
import jaxrock as jr

blocks = jr.Block(numpy.linspace(0.1, 1.0, 1000), 5.0)
jr.respond_batch(blocks, 0.9, jr.example_record()).peak_rotation.block_until_ready()
"""


def measure_processor_time(command, **variables):
    """Processor time of a command with all its processes [s], and its exit code."""
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    environment = {key: value for key, value in os.environ.items() if key != "XLA_FLAGS"}
    environment.pop("JAX_COMPILATION_CACHE_DIR", None)
    code = subprocess.run(command, cwd=ROOT, env=environment | variables).returncode
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime, code


def main():
    first = statistics.median(
        measure_processor_time([sys.executable, "-c", FIRST_ANSWER])[0] for _ in range(5)
    )
    print(
        f"a first respond_batch of 1,000 blocks: {first:.2f} s of processor time", flush=True
    )
    with tempfile.TemporaryDirectory() as folder:
        tests, code = measure_processor_time(
            [sys.executable, "-m", "pytest", "-q", "-n", "auto", "-o", f"cache_dir={folder}"]
        )
    largest = resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss / 1e6  # from kilobytes
    print(f"the default tests: {tests:.0f} s, {tests / first:.0f} times as much (bar {BAR})")
    print(f"the largest process: {largest:.2f} GB (bar 1.5)")
    return code or int(tests > BAR * first)


if __name__ == "__main__":
    sys.exit(main())
