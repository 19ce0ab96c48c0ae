import subprocess
import sys
from pathlib import Path

import pytest


@pytest.mark.thorough
@pytest.mark.float64
def test_on_two_devices(pytestconfig):
    """In a process of its own: with two devices, all others would compile everything twice."""
    tests = str(Path(__file__).parent / "tools" / "on_two_devices.py")
    command = [sys.executable, "-m", "pytest", "--devices", "2", tests]
    done = subprocess.run(
        command, cwd=pytestconfig.rootpath, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stdout
    assert "3 passed" in done.stdout
