"""Docstrings of all public names say what is taken, what comes back and what is refused."""

import ast
import dataclasses
import doctest
import functools
import inspect
import re
import textwrap

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
