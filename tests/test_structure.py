"""Structure of the code: depth of modules and folders, lengths, imports, and names that stand for one thing.

A module is one idea: it is long enough to hold it, others than its neighbour use it, and it imports few modules of the
project. A function's length is that of its body: lines after the signature, without the docstring, blank lines and
comments. ``papers`` holds the studies of the three papers, beside the product; its functions are measured, its files
are not counted. ``python -m tests.test_structure`` prints the measures.
"""

import ast
from collections import Counter, defaultdict
from functools import cache
from pathlib import Path

import numpy as np

ROOT = Path(__file__).resolve().parents[1]
PRODUCT = ("firnline", "survey", "planners", "vision_slam", "sim", "live", "desk")
PACKAGES = (*PRODUCT, "papers")
MOST_FILES, MOST_FOLDERS, MOST_LINES = 501, 70, 121_780
FEWEST_MODULES = 3
"""Modules in a folder; a smaller one belongs into its parent."""
SMALL = 80
"""Lines below which a module whose only user lies beside it belongs into that user."""
MOST_IMPORTED = 15
"""Modules of the project that one module imports."""
MOST_WITH_ONE_USER = 0.195
"""Share of modules with one user: commands, routes of the desk, planners, methods and sensors have their table alone."""
MOST_IMPORT_LINES = 0.06
LONGEST_FILE = 700
FUNCTION_MEDIAN, FUNCTION_P90, LONGEST_FUNCTION = 12, 25, 60
LEAST_NAMED_BY_TESTS = 0.7
DOORS = ("firnline/actions/", "firnline/cli/", "desk/server/")


def files() -> list[Path]:
    return sorted(file for package in PACKAGES for file in (ROOT / package).rglob("*.py"))


@cache
def trees() -> list[tuple[Path, ast.Module, list[str]]]:
    texts = [(file, file.read_text(encoding="utf-8")) for file in files()]
    return [(file, ast.parse(text), text.splitlines()) for file, text in texts]


def product() -> list[tuple[Path, ast.Module, list[str]]]:
    """Return the files of the product, without the studies of the papers."""
    return [entry for entry in trees() if entry[0].relative_to(ROOT).parts[0] in PRODUCT]


def module_name(file: Path) -> str:
    return ".".join(file.relative_to(ROOT).with_suffix("").parts).removesuffix(".__init__")


def code_lines(function: ast.FunctionDef | ast.AsyncFunctionDef, lines: list[str]) -> int:
    """Return the number of lines of a function's body, without docstring, blank lines and comments."""
    body = function.body[1:] if ast.get_docstring(function) is not None else function.body
    if not body:
        return 0
    stripped = (line.strip() for line in lines[body[0].lineno - 1 : function.end_lineno])
    return sum(bool(line) and not line.startswith("#") for line in stripped)


def function_lengths() -> dict[str, int]:
    found = {}
    for file, tree, lines in trees():
        for node in ast.walk(tree):
            if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
                found[f"{file.relative_to(ROOT)}:{node.lineno} {node.name}"] = code_lines(node, lines)
    return found


def file_lengths() -> dict[str, int]:
    return {str(file.relative_to(ROOT)): len(lines) for file, _, lines in product()}


def import_share() -> float:
    """Return the share of the product's lines that are import statements."""
    imports = sum(
        (node.end_lineno or node.lineno) - node.lineno + 1
        for _, tree, _ in product()
        for node in ast.walk(tree)
        if isinstance(node, ast.Import | ast.ImportFrom)
    )
    return imports / sum(file_lengths().values())


@cache
def uses() -> dict[str, frozenset[str]]:
    """Return the modules of the product that each of its modules imports, imports inside functions included."""
    names = {module_name(file) for file, _, _ in product()}
    return {module_name(file): frozenset(_imported(tree, names)) for file, tree, _ in product()}


def _imported(tree: ast.Module, names: set[str]) -> set[str]:
    found = set()
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            for alias in node.names:
                inner = f"{node.module}.{alias.name}"
                found.add(inner if inner in names else str(node.module))
    return found & names


@cache
def users() -> dict[str, set[str]]:
    """Return the modules of the product that import each module, and packages that make its names public; folders are left out."""
    found: dict[str, set[str]] = {
        module_name(file): set() for file, _, _ in product() if file.name != "__init__.py"
    }
    stubs = (file.with_suffix(".pyi") for file, _, _ in product() if file.name == "__init__.py")
    public = {
        module_name(stub): _imported(ast.parse(stub.read_text(encoding="utf-8")), {*found})
        for stub in stubs
        if stub.exists()
    }
    for user, used in [*uses().items(), *public.items()]:
        for name in used & found.keys() - {user}:
            found[name].add(user)
    return found


def with_one_user() -> list[str]:
    return [name for name, using in users().items() if len(using) == 1]


def small_with_a_neighbour() -> list[str]:
    """Return the small modules whose only user lies in their folder."""
    lengths = {module_name(ROOT / name): n for name, n in file_lengths().items()}
    return [
        name
        for name in with_one_user()
        if lengths[name] < SMALL
        and next(iter(users()[name])).rpartition(".")[0] == name.rpartition(".")[0]
        and next(iter(users()[name])).count(".") == name.count(".")
    ]


