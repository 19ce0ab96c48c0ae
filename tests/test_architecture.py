"""The rooms of the package: who may import whom, through which door, and how they are written."""

import ast
import inspect
import re
import sys
import tomllib
from pathlib import Path

import pytest

import jaxrock as jr

ROOT = Path(__file__).parent.parent
PACKAGE = ROOT / "jaxrock"
PLAN = (ROOT / "docs" / "architecture.md").read_text(encoding="utf-8")
ROOMS = re.findall(
    r"^  (\w+)(?:/|\.py) ", PLAN.partition("jaxrock/\n")[2].partition("```")[0], re.M
)
FILES = sorted(PACKAGE.rglob("*.py"))
TEXTS = {path: path.read_text(encoding="utf-8") for path in FILES}


def room_of(path):
    return path.relative_to(PACKAGE).parts[0].removesuffix(".py")


def imports(path):
    """Each relative import: how many levels up, and from which module."""
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.ImportFrom) and node.level:
            for name in [node.module] if node.module else [alias.name for alias in node.names]:
                yield node.level, name


def test_the_plan_shows_every_room():
    rooms = {room_of(path) for path in FILES} - {"__init__", "__main__"}
    assert rooms | {"data"} == set(ROOMS)
    assert len(ROOMS) == len(set(ROOMS))


@pytest.mark.parametrize("path", FILES, ids=lambda path: str(path.relative_to(PACKAGE)))
def test_imports_go_upwards_through_faces(path):
    depth = len(path.relative_to(PACKAGE).parts)
    room = room_of(path)
    inner = {each.name for each in (PACKAGE / room).glob("*/")}
    for level, name in imports(path):
        if level < depth:  # inside of the room
            assert "." not in name, f"{name} is entered past its face"
            if path.name != "__init__.py":
                assert name not in inner, f"{name} is a room inside of this one"
            continue
        assert "." not in name, f"{name} is entered past its face"
        if room in ROOMS:
            assert ROOMS.index(name) < ROOMS.index(room), f"{name} stands below {room}"


def test_files_are_of_a_size_to_be_read():
    lines = {path: len(path.read_text(encoding="utf-8").splitlines()) for path in FILES}
    assert max(lines.values()) <= 450
    assert sum(count > 400 for count in lines.values()) <= 3


TESTS = {path: path.read_text(encoding="utf-8") for path in (ROOT / "tests").rglob("*.py")}


def texts_of(room):
    if room == "tests":
        return list(TESTS.values())
    return [TEXTS[path] for path in FILES if room_of(path) == room]


def per_thousand(count, texts):
    """How often something occurs in a thousand lines."""
    return 1000 * sum(map(count, texts)) / sum(len(text.splitlines()) for text in texts)


def parallel_assignments(text):
    """`a, b = x, y`, where no right side needs the old value of a target: no swap."""
    for node in ast.walk(ast.parse(text)):
        if isinstance(node, ast.Assign) and isinstance(node.value, ast.Tuple | ast.List):
            targets = [part for target in node.targets for part in getattr(target, "elts", [])]
            for k, value in enumerate(node.value.elts):
                read = {ast.unparse(part) for part in ast.walk(value)}
                if {ast.unparse(target) for target in targets[:k]} & read:
                    break
            else:
                if targets:
                    yield ast.unparse(node)


def names_of_any_type(text):
    return len(re.findall(r"\bAny\b", text))


def long_lines(text):
    return sum(len(line) > 95 for line in text.splitlines())


def comments(text):
    return sum(line.strip().startswith("#") for line in text.splitlines())


CODE = [room for room in ROOMS if room != "data"]
HARD = ("numerics", "driven", "steady", "overturning", "calibration", "grids")
# Per thousand lines, where a room has reason for more.
MOST_OF_ANY = {"validation": 20}  # it is asked about whatever users pass
MOST_LONG_LINES = {"tables": 16, "tests": 7}  # sentences with what may stand in a file
FEWEST_COMMENTS = {"tests": 11} | dict.fromkeys(HARD, 40)


@pytest.mark.parametrize("room", [*CODE, "tests"])
def test_the_source_can_be_read(room):
    texts = texts_of(room)
    assert not [statement for text in texts for statement in parallel_assignments(text)]
    assert per_thousand(names_of_any_type, texts) <= MOST_OF_ANY.get(room, 10)
    assert per_thousand(long_lines, texts) <= MOST_LONG_LINES.get(room, 10)
    assert per_thousand(comments, texts) >= FEWEST_COMMENTS.get(room, 20)


