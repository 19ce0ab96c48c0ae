"""Docstrings of all public names say what is taken, what comes back and what is refused."""

import ast
import dataclasses
import functools
import importlib
import inspect
import json
import re
import textwrap
from pathlib import Path

import jaxrock as jr
from jaxrock.validation import Checked

ROOT = Path(__file__).parent.parent


def list_described(section, docstring):
    """The names that a section of a docstring describes; None where it is missing."""
    text = inspect.cleandoc(docstring) + "\n\n"
    pattern = rf"^{section}\n-+\n(.*?)\n(?=\n[A-Z]|\n*\Z)"
    found = re.search(pattern, text, re.DOTALL | re.MULTILINE)
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


def list_public():
    """Every public callable with all docstrings that apply to it, by name."""
    everything = {name: getattr(jr, name) for name in dir(jr)}
    rooms = [thing for thing in everything.values() if inspect.ismodule(thing)]
    for room in rooms:
        everything |= {name: getattr(room, name) for name in getattr(room, "__all__", ())}
    for name, thing in everything.items():
        if not inspect.isclass(thing):
            yield name, thing, inspect.cleandoc(thing.__doc__ or "")
            continue
        ours = [base for base in thing.__mro__ if base.__module__.startswith("jaxrock")]
        yield name, thing, join_docstrings(ours)
        for method in (m for m in dir(thing) if not m.startswith("_")):
            owners = [vars(base)[method] for base in ours if method in vars(base)]
            if owners and isinstance(owners[0], property | functools.cached_property):
                yield f"{name}.{method}", owners[0], join_docstrings(owners[:1])
            elif owners and inspect.isroutine(getattr(thing, method)):
                yield f"{name}.{method}", getattr(thing, method), join_docstrings(owners)


def join_docstrings(owners):
    return "\n\n".join(inspect.cleandoc(owner.__doc__ or "") for owner in owners)


PUBLIC = [*list_public()]


def find_fault(name, thing, docstring):
    """What a docstring leaves out, or what it says that is not there; empty if nothing."""
    if not docstring:
        return f"{name} has no docstring"
    if isinstance(thing, property) or inspect.ismodule(thing):
        return ""
    sections = ("Parameters", "Attributes", "Returns", "Raises")
    said = {section: list_described(section, docstring) for section in sections}
    parameters = said["Parameters"] or set()
    if inspect.isclass(thing):
        fields = dataclasses.fields(thing) if dataclasses.is_dataclass(thing) else ()
        taken = {field.name for field in fields} | set(getattr(thing, "_fields", ()))
        raises = issubclass(thing, Checked) and not inspect.isabstract(thing)
    else:
        taken = set(inspect.signature(thing).parameters) - {"self"}
        if parameters - taken:
            return f"{name} does not take {sorted(parameters - taken)}"
        returns = inspect.signature(thing).return_annotation not in (None, "None")
        if returns and not said["Returns"]:
            return f"{name} has no section Returns"
        raises = refuses(inspect.unwrap(thing))
    if raises and not said["Raises"]:
        return f"{name} raises errors, but has no section Raises"
    missing = taken - parameters - (said["Attributes"] or set())
    return f"{name} does not describe {sorted(missing)}" if missing else ""


def test_docstrings_say_what_there_is():
    faults = [find_fault(*each) for each in PUBLIC]
    assert [fault for fault in faults if fault] == []
    assert find_fault("f", lambda x: x, "Take.\n\nParameters\n----------\ny : int\n") != ""


def test_docstrings_say_what_is_allowed():
    """Of every public function that `elementwise` made."""
    for name, thing, docstring in PUBLIC:
        function = thing.fget if isinstance(thing, property) else thing
        for argument, domain in getattr(function, "guards", {}).items():
            assert f"`{argument}`" in docstring.partition("\nRaises\n")[2], (name, argument)
            described = " ".join(docstring.partition("\nParameters\n")[2].split()).lower()
            assert domain.allowed.lower() in described, (name, argument)


def test_closed_forms_are_linearized_and_driven_motion_nonlinear_by_default():
    """As the conventions page says."""
    for name, thing, _ in PUBLIC:
        if not inspect.isroutine(thing):
            continue
        model = inspect.signature(thing).parameters.get("model")
        if model is None or model.default in (None, inspect.Parameter.empty):
            continue
        closed = "resonance" in thing.__module__ or name == "plot_resonance"
        assert isinstance(model.default, jr.Linearized if closed else jr.Nonlinear), name


def read_texts():
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
    return [name for name in dict.fromkeys(names) if not exists(name.split(".")[1:])]


def exists(parts):
    found = jr
    for part in parts:
        if inspect.ismodule(found) and not hasattr(found, part):
            try:
                importlib.import_module(f"{found.__name__}.{part}")
            except ModuleNotFoundError:
                return False
        if not hasattr(found, part):
            return part in getattr(found, "__dataclass_fields__", {})
        found = getattr(found, part)
    return True


def test_names_of_the_package_exist():
    """Those in messages, docstrings, pages and notebooks."""
    text = "use jaxrock.from_obspy, jr.Block.wide, jr.ground_motion.from_obspy, jr.Sine.angle."
    assert find_unknown_names(text) == [".from_obspy", ".Block.wide"]
    unknown = {path.relative_to(ROOT): find_unknown_names(text) for path, text in read_texts()}
    assert not {path: names for path, names in unknown.items() if names}
