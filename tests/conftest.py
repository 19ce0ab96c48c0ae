"""Strict settings for all tests.

Float64 unless ``--precision 32``; promotions of rank and dtype raise; two host devices;
types of all arguments and results of the package are checked; 70 digits in mpmath.
"""

import os

os.environ["XLA_FLAGS"] = os.environ.get("XLA_FLAGS", "") + (
    " --xla_force_host_platform_device_count=2"
)

import hypothesis
import jax
import matplotlib
import mpmath
import pytest
from jaxtyping import install_import_hook

install_import_hook("jaxrock", "beartype.beartype")
matplotlib.use("agg")
mpmath.mp.dps = 70
jax.config.update("jax_numpy_rank_promotion", "raise")
jax.config.update("jax_numpy_dtype_promotion", "strict")
hypothesis.settings.register_profile("jaxrock", deadline=None, max_examples=50, derandomize=True)
hypothesis.settings.load_profile("jaxrock")


def pytest_addoption(parser):
    parser.addoption("--precision", choices=("32", "64"), default="64", help="bits of a number")


def pytest_configure(config):
    jax.config.update("jax_enable_x64", config.getoption("--precision") == "64")


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
