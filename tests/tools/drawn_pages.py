"""The pictures of the pages: ``python tests/tools/drawn_pages.py`` draws them anew.

A picture is drawn by the block of Python above it. A block of text between the two is what the code
prints. With names of pages it draws only theirs.
"""

import contextlib
import io
import re
import sys
from pathlib import Path

import jax
import matplotlib.pyplot as plt
import numpy as np
from PIL import Image

ROOT = Path(__file__).parents[2]
FOLDER = ROOT / "docs" / "pictures"
NAMES = re.compile(r"\]\((?:docs/)?pictures/(\w+\.png)\)")
PARTS = re.compile(
    r"```python\n(.*?)```"
    r"(?:(?:\n\n[^`\n]+)?\n\n```text\n(.*?)```)?"
    r"(?:\n\n!\[[^\]]*\]\((?:docs/)?pictures/(\w+\.png)\))?",
    re.DOTALL,
)
COLOURS = 64  # enough for lines, and a third of the bytes


def draw_pictures(text, namespace, execute=exec):
    """Run the code of a page; return pictures by name, and pairs of what it prints and should."""
    pictures = {}
    printed = []
    for code, expected, name in PARTS.findall(text):
        with contextlib.redirect_stdout(io.StringIO()) as output:
            execute(code, namespace)
        print(output.getvalue(), end="")
        if expected:
            printed.append((output.getvalue(), expected))
        if name:
            file = io.BytesIO()
            plt.figure(plt.get_fignums()[-1]).savefig(file, dpi=100, bbox_inches="tight")
            picture = Image.open(file).convert("RGB")
            pictures[name] = picture.quantize(COLOURS, dither=Image.Dither.NONE)
        plt.close("all")
    return pictures, printed


def find_difference(picture, name):
    """Mean difference from the picture that is kept: greys from 0 to 255 of coarse squares."""
    with Image.open(FOLDER / name) as kept:
        old, new = (
            np.asarray(image.convert("L").resize((60, 40)), float) for image in (kept, picture)
        )
    return np.abs(new - old).mean()


def main():
    """Draw the pictures of the pages named, or of all."""
    jax.config.update("jax_enable_x64", True)
    plt.switch_backend("agg")
    for path in (ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md"))):
        text = path.read_text(encoding="utf-8")
        is_chosen = path.stem in (sys.argv[1:] or [path.stem])
        if is_chosen and NAMES.search(text):
            for name, picture in draw_pictures(text, {})[0].items():
                picture.save(FOLDER / name, optimize=True)
                print(f"{path.name}: {name}, {(FOLDER / name).stat().st_size / 1000:.0f} kB")


if __name__ == "__main__":
    main()
