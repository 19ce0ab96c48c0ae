"""Files that a broken transfer has cut within their last number."""

import os
import re

from .text import RecordText, quote_word


def refuse_cut(text: RecordText, words: list[str]) -> None:
    """Refuse a text without a last line end whose last word has fewer digits than all others.

    In fixed columns every number has as many characters after its point, so that one less is
    enough. Where the number of characters varies, as repr writes it, the last one has less
    than half of the fewest: a cut that leaves more cannot be seen.
    """
    if not words or _is_ended(text):
        return
    *others, last = [len(word.rpartition(".")[2]) if "." in word else 0 for word in words]
    if not others:
        return
    fewest = min(others)
    cut = last < fewest if fewest == max(others) else 2 * last < fewest
    _refuse_last(text, cut, words[-1], "other numbers have more digits")


def refuse_cut_column(text: RecordText, lines: list[str]) -> None:
    """Refuse a text without a last line end whose last number ends before its column does.

    Columns are those of the other `lines`, where each ends at one place in all of them.
    """
    if not lines or _is_ended(text):
        return
    *others, last = [[word.end() for word in re.finditer(r"\S+", line)] for line in lines]
    place = len(last) - 1
    ends = {each[place] for each in others if len(each) > place}
    word = lines[-1].split()[-1]
    cut = len(ends) == 1 and last[place] < min(ends)
    _refuse_last(text, cut, word, "other numbers in its column end further right")


def _is_ended(text: RecordText) -> bool:
    """Tell whether a line end, a blank or the like stands at the end of a file."""
    with text.path.open("rb") as stream:
        stream.seek(-1, os.SEEK_END)
        return stream.read() in b" \t\r\n\v\f\x1a"


def _refuse_last(text: RecordText, cut: bool, word: str, reason: str) -> None:
    """Refuse a text if it is cut within its last number, the `word`."""
    seems = f"the file seems to be cut within its last number, {quote_word(word)}, after which"
    way = "end the last line with a line end if the number is whole"
    text.refuse(cut, f"{seems} no line end stands: {reason}; {way}", len(text.lines))
