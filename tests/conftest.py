"""Strict settings for all tests.

Float64 unless ``--precision 32``; promotions of rank and dtype raise; types of all arguments
and results of the package are checked; 70 digits in mpmath.

Most of the time goes into compiling. So programs are hardly optimized (with ``XLA_FLAGS`` set,
even to nothing, they are as usual), and they are kept in pytest's cache folder, for the other
workers, for the commands that tests start and for the next run; ``pytest --cache-clear`` drops
them. Without that folder (``-p no:cacheprovider``) they are kept for one run only.
"""

import ctypes
import gc
import os
import sys
import tempfile
from pathlib import Path

# Before JAX is imported; workers and the commands that tests start inherit it.
os.environ.setdefault("XLA_FLAGS", "--xla_backend_optimization_level=0")
os.environ["JAX_PERSISTENT_CACHE_MIN_COMPILE_TIME_SECS"] = "0"

import hypothesis
import jax
import matplotlib
import mpmath
import pytest
from jaxtyping import install_import_hook

install_import_hook("jaxrock", "beartype.beartype")
matplotlib.use("agg")
gc.set_threshold(100_000, 20, 50)  # tracing makes many objects, of which few are garbage
mpmath.mp.dps = 70
jax.config.update("jax_numpy_rank_promotion", "raise")
jax.config.update("jax_numpy_dtype_promotion", "strict")
hypothesis.settings.register_profile(
    "jaxrock", deadline=None, max_examples=50, derandomize=True
)
hypothesis.settings.load_profile("jaxrock")

# Bytes of programs that are kept from run to run, and of a process that then drops its programs.
LARGEST_FOLDER = 1e9
LARGEST_AFTER_A_FILE = 0.7e9
LARGEST_AFTER_A_TEST = 0.9e9

collect_ignore = ["benchmarks", "references", "tables", "tools"]  # no tests


def pytest_addoption(parser):
    parser.addoption(
        "--precision", choices=("32", "64"), default="64", help="bits of a number"
    )
    parser.addoption("--devices", type=int, default=1, help="that the processor is made of")
    parser.addoption("--shard", default="1/1", help="K/N: the K-th of N parts of the tests")


def pytest_configure(config):
    jax.config.update("jax_enable_x64", config.getoption("--precision") == "64")
    folder = os.environ.setdefault("JAX_COMPILATION_CACHE_DIR", choose_folder(config))
    jax.config.update("jax_compilation_cache_dir", folder)
    if not hasattr(config, "workerinput"):
        drop_oldest(Path(folder))
    # Registered, since hooks of this file are not called for examples in docstrings.
    config.pluginmanager.register(Everywhere())
    if config.getoption("--devices") > 1:
        jax.config.update("jax_num_cpu_devices", config.getoption("--devices"))


def choose_folder(config):
    """For programs: in pytest's cache folder, or in one that is gone when the tests are over."""
    if config.pluginmanager.hasplugin("cacheprovider"):
        return str(config.cache.mkdir("compiled-programs"))
    temporary = tempfile.TemporaryDirectory(prefix="compiled-programs-")
    config.add_cleanup(temporary.cleanup)
    return temporary.name


class Everywhere:
    """Hooks for examples in docstrings, too."""

    @staticmethod
    def pytest_runtest_teardown():
        """Matplotlib warns of too many pictures that are open."""
        if "matplotlib.pyplot" in sys.modules:
            sys.modules["matplotlib.pyplot"].close("all")

    @staticmethod
    @pytest.hookimpl(trylast=True)
    def pytest_collection_modifyitems(config, items):
        """Every N-th of the files with tests that are left: files share programs."""
        shard, shards = map(int, config.getoption("--shard").split("/"))
        files = sorted({item.path for item in items})[shard - 1 :: shards]
        leave_out(config, items, [item for item in items if item.path not in files])


def leave_out(config, items, left_out):
    config.hook.pytest_deselected(items=left_out)
    items[:] = [item for item in items if item not in left_out]


def drop_oldest(folder):
    """Of the programs, so that the folder stays below its bound."""
    files = [(path.stat(), path) for path in folder.iterdir()]
    excess = sum(status.st_size for status, _ in files) - LARGEST_FOLDER
    for status, path in sorted(files, key=lambda file: file[0].st_mtime):
        if excess <= 0:
            break
        path.unlink()
        excess -= status.st_size


@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(config, items):
    for item in items:  # notebooks, and the examples in docstrings
        if item.path.suffix == ".ipynb" or isinstance(item, pytest.DoctestItem):
            item.add_marker("thorough")
    marks = {"float64"} if config.getoption("--precision") == "32" else set()
    if "optimization_level=0" in os.environ["XLA_FLAGS"]:
        marks.add("optimized")
    leave_out(config, items, [i for i in items if any(map(i.get_closest_marker, marks))])


@pytest.fixture
def eps():
    """Rounding unit of the precision that the tests run in."""
    return float(jax.numpy.finfo(jax.numpy.result_type(float)).eps)


@pytest.hookimpl(trylast=True)
def pytest_runtest_teardown(item, nextitem):
    """Let go of the programs that a file has used, or a single test, before there are too many."""
    status = Path("/proc/self/statm")  # of Linux alone
    pages = int(status.read_text(encoding="ascii").split()[1]) if status.exists() else 0
    is_last = nextitem is None or nextitem.path != item.path
    largest = LARGEST_AFTER_A_FILE if is_last else LARGEST_AFTER_A_TEST
    if pages and pages * os.sysconf("SC_PAGE_SIZE") > largest:
        jax.clear_caches()
        gc.collect()
        ctypes.CDLL(None).malloc_trim(0)  # else what is free stays with the process
