"""What the tests of readers share."""

import pytest


@pytest.fixture
def write(tmp_path):
    """Write a file of text or bytes, and return its path."""

    def write(content, name="a.csv", encoding="utf-8"):
        path = tmp_path / name
        path.write_bytes(content if isinstance(content, bytes) else content.encode(encoding))
        return path

    return write
