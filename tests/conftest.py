"""Strict settings for all tests.

Float64 unless ``--precision 32``; promotions of rank and dtype raise; types of all arguments
and results of the package are checked; 70 digits in mpmath. What one process has compiled,
the others take from a folder: that of ``JAX_COMPILATION_CACHE_DIR`` if set, else one that
lasts as long as the run. Since most of the time goes into compiling, programs are optimized
less than a user's; with ``XLA_FLAGS`` set, even to nothing, they are optimized as usual.
"""

import atexit
import gc
import os
import shutil
import tempfile

# Before JAX is imported; workers and the commands that tests start inherit it.
if "JAX_COMPILATION_CACHE_DIR" not in os.environ:
    os.environ["JAX_COMPILATION_CACHE_DIR"] = tempfile.mkdtemp(prefix="compiled-")
    atexit.register(shutil.rmtree, os.environ["JAX_COMPILATION_CACHE_DIR"], ignore_errors=True)
os.environ["JAX_PERSISTENT_CACHE_MIN_COMPILE_TIME_SECS"] = "0"
os.environ.setdefault("XLA_FLAGS", "--xla_backend_optimization_level=1")

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
hypothesis.settings.register_profile("jaxrock", deadline=None, max_examples=50, derandomize=True)
hypothesis.settings.load_profile("jaxrock")

collect_ignore = ["references", "tables", "tools"]  # no tests


def pytest_addoption(parser):
    parser.addoption("--precision", choices=("32", "64"), default="64", help="bits of a number")
    parser.addoption("--devices", type=int, default=1, help="that the processor is made of")


def pytest_configure(config):
    jax.config.update("jax_enable_x64", config.getoption("--precision") == "64")
    if config.getoption("--devices") > 1:
        jax.config.update("jax_num_cpu_devices", config.getoption("--devices"))


@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(config, items):
    for item in items:  # the first one stays, since it is what the README shows
        if item.path.suffix == ".ipynb" and not item.path.name.startswith("1"):
            item.add_marker("thorough")
    if config.getoption("--precision") == "32":
        left_out = [item for item in items if item.get_closest_marker("float64")]
        config.hook.pytest_deselected(items=left_out)
        items[:] = [item for item in items if item not in left_out]


@pytest.fixture
def eps():
    """Rounding unit of the precision that the tests run in."""
    return float(jax.numpy.finfo(jax.numpy.result_type(float)).eps)
