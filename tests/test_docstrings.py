"""Docstrings of all public names say what is taken, what comes back and what is refused."""

import ast
import dataclasses
import doctest
import functools
import importlib
import inspect
import json
import re
import textwrap
from pathlib import Path

import pytest

import jaxrock as jr
from jaxrock.validation import Checked


def described(section, docstring):
    """The names that a section of a docstring describes; None where it is missing."""
    text = inspect.cleandoc(docstring or "") + "\n\n"
    found = re.search(
        rf"^{section}\n-+\n(.*?)\n(?=\n[A-Z]|\n*\Z)", text, re.DOTALL | re.MULTILINE
    )
    if not found:
        return None
    heads = [line.split(" : ")[0] for line in found[1].split("\n") if re.match(r"\S", line)]
    return {name.strip() for head in heads for name in head.split(",")}


@functools.cache
def refuses(function):
    """Whether a function raises an error, by itself or in a private function that it calls."""
    tree = ast.parse(textwrap.dedent(inspect.getsource(function)))
    calls = [node for node in ast.walk(tree) if isinstance(node, ast.Call)]
    called = {call.func.id: call for call in calls if isinstance(call.func, ast.Name)}
    if "check" in called or any(isinstance(node, ast.Raise) for node in ast.walk(tree)):
        return True
    guarded = called["elementwise"].keywords if "elementwise" in called else []
    if any(keyword.arg != "model" for keyword in guarded):  # which its type says
        return True
    inner = (function.__globals__.get(name) for name in called if name.startswith("_"))
    return any(refuses(helper) for helper in inner if inspect.isfunction(helper))


def public():
    """Every public callable with all docstrings that apply to it, by name."""
    everything = {name: getattr(jr, name) for name in dir(jr)}
    rooms = [thing for thing in everything.values() if inspect.ismodule(thing)]
    everything |= {
        name: getattr(room, name) for room in rooms for name in getattr(room, "__all__", ())
    }
    for name, found in everything.items():
        if inspect.ismodule(found):
            yield name, found, found.__doc__
            continue
        if not inspect.isclass(found):
            yield name, found, found.__doc__
            continue
        yield name, found, joined(c.__doc__ for c in found.__mro__ if is_ours(c))
        for method in (m for m in dir(found) if not m.startswith("_")):
            owners = [
                c.__dict__[method] for c in found.__mro__ if method in vars(c) and is_ours(c)
            ]
            if owners and isinstance(owners[0], property | functools.cached_property):
                yield f"{name}.{method}", owners[0], owners[0].__doc__
            elif owners and inspect.isroutine(getattr(found, method)):
                docstrings = joined(owner.__doc__ for owner in owners)
                yield f"{name}.{method}", getattr(found, method), docstrings


def joined(docstrings):
    """Each without its own margin, which Python keeps before 3.13."""
    return "\n\n".join(inspect.cleandoc(each or "") for each in docstrings)


def is_ours(thing):
    return thing.__module__.startswith("jaxrock")


@pytest.mark.parametrize(
    ("name", "thing", "docstring"), [pytest.param(*each, id=each[0]) for each in public()]
)
def test_docstring_says_what_there_is(name, thing, docstring):
    assert docstring, f"{name} has no docstring"
    if isinstance(thing, property) or inspect.ismodule(thing):
        return
    said = {
        s: described(s, docstring) for s in ("Parameters", "Attributes", "Returns", "Raises")
    }
    if inspect.isclass(thing):
        fields = dataclasses.fields(thing) if dataclasses.is_dataclass(thing) else ()
        taken = {field.name for field in fields} | set(getattr(thing, "_fields", ()))
        raises = issubclass(thing, Checked) and not inspect.isabstract(thing)
    else:
        taken = set(inspect.signature(thing).parameters) - {"self"}
        silent = inspect.signature(thing).return_annotation in (None, "None")
        assert silent or said["Returns"], f"{name} has no section Returns"
        wrong = (said["Parameters"] or set()) - taken
        assert not wrong, f"{name} does not take {sorted(wrong)}"
        raises = refuses(inspect.unwrap(thing))
    assert said["Raises"] or not raises, f"{name} raises errors, but has no section Raises"
    missing = taken - (said["Parameters"] or set()) - (said["Attributes"] or set())
    assert not missing, f"{name} does not describe {sorted(missing)}"


