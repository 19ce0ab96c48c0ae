"""Files as they arrive: cut, shifted, with other columns, units, separators and encodings."""

import re

import numpy as np


def cut(content, random):
    """The file ends early, as after a broken transfer."""
    return content[: random.integers(len(content))]


def lose_a_line(content, random):
    lines = content.splitlines(keepends=True)
    del lines[random.integers(len(lines))]
    return b"".join(lines)


def repeat_a_line(content, random):
    lines = content.splitlines(keepends=True)
    at = random.integers(len(lines))
    return b"".join([*lines[:at], lines[at], *lines[at:]])


def exchange_lines(content, random):
    lines = content.splitlines(keepends=True)
    one, other = random.choice(len(lines), 2, replace=False)
    lines[one], lines[other] = lines[other], lines[one]
    return b"".join(lines)


def shift(content, random):
    """A blank too many, or one that is lost, somewhere."""
    at = int(random.integers(len(content)))
    blanks = [i for i, byte in enumerate(content) if byte == ord(" ")]
    if random.integers(2) and blanks:
        at = blanks[random.integers(len(blanks))]
        return content[:at] + content[at + 1 :]
    return content[:at] + b" " + content[at:]


def exchange_columns(content, random):
    """Two fields of every line that has both change places, names of columns as well."""
    separator = b"," if content.count(b",") > content.count(b"\n") else None
    fields = [line.split(separator) for line in content.splitlines()]
    widest = max(map(len, fields))
    if widest < 2:
        return content
    one, other = random.choice(widest, 2, replace=False)
    for line in fields:
        if max(one, other) < len(line):
            line[one], line[other] = line[other], line[one]
    return b"\n".join((separator or b" ").join(line) for line in fields)


def end_lines_otherwise(content, random):
    ends = [b"\r\n", b"\r", b"\n\n", b" \n", b"\r\r\n"]
    return content.replace(b"\r\n", b"\n").replace(b"\n", ends[random.integers(len(ends))])


def encode_otherwise(content, random):
    names = ["utf-8-sig", "utf-16", "utf-16-le", "utf-32", "cp037"]
    return content.decode("utf-8").encode(names[random.integers(len(names))])


def insert_letters(content, random):
    """A station's name in another language, in some encoding, somewhere in the text."""
    at = int(random.integers(len(content)))
    letters = ["Düzce", "L'Aquila", "熊本", "\x00", "é"][random.integers(5)]
    code = ["utf-8", "latin-1"][random.integers(2)]
    return content[:at] + letters.encode(code, errors="replace") + content[at:]


def write_decimal_commas(content, random):
    """As programs in half of Europe do, with another separator of columns or the same."""
    separator = [b";", b"\t", b","][random.integers(3)]
    return re.sub(rb"\.(?=\d)", b",", content.replace(b",", separator))


def separate_otherwise(content, random):
    """Commas between columns, or else blanks, become something else."""
    separators = [b";", b"\t", b"|", b" ", b", ", b","]
    separator = separators[random.integers(len(separators))]
    if content.count(b",") > content.count(b"\n"):
        return content.replace(b",", separator)
    return re.sub(rb"(?<=\S) +(?=\S)", separator, content)


MUTATIONS = [
    cut,
    lose_a_line,
    repeat_a_line,
    exchange_lines,
    shift,
    exchange_columns,
    end_lines_otherwise,
    encode_otherwise,
    insert_letters,
    write_decimal_commas,
    separate_otherwise,
]


def read_mutations(content, path, read, same, number=1000, seed=0, statements=()):
    """Read mutations of a file, and tell which are neither read right nor refused properly.

    `read` takes the path, `same` what `read` returned and tells whether it is right: that is
    for the caller to say, since a table that is cut between two lines is a shorter table.
    Each of the `statements` is a text in the file, another one that takes its place, the name
    of what it is about, and the factor by which that changes: `same` takes the factor by this
    name. Of NaN, the file has to be refused.

    A refusal is a `ValueError` of one line that names the file. Returns the faults: the
    mutation's name and content with the answer or the error, and how many were read and
    refused.
    """
    random = np.random.default_rng(seed)
    faults = []
    counts = {"read": 0, "refused": 0}
    mutations = MUTATIONS + ["other statement"] * bool(statements)
    for k in range(number):
        mutation = mutations[k % len(mutations)]
        factors = {}
        if mutation == "other statement":
            old, new, name, factor = statements[random.integers(len(statements))]
            mutation = f"{old} -> {new}"
            mutated = content.replace(old.encode(), new.encode())
            assert mutated != content, mutation
            factors = {name: factor}
        else:
            mutated = mutation(content, random)
            mutation = mutation.__name__
        path.write_bytes(mutated)
        try:
            answer = read(path)
        except ValueError as error:
            counts["refused"] += 1
            if path.name not in str(error) or len(str(error).splitlines()) > 1:
                faults.append((mutation, mutated, error))
            continue
        counts["read"] += 1
        if not same(answer, **factors):
            faults.append((mutation, mutated, answer))
    return faults, counts
