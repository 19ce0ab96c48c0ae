"""What the default tests cost in units of a first answer: machines differ, this ratio does not.

Run as ``python tests/benchmarks/default_run.py``, in an environment with what the tests need. It
measures the processor time of two commands, imports included, with no program compiled before:
a first ``respond_batch`` of 1,000 blocks under the example record, as users compile it (the median
of five processes), and ``pytest -n auto``, of which the largest process is printed too.
"""

import os
import resource
import statistics
import subprocess
import sys
import tempfile
from pathlib import Path

BAR = 100
FIRST_ANSWER = """
import jax, numpy
jax.config.update("jax_enable_x64", True)
import jaxrock as jr

blocks = jr.Block(numpy.linspace(0.1, 1.0, 1000), 5.0)
jr.respond_batch(blocks, 0.9, jr.example_record()).peak_rotation.block_until_ready()
"""


def measure_processor_time(*arguments):
    """Processor time of Python with all its processes [s], and its exit code."""
    usage = resource.getrusage(resource.RUSAGE_CHILDREN)
    before = usage.ru_utime + usage.ru_stime
    environment = dict(os.environ)
    for name in ("XLA_FLAGS", "JAX_COMPILATION_CACHE_DIR"):
        environment.pop(name, None)
    root = Path(__file__).parents[2]
    code = subprocess.run([sys.executable, *arguments], cwd=root, env=environment).returncode
    usage = resource.getrusage(resource.RUSAGE_CHILDREN)
    return usage.ru_utime + usage.ru_stime - before, code


def main():
    first = statistics.median(measure_processor_time("-c", FIRST_ANSWER)[0] for _ in range(5))
    print(
        f"a first respond_batch of 1,000 blocks: {first:.2f} s of processor time", flush=True
    )
    with tempfile.TemporaryDirectory() as folder:
        pytest = ("-m", "pytest", "-q", "-n", "auto", "-o", f"cache_dir={folder}")
        tests, code = measure_processor_time(*pytest)
    largest = resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss / 1e6  # from kilobytes
    print(f"the default tests: {tests:.0f} s, {tests / first:.0f} times as much (bar {BAR})")
    print(f"the largest process: {largest:.2f} GB (bar 1.5)")
    return code or int(tests > BAR * first)


if __name__ == "__main__":
    sys.exit(main())
