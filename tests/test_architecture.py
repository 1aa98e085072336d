"""The house keeps its shape: floors, optional packages, a light import, kernels of one kind.

The rules are read off the source, so a new module is held to them the day it appears.
"""

import ast
import re
import subprocess
import sys
from pathlib import Path

import pytest

import narx_sklearn

PACKAGE = Path(narx_sklearn.__file__).parent
NAME = PACKAGE.name

# Imports go from higher to lower floors, or stay inside a room. The modules of the ground are one room.
GROUND = {"_validation", "_typing", "_threads", "_progress", "exceptions", "metrics"}
FLOORS = dict.fromkeys(GROUND, 0) | {
    "model": 1,
    "physics": 2,
    "signals": 2,
    "identification": 3,
    "discrepancy": 4,
    "compensation": 4,
    "analysis": 4,
    "report": 5,
    "displays": 5,
    "datasets": 5,
    "cli": 6,
    "__main__": 7,
    "__init__": 7,  # the public names
}
# These have rooms of their own, in which a module uses those of its room and of later ones.
ROOMS = {
    "identification": [
        "cross_validation", "validation", "free_run", "one_step", "structure", "records",
    ],
    "discrepancy": ["stages", "records", "search", "locate", "surrogates", "fitting", "simulators"],
}  # fmt: skip
COMPILERS = {"njit", "jit", "numba.njit", "numba.jit"}
OPTIONAL = {"matplotlib", "pooch", "dask", "jinja2", "fmpy"}
# Functions that a user hands over are compiled here; they have no file of ours to be cached beside.
COMPILE_USERS_FUNCTIONS = {
    Path("compensation/_user_functions.py"),
    Path("discrepancy/simulators/addresses.py"),
    Path("discrepancy/simulators/callables.py"),
    Path("discrepancy/simulators/equations.py"),
    Path("discrepancy/simulators/tables.py"),
    Path("discrepancy/simulators/accelerations.py"),
    Path("discrepancy/simulators/varied.py"),
}
MODULES = sorted(path.relative_to(PACKAGE) for path in PACKAGE.rglob("*.py"))

per_module = pytest.mark.parametrize("module", MODULES, ids=str)


def room_of(parts):
    """Return the room (or single-file module) of a path or of the parts of a dotted name."""
    return parts[0].removesuffix(".py") if parts else "__init__"