def test_closed_forms_are_linearized_and_driven_motion_nonlinear_by_default():
    """As the conventions page and the docstrings of the functions that most users meet say."""
    for name, thing, _ in public():
        if not inspect.isroutine(thing):
            continue
        model = inspect.signature(thing).parameters.get("model")
        if model is None or model.default in (None, inspect.Parameter.empty):
            continue
        of_paper = "resonance" in thing.__module__ or name == "plot_resonance"
        assert isinstance(model.default, jr.Linearized if of_paper else jr.Nonlinear), name
    for name in ("rotation_ratio", "critical_intensity", "resonance_spectrum", "respond"):
        docstring = " ".join(getattr(jr, name).__doc__.split())
        assert "`Linearized` by default" in docstring, name
        assert "`Nonlinear` by default" in docstring, name
    page = (Path(__file__).parents[1] / "docs" / "conventions.md").read_text("utf-8")
    assert "are `Linearized` unless `model` is given" in " ".join(page.split())


FUNCTIONS = [name for name in jr.__all__ if inspect.isroutine(getattr(jr, name))]


@pytest.mark.parametrize("name", FUNCTIONS)
def test_signature_shows_names_and_not_what_they_stand_for(name):
    shown = str(inspect.signature(getattr(jr, name)))
    assert not re.search(r"jaxtyping|Array, '", shown), shown
    assert "Union[" not in shown.replace("Union[ModelLike, Literal['auto']]", ""), shown


@pytest.mark.parametrize(
    "name", [n for n in jr.__all__ if not inspect.ismodule(getattr(jr, n))]
)
def test_docstring_shows_an_example_and_its_output(name):
    examples = doctest.DocTestParser().get_examples(getattr(jr, name).__doc__)
    run = [example for example in examples if doctest.SKIP not in example.options]
    assert any(example.want for example in run), f"{name} has no example that prints"


ROOT = Path(__file__).parent.parent


def texts():
    """The strings of each module, the pages and the cells of notebooks, by their files."""
    for path in sorted((ROOT / "jaxrock").rglob("*.py")):
        nodes = ast.walk(ast.parse(path.read_text(encoding="utf-8")))
        values = [node.value for node in nodes if isinstance(node, ast.Constant)]
        yield path, "\n".join(value for value in values if isinstance(value, str))
    for path in (ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md"))):
        yield path, path.read_text(encoding="utf-8")
    for path in sorted((ROOT / "notebooks").glob("*.ipynb")):
        cells = json.loads(path.read_text(encoding="utf-8"))["cells"]
        yield path, "\n".join("".join(cell["source"]) for cell in cells)


def find_unknown_names(text):
    """The dotted names of the package in a text that lead to nothing."""
    names = re.findall(r"(?<![\w./-])(?:jaxrock|jr)((?:\.[A-Za-z_]\w*)+)", text)
    return [name for name in dict.fromkeys(names) if not leads_somewhere(name.split(".")[1:])]


def leads_somewhere(parts):
    found = jr
    for part in parts:
        fields = getattr(found, "__dataclass_fields__", {})
        if inspect.ismodule(found) and not hasattr(found, part):
            try:
                importlib.import_module(f"{found.__name__}.{part}")
            except ModuleNotFoundError:
                return False
        if not hasattr(found, part):
            return part in fields
        found = getattr(found, part)
    return True


def test_names_of_the_package_exist():
    """Those in messages, docstrings, pages and notebooks."""
    text = "use jaxrock.from_obspy, jr.Block.wide, jr.ground_motion.from_obspy, jr.Sine.angle."
    assert find_unknown_names(text) == [".from_obspy", ".Block.wide"]
    unknown = {path.relative_to(ROOT): find_unknown_names(text) for path, text in texts()}
    assert not {path: names for path, names in unknown.items() if names}


def guarded():
    """Every public function that `elementwise` made, by name."""
    for name, found, _ in public():
        function = found.fget if isinstance(found, property) else found
        if guards := getattr(function, "guards", None):
            yield pytest.param(function.__doc__, guards, id=name)


@pytest.mark.parametrize(("docstring", "guards"), [*guarded()])
def test_docstring_says_what_is_allowed(docstring, guards):
    raises = described("Raises", docstring)
    assert raises == {"ValueError"}
    for name, domain in guards.items():
        text = inspect.cleandoc(docstring)
        assert f"`{name}`" in text.partition("\nRaises\n")[2], f"{name} is not in Raises"
        assert domain.allowed.lower() in description(name, docstring).lower(), name


def description(name, docstring):
    """What the section Parameters says of an argument, in one line."""
    text = inspect.cleandoc(docstring).partition("\nParameters\n")[2].partition("\n\n")[0]
    for head, words in re.findall(r"^(\w+(?:, \w+)*) : .*\n((?:    .*\n?)*)", text, re.M):
        if name in head.split(", "):
            return " ".join(words.split())
    return ""
