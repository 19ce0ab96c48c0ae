"""Files that a broken transfer has cut within their last number."""

import os

from .text import RecordText


def refuse_cut(text: RecordText, words: list[str]) -> None:
    """Refuse a text without a last line end whose last word has fewer digits than all others.

    In fixed columns every number has as many characters after its point, so that one less is
    enough. Where the number of characters varies, as repr writes it, the last one has less
    than half of the fewest: a cut that leaves more cannot be seen.
    """
    with text.path.open("rb") as stream:
        stream.seek(-1, os.SEEK_END)
        if stream.read() in b" \t\r\n\v\f\x1a":
            return
    *others, last = [len(word.rpartition(".")[2]) if "." in word else 0 for word in words]
    if not others:
        return
    fewest = min(others)
    cut = last < fewest if fewest == max(others) else 2 * last < fewest
    text.refuse(
        cut,
        f"the file seems to be cut within its last number, {words[-1]!r}, after which no line"
        " end stands: other numbers have more digits",
        len(text.lines),
    )