def test_the_package_can_be_read():
    assert per_thousand(comments, TEXTS.values()) >= 40
    assert per_thousand(long_lines, TEXTS.values()) <= 5
    riddles = re.compile(r'"""(What|Whether|How|Where|Which|When)\b')
    assert not [path.name for path in FILES if riddles.search(TEXTS[path])]


PLACEHOLDERS = {
    "must",
    "wrong",
    "said",
    "got",
    "found",
    "each",
    "one",
    "own",
    "rest",
    "others",
}


@pytest.mark.parametrize("room", CODE)
def test_variables_are_called_what_they_are(room):
    names = [
        node.arg if isinstance(node, ast.arg) else node.id
        for text in texts_of(room)
        for node in ast.walk(ast.parse(text))
        if isinstance(node, ast.arg)
        or (isinstance(node, ast.Name) and isinstance(node.ctx, ast.Store))
    ]
    placeholders = [name for name in names if name in PLACEHOLDERS]
    assert not placeholders


NO_VERBS = re.compile(
    r"_*([a-z]+(?<!e)ed|about|along|at|beyond|by|in|of|on|over|under|until|while|within|with)(_|$)"
)
# Verbs, and quantities that have the word in their name.
VERBS = {"stabilized", "exceed", "feed", "need", "proceed", "seed", "succeed"}


def functions(tree):
    """Every function but properties, and methods that are called like an access: `x.at(t)`."""
    for node in ast.walk(tree):
        if isinstance(node, ast.FunctionDef):
            decorators = {ast.unparse(each) for each in node.decorator_list}
            if not any("property" in each for each in decorators):
                yield node


def test_functions_are_verbs():
    """Neither participles nor prepositions; what is public has the name that users know."""
    public = {name for room in [jr, *rooms()] for name in getattr(room, "__all__", ())}
    for path in FILES:
        for node in functions(ast.parse(TEXTS[path])):
            found = NO_VERBS.match(node.name)
            if found and node.name not in public | PUBLIC_METHODS and found[1] not in VERBS:
                raise AssertionError(f"{path.name}: {node.name}")


# Constructors, accesses, and methods of public classes.
PUBLIC_METHODS = {"of", "on_floor", "at", "at_rest", "scaled", "shifted", "bucketed"}


def rooms():
    return [getattr(jr, name) for name in dir(jr) if inspect.ismodule(getattr(jr, name))]


def test_a_class_has_a_name_of_its_own():
    names = [
        node.name
        for path in FILES
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8")))
        if isinstance(node, ast.ClassDef)
    ]
    assert len(names) == len(set(names))


def test_what_is_listed_is_there_and_nothing_of_the_inside():
    assert dir(jr) == sorted(jr.__all__)
    assert all(hasattr(jr, name) for name in dir(jr))
    named = [name for name in dir(jr) if not isinstance(getattr(jr, name), type(jr))]
    assert len(named) <= 69


def test_what_is_not_there_is_said():
    with pytest.raises(AttributeError, match="nothing"):
        _ = jr.nothing


# By distribution, where the name is another.
MODULES = {"netcdf4": "netCDF4", "lazy-loader": "lazy_loader"}


def test_what_is_imported_is_declared_and_the_other_way_round():
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    extras = project["optional-dependencies"]

    def modules(requirements):
        names = {re.match(r"[\w-]+", each)[0].lower() for each in requirements}
        return {MODULES.get(name, name) for name in names}

    imported = set()
    for path in FILES:
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.Import):
                imported |= {alias.name.partition(".")[0] for alias in node.names}
            elif isinstance(node, ast.ImportFrom) and not node.level:
                imported.add(node.module.partition(".")[0])
    imported -= sys.stdlib_module_names | {"jaxrock"}
    needed = modules(project["dependencies"])
    assert needed - imported == set()
    assert imported - needed - modules(extras["cluster"]) == set()
    # What each is for is written down.
    table = PLAN.partition("## What it is built on\n")[2].partition("\n## ")[0]
    described = set(re.findall(r"^\| (\w+) \|", table, re.M)) - {"package"}
    assert needed == described
