"""Whether a file is refused in one sentence that names it."""

import re

import pytest

import jaxrock as jr


def check_refusal(path, message, read=jr.read_record, **options):
    """Read a file that has to be refused: its path in quotes, then what matches the message."""
    with pytest.raises(ValueError, match=rf"^'[^']*{re.escape(path.name)}'{message}") as error:
        read(path, **options)
    assert "\n" not in str(error.value)