def imports(tree):
    """Yield (node, dotted name) for everything imported anywhere in a module."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            yield from ((node, alias.name) for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            yield from ((node, f"{node.module}.{alias.name}") for alias in node.names)


def parse(module):
    return ast.parse((PACKAGE / module).read_text(encoding="utf-8"))


def inside_functions(tree):
    """Return the nodes that run only when a function is called."""
    functions = (
        n for n in ast.walk(tree) if isinstance(n, ast.FunctionDef | ast.AsyncFunctionDef | ast.Lambda)
    )
    return {id(inner) for function in functions for inner in ast.walk(function)}


@per_module
def test_every_module_stands_on_a_floor(module):
    assert room_of(module.parts) in FLOORS, "a new room needs a floor here and in the design"


@per_module
def test_imports_go_only_downwards(module):
    room = room_of(module.parts)
    for node, name in imports(parse(module)):
        parts = name.split(".")
        if parts[0] != NAME:
            continue
        # `from narx_sklearn import x` names a room when x is one, else something of the package itself
        other = parts[1] if len(parts) > 1 and parts[1] in FLOORS else "__init__"
        if other == "__init__" and parts[1:2] == ["__version__"]:
            continue
        same_room = other == room or {other, room} <= GROUND
        assert same_room or FLOORS[other] < FLOORS[room], (
            f"line {node.lineno}: {room} (floor {FLOORS[room]}) imports {other} (floor {FLOORS[other]})"
        )


LARGE = [
    "compensation",
    "identification",
    "discrepancy",
    *(f"{house}/{room}" for house, rooms in ROOMS.items() for room in rooms),
    "discrepancy/search/unnamed",
    "physics/effects",
]


@pytest.mark.parametrize("room", LARGE)
def test_the_map_of_a_large_room_names_all_its_modules(room):
    told = ast.get_docstring(parse(Path(room, "__init__.py")))
    inside = {path.stem for path in (PACKAGE / room).glob("*.py")} - {"__init__"}
    assert {name for name in inside if f"``{name}``" not in told} == set()
    rooms = {path.name for path in (PACKAGE / room).iterdir()}
    named = set(re.findall(r"``(\w+)``", told))
    assert {name for name in named if name not in inside | rooms} == set(), "of what is no more"


@pytest.mark.parametrize("house", ROOMS)
def test_paragraphs_of_a_map_of_rooms_use_later_ones_alone(house):
    told = ast.get_docstring(parse(Path(house, "__init__.py")))
    paragraphs = re.split(r"\n(?=\w.*\n    )", told)
    at = {name: float(i) for i, words in enumerate(paragraphs) for name in re.findall(r"``(\w+)``", words)}
    assert [name for name in at if name in ROOMS[house]] == ROOMS[house]
    for i, room in enumerate(ROOMS[house]):
        at[room] += i / len(ROOMS[house])
    for module in (
        path for path in MODULES if room_of(path.parts) == house and path.parts[1:] != ("__init__.py",)
    ):
        own = room_of(module.parts[1:])
        used = {
            name.split(".")[2] for _, name in imports(parse(module)) if name.startswith(f"{NAME}.{house}.")
        }
        assert {other for other in used if at[other] < at[own]} == set(), f"{own} uses what stands before it"


@per_module
def test_imports_are_absolute(module):
    relative = [n.lineno for n in ast.walk(parse(module)) if isinstance(n, ast.ImportFrom) and n.level]
    assert not relative, f"relative imports in lines {relative}"


@per_module
def test_optional_packages_are_imported_only_inside_functions(module):
    tree = parse(module)
    late = inside_functions(tree)
    early = [
        f"{name} in line {n.lineno}"
        for n, name in imports(tree)
        if root(name) in OPTIONAL and id(n) not in late
    ]
    assert not early


def root(name):
    return name.partition(".")[0]


@per_module
def test_private_names_of_scikit_learn_are_imported_in_one_place(module):
    if module == Path("_validation.py"):
        return
    private = [
        name
        for _, name in imports(parse(module))
        if root(name) == "sklearn" and any(part.startswith("_") for part in name.split("."))
    ]
    assert not private, f"import {private} through _validation"


@per_module
def test_kernels_are_cached_release_the_lock_and_keep_ieee_arithmetic(module):
    for node in ast.walk(parse(module)):
        if isinstance(node, ast.FunctionDef):
            bare = [d for d in node.decorator_list if ast.unparse(d) in COMPILERS]
            assert not bare, f"line {node.lineno}: {node.name} is compiled without cache=True, nogil=True"
        elif isinstance(node, ast.Call) and ast.unparse(node.func) in COMPILERS:
            options = {option.arg: ast.unparse(option.value) for option in node.keywords}
            # what is pasted into its callers has no machine code of its own to cache
            cached = options.get("cache") == "True" or options.get("inline") == "'always'"
            cached = cached or module in COMPILE_USERS_FUNCTIONS
            assert cached, f"line {node.lineno}"
            assert options.get("nogil") == "True", f"line {node.lineno}"
            # fast-math would remove the test that stops a run at its first non-finite sample
            assert "fastmath" not in options, f"line {node.lineno}"


def modules_after(statement):
    """Return the names in ``sys.modules`` of a fresh interpreter after a statement."""
    code = f"{statement}\nimport sys\nprint(*sys.modules)"
    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True, cwd=PACKAGE.parent
    )
    return set(done.stdout.split())


def test_importing_the_package_loads_no_more_than_linear_models_of_scikit_learn_do():
    extra = modules_after(f"import {NAME}") - modules_after("import sklearn.linear_model")
    heavy = {"numba", "llvmlite", "scipy", "pandas", *OPTIONAL}
    loaded = sorted(name for name in extra if root(name) in heavy)
    assert not loaded, f"import {NAME} loads {loaded[:10]}"
