import subprocess
import sys

HEAVY = {
    *("diffrax", "lineax", "optimistix", "optax", "scipy"),
    *("xarray", "pandas", "netCDF4", "matplotlib", "PIL", "tyro"),
}


def test_the_package_imports_nothing_heavy():
    """In a process of its own: the tests import all of these."""
    code = "import sys; import jaxrock; print(*sys.modules)"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    imported = {name.partition(".")[0] for name in done.stdout.split()}
    assert "jaxrock" in imported
    assert not HEAVY & imported