def folder_sizes() -> Counter[str]:
    """Return the number of modules directly in each folder."""
    sizes = Counter({str(file.parent.relative_to(ROOT)): 0 for file, _, _ in product()})
    sizes.update(str(file.parent.relative_to(ROOT)) for file, _, _ in product() if file.name != "__init__.py")
    return sizes


def class_places() -> dict[str, set[str]]:
    """Return the modules that define each public class or type alias of a module's top level."""
    places = defaultdict(set)
    for file, tree, _ in trees():
        for node in tree.body:
            if isinstance(node, ast.ClassDef) and not node.name.startswith("_"):
                places[node.name].add(str(file.relative_to(ROOT)))
    return places


def function_places() -> dict[str, set[str]]:
    """Return the modules that define each public function of a module's top level.

    A capability has one name at every door: actions, commands and handlers of the desk are left out.
    """
    places = defaultdict(set)
    for file, tree, _ in product():
        place = str(file.relative_to(ROOT))
        if place.startswith(DOORS):
            continue
        for node in tree.body:
            if isinstance(node, ast.FunctionDef) and not node.name.startswith("_"):
                places[node.name].add(place)
    return places


@cache
def without_tests() -> list[str]:
    """Return the modules with code that no test file is named after, no test imports, and that hold no example.

    What they do is tested through the functions that use them.
    """
    tests = sorted((ROOT / "tests").rglob("*.py"))
    text = "\n".join(file.read_text(encoding="utf-8") for file in tests)
    found = []
    for file, tree, lines in trees():
        place = file.relative_to(ROOT)
        defines = any(isinstance(node, ast.FunctionDef | ast.ClassDef) for node in tree.body)
        has_own = ROOT / "tests" / place.with_name(f"test_{place.name}") in tests
        is_named = ".".join(place.with_suffix("").parts) in text
        if defines and not (has_own or is_named or any(">>>" in line for line in lines)):
            found.append(str(place))
    return found


def test_no_small_module_stands_beside_its_only_user():
    assert not small_with_a_neighbour()


def test_few_modules_have_one_user():
    assert len(with_one_user()) / len(users()) <= MOST_WITH_ONE_USER


def test_folders_hold_at_least_three_modules():
    # The top folder of a package may hold folders alone.
    assert not {name: n for name, n in folder_sizes().items() if n < FEWEST_MODULES and "/" in name}


def test_modules_import_few_others():
    assert not {name: len(used) for name, used in uses().items() if len(used) > MOST_IMPORTED}


def test_the_product_stays_small():
    assert len(file_lengths()) <= MOST_FILES
    assert len(folder_sizes()) <= MOST_FOLDERS
    assert sum(file_lengths().values()) <= MOST_LINES
    assert import_share() <= MOST_IMPORT_LINES


def test_files_hold_one_idea():
    assert not {name: n for name, n in file_lengths().items() if n > LONGEST_FILE}


def test_every_class_name_stands_for_one_class():
    assert not {name: places for name, places in class_places().items() if len(places) > 1}


def test_every_function_name_stands_for_one_function():
    assert not {name: places for name, places in function_places().items() if len(places) > 1}


def test_functions_are_short():
    lengths = function_lengths()
    assert np.percentile(list(lengths.values()), 50) <= FUNCTION_MEDIAN
    assert np.percentile(list(lengths.values()), 90) <= FUNCTION_P90
    assert not {name: n for name, n in lengths.items() if n > LONGEST_FUNCTION}


def test_most_modules_are_named_by_a_test_or_hold_an_example():
    assert 1.0 - len(without_tests()) / len(trees()) >= LEAST_NAMED_BY_TESTS


def test_every_folder_says_what_it_holds():
    silent = [
        str(file.relative_to(ROOT))
        for file, tree, _ in trees()
        if file.name == "__init__.py" and not ast.get_docstring(tree)
    ]
    assert not silent


if __name__ == "__main__":
    lengths, sizes = function_lengths(), file_lengths()
    several = {name: len(places) for name, places in function_places().items() if len(places) > 1}
    share = len(with_one_user()) / len(users())
    print("files, folders, lines", len(sizes), len(folder_sizes()), sum(sizes.values()))  # noqa: T201
    print(f"import lines {import_share():.1%}, modules with one user {share:.1%}")  # noqa: T201
    print("functions: median, p90, longest", *np.percentile(list(lengths.values()), [50, 90, 100]))  # noqa: T201
    print("files: median, p90, longest", *np.percentile(list(sizes.values()), [50, 90, 100]))  # noqa: T201
    imported = {name: len(used) for name, used in uses().items()}
    for title, table in (("functions", lengths), ("files", sizes), ("imports", imported), ("names", several)):
        print(title, *sorted(table.items(), key=lambda item: -item[1])[:12], sep="\n  ")  # noqa: T201
    print("small modules beside their only user", *small_with_a_neighbour(), sep="\n  ")  # noqa: T201
    print("modules that no test names", *without_tests(), sep="\n  ")  # noqa: T201
