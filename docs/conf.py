"""How the site is built; the folder of sources is the root of the repository, for the notebooks.

``sphinx-build -W --keep-going -b html -c docs . site``
"""

import contextlib
import importlib
import inspect
import io
import os
import re
from pathlib import Path
from typing import ClassVar

from docutils import nodes
from docutils.parsers.rst import Directive
from docutils.statemachine import StringList
from latex2mathml.converter import convert
from sphinx.errors import ExtensionError

import jaxrock
from jaxrock.cli import main

project, author, language = "jaxrock", "The jaxrock developers", "en"
copyright = author
release = version = jaxrock.__version__

os.environ["COLUMNS"] = "90"  # of what commands print
root_doc = "docs/index"
include_patterns = ["docs/*.md", "docs/reference/*.md", "notebooks/*.ipynb", "CHANGELOG.md"]
exclude_patterns = ["docs/releasing.md"]
extensions = ["myst_nb", "sphinx.ext.autodoc", "sphinx.ext.napoleon"]
html_math_renderer = "mathml"  # below: browsers draw it without a script and without a network

nb_execution_mode = (
    "off"  # shown with the outputs stored in them, which the tests compute anew
)
myst_heading_anchors = 3
myst_enable_extensions = ["attrs_inline", "colon_fence", "dollarmath"]

autodoc_typehints = "signature"
autodoc_typehints_format = "short"
autodoc_member_order = "bysource"
autodoc_preserve_defaults = True
autodoc_default_options = {"members": True, "inherited-members": "Module,object,int"}
napoleon_google_docstring = False
napoleon_use_ivar = True
napoleon_use_param = False  # parameters that share a description are one entry
napoleon_use_rtype = False
default_role = "py:obj"  # links names in docstrings where there is something to link to
python_maximum_signature_line_length = 88

html_theme = "furo"
html_title = f"jaxrock {release}"
html_static_path = ["static"]
html_css_files = ["site.css"]
repository = "https://github.com/jaxrock/jaxrock"
html_theme_options = {
    "source_repository": repository,
    "source_branch": "main",
    "source_directory": "",
    "footer_icons": [{"name": "GitHub", "url": repository, "html": "GitHub", "class": ""}],
}


class CommandHelp(Directive):
    """A section for each command: what ``jaxrock COMMAND --help`` prints."""

    has_content: ClassVar[bool] = False
    optional_arguments = 99

    def run(self):
        """Make the sections."""
        return [self._show(command) for command in self.arguments]

    def _show(self, command):
        printed = io.StringIO()
        with contextlib.redirect_stdout(printed), contextlib.suppress(SystemExit):
            main([command, "--help"])
        text = printed.getvalue().strip()
        if "Usage" not in text:
            raise self.error(f"{command} has no help")
        section = nodes.section(ids=[f"help-{command}"])
        section += nodes.title("", command)
        section += nodes.literal_block(text, text, language="text")
        return section


class PublicNames(Directive):
    """A section for each package: all its public names, each with the first sentence about it."""

    def run(self):
        """Make the sections; a name that is described at the top is listed there only."""
        return [self._list(room) for room in (jaxrock, *find_rooms())]

    def _list(self, room):
        lines = []
        for name in sorted(room.__all__, key=str.lower):
            thing = getattr(room, name)
            known = room is not jaxrock and getattr(jaxrock, name, None) is thing
            if not (known or inspect.ismodule(thing)):
                about = " ".join(inspect.getdoc(thing).partition("\n\n")[0].split())
                lines.append(f"- :py:obj:`{name} <{room.__name__}.{name}>`: {about}")
        section = nodes.section(ids=[nodes.make_id(room.__name__)])
        section += nodes.title("", room.__name__)
        self.state.nested_parse(StringList(lines), self.content_offset, section)
        return section


def find_rooms():
    """List the packages that jaxrock names, in the order of the alphabet."""
    things = (getattr(jaxrock, name) for name in sorted(jaxrock.__all__))
    return filter(inspect.ismodule, things)


def skip(app, what, name, obj, *_):
    """Whether a name is left out, since its class or the top describes it."""
    room = app.env.docname.rpartition("/")[2]
    if type(obj).__name__ == "_tuplegetter":  # a field, which the class describes already
        return True
    if room == "top":
        return None
    at_top = name in jaxrock.__all__ and getattr(jaxrock, name) is obj
    return (
        True if at_top and hasattr(importlib.import_module(f"jaxrock.{room}"), name) else None
    )


def draw_inline(writer, node):
    """Write a formula in a line of text as MathML."""
    writer.body.append(to_mathml(node.astext(), "inline"))
    raise nodes.SkipNode


def draw_display(writer, node):
    """Write a formula between lines of text as MathML; a wide one scrolls by itself."""
    writer.body.append(f'<div class="math">{to_mathml(node.astext(), "block")}</div>')
    raise nodes.SkipNode


def to_mathml(formula, display):
    """Convert LaTeX to MathML; a command that the converter does not know ends the build."""
    text = convert(formula, display=display)
    if "\\" in text:
        raise ExtensionError(f"no MathML for the formula {formula!r}")
    # Of "cosh pt" the converter leaves the blank out.
    return re.sub(r"(<mi>[a-z]{2,}</mi>)(?=<m[in])", r'\1<mspace width="0.17em"/>', text)


def enter_by_the_front_door(app, exception):
    """Lead from the folder itself to the first page."""
    if exception is None and app.builder.name == "html":
        to = '<meta http-equiv="refresh" content="0; url=docs/index.html">'
        Path(app.outdir, "index.html").write_text(to + os.linesep, encoding="utf-8")


def setup(app):
    """Connect what is above; called by Sphinx."""
    app.add_directive("command-help", CommandHelp)
    app.add_directive("public-names", PublicNames)
    app.add_html_math_renderer("mathml", (draw_inline, None), (draw_display, None))
    app.connect("autodoc-skip-member", skip)
    app.connect("build-finished", enter_by_the_front_door)
