"""Files that end within their last number, for all readers of numbers."""

import pytest

from jaxrock.tables import TextFile, require_whole_end

CASES = [
    ("0.12", ["0.123", "0.456"], "has fewer digits than the others"),
    ("0.12", ["0.1", "0.456"], ""),
    ("0.", ["0.123", "0.456"], "has fewer digits than the others"),
    ("0", ["0.123", "0.456"], "has fewer digits than the others"),
    ("1.00E-0", ["1.00E-01", "2.00E-01"], "has fewer digits than the others"),
    ("1.00", ["1.00D-01", "2.00D-01"], "has fewer digits than the others"),
    ("0.0", ["1.00e-01", "2.00e-01", "0.0"], ""),
    ("0.0", ["0.12", "0.05", "0"], "has fewer digits than the others"),
    ("9e-1", ["0.5", "0.75"], ""),
    # Numbers of fixed columns that run together.
    (".12-.34", [".120-.340", ".560"], "has fewer digits than the others"),
    ("-.1-02-.2+02", ["7.0"], ""),
    # Whole numbers show it only by their column.
    ("    -12", ["   -123", "      4"], ""),
    ("    -1", ["   -123", "      4"], "ends before those above it do"),
    ("1", ["12", "34"], ""),
    ("5", [], ""),
    ("x", ["0.5"], ""),
    ("0.5", ["s01", "0.25"], "has fewer digits than the others"),
    ("5", ["x", "0.5"], "has fewer digits than the others"),
]


@pytest.mark.parametrize(("word", "others", "reason"), CASES)
def test_last_numbers(tmp_path, word, others, reason):
    path = tmp_path / "a.txt"
    words = [*others, word]
    content = "\n".join(words).encode()
    require_whole_end(TextFile(path, content + b"\n"), words)
    text = TextFile(path, content)
    if not reason:
        require_whole_end(text, words)
        return
    with pytest.raises(ValueError, match=r"a\.txt") as error:
        require_whole_end(text, words)
    assert str(error.value) == (
        f"{str(path)!r}, line {len(words)}: the file looks truncated: its last number"
        f" {word.strip()!r} {reason} and no newline follows; add a newline if it is complete"
    )


def test_no_numbers(tmp_path):
    require_whole_end(TextFile(tmp_path / "a.txt", b"name"), [])
