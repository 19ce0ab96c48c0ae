"""Whether a file is refused in one sentence that names it."""

import re

import pytest

import jaxrock as jr


def check_refusal(path, message, read=jr.read_record, **options):
    """Read a file that has to be refused: its path in quotes, then what matches the message."""
    with pytest.raises(ValueError, match=rf"^'[^']*{re.escape(path.name)}'{message}") as error:
        read(path, **options)
    assert "\n" not in str(error.value)


def check_contradictions(path, unit, time_step, stated_unit, stated_step="the header states"):
    """Read a file with another unit, and with another step, than its header states."""
    check_refusal(path, f".*unit is '{unit}', but the header states {stated_unit}", unit=unit)
    check_refusal(
        path, f".*time_step is {time_step} s, but {stated_step}", time_step=time_step
    )
