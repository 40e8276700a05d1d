"""Digest of the code that a function depends on: the definitions that it reaches, without docstrings and comments.

Names are followed through imports, also those inside functions, and through stubs of packages. A method counts where its
class is reached and its name is an attribute anywhere in what is reached. Statements of a module that define nothing count
wherever it is imported, and all of a module that is passed on or run as a program. Benchmarks and studies name modules and
commands in strings, which are followed too. So a digest changes with every definition that could matter, and with some that
do not. Versions of other packages and data files are no part of it.
"""

import ast
import hashlib
import re
from collections import defaultdict
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path

ROOT = Path(__file__).parents[1]
PACKAGES = (
    "firnline",
    "survey",
    "planners",
    "vision_slam",
    "sim",
    "live",
    "desk",
    "papers",
    "benchmarks",
    "tests",
)
_NAMED = re.compile(rf"\b(?:{'|'.join(PACKAGES)})(?:\.\w+)+(?::\w+)?")
_WITH_PROGRAMS = ("benchmarks/", "papers/", "tests/")
"""Folders whose strings may be programs or commands that name modules."""
_STORING = ("benchmarks.writer", "benchmarks.stored_parts", "papers.provenance", "papers.code_closure")
"""Modules that store outcomes and count for nothing in them."""
_COMMAND_LINES = ("firnline", "firnline.cli.main")
_PLAIN_DECORATORS = {
    "property",
    "cached_property",
    "classmethod",
    "staticmethod",
    "cache",
    "abstractmethod",
    "override",
}
_PLAIN_BASES = {
    "NamedTuple",
    "Protocol",
    "ABC",
    "Enum",
    "StrEnum",
    "IntEnum",
    "Generic",
    "TypedDict",
    "BaseModel",
    "Exception",
}

Place = tuple[str, str]
"""A module and one of its names; the name ``*`` is all of it, and an empty one its statements that define nothing."""


@dataclass
class _Part:
    """A definition, or several of one name: their digests, what they refer to, and the methods of a class."""

    digests: list[bytes] = field(default_factory=list)
    names: set[str] = field(default_factory=set)
    attributes: set[str] = field(default_factory=set)
    modules: set[str] = field(default_factory=set)
    methods: dict[str, bool] = field(default_factory=dict)
    """Names of methods, and whether something else than a call by this name may use them."""

    def add(self, node: ast.AST, *, with_programs: bool) -> None:
        """Add a statement."""
        self.digests.append(hashlib.sha256("".join(_texts(node)).encode()).digest())
        for inner in _walked(node):
            if isinstance(inner, ast.Name):
                self.names.add(inner.id)
            elif isinstance(inner, ast.Attribute):
                chain = _chain(inner)
                self.attributes.update(chain[1:])
                if chain[0]:
                    self.names.add(".".join(chain))
            elif isinstance(inner, ast.MatchClass):
                self.attributes.update(inner.kwd_attrs)
            elif isinstance(inner, ast.Constant) and isinstance(inner.value, str):
                if inner.value.isidentifier():
                    self.attributes.add(inner.value)
                if with_programs and inner.value not in _COMMAND_LINES:
                    self.modules.update(_NAMED.findall(inner.value))
            elif isinstance(inner, ast.List | ast.Tuple) and with_programs:
                self.modules.update(_commands(inner))


@dataclass
class ModuleParts:
    """A module: its parts by name, and what its imports bind: a module alone, or one of a module's names."""

    parts: dict[str, _Part] = field(default_factory=dict)
    imports: dict[str, set[Place]] = field(default_factory=lambda: defaultdict(set))

    @classmethod
    def parsed(cls, text: str, *, with_programs: bool) -> "ModuleParts":
        """Read a module; `with_programs` looks for modules and commands in its strings."""
        tree, found = ast.parse(text), cls()
        for node in ast.walk(tree):
            if isinstance(node, ast.Import):
                for alias in node.names:
                    bound = alias.asname or alias.name.partition(".")[0]
                    found.imports[bound].add((alias.name if alias.asname else bound, ""))
            elif isinstance(node, ast.ImportFrom):
                for alias in node.names:
                    found.imports[alias.asname or alias.name].add((str(node.module), alias.name))
        for node in tree.body:
            if isinstance(node, ast.ClassDef):
                found._split(node, with_programs=with_programs)
            for name in _defined(node):
                found.parts.setdefault(name, _Part()).add(node, with_programs=with_programs)
        return found

    def _split(self, node: ast.ClassDef, *, with_programs: bool) -> None:
        """Make parts of the methods of a class, and leave the rest in it."""
        methods = [each for each in node.body if isinstance(each, ast.FunctionDef | ast.AsyncFunctionDef)]
        node.body = [each for each in node.body if each not in methods]
        is_plain = all(_last_name(base) in _PLAIN_BASES or isinstance(base, ast.Name) for base in node.bases)
        own = self.parts.setdefault(node.name, _Part())
        for method in methods:
            is_called_by_name = is_plain and not method.name.startswith("__")
            is_called_by_name &= all(_last_name(each) in _PLAIN_DECORATORS for each in method.decorator_list)
            own.methods[method.name] = own.methods.get(method.name, False) or not is_called_by_name
            part = self.parts.setdefault(f"{node.name}.{method.name}", _Part())
            part.add(method, with_programs=with_programs)


def _defined(node: ast.stmt) -> list[str]:
    """Return the names that a statement of a module defines, an empty one where it defines none or sets how the module works."""
    if _is_bare_text(node) or isinstance(node, ast.Import | ast.ImportFrom):
        return []
    if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef | ast.ClassDef):
        return ["" if node.name.startswith("__") else node.name]
    if isinstance(node, ast.Assign):
        targets = [name for target in node.targets for name in ast.walk(target)]
        names = [name.id for name in targets if isinstance(name, ast.Name) and name.id != "__all__"]
        return ["" if name.startswith("__") else name for name in names] or ([] if _sets_all(node) else [""])
    if isinstance(node, ast.AnnAssign) and isinstance(node.target, ast.Name):
        return [node.target.id]
    asks = (
        {name.id for name in ast.walk(node.test) if isinstance(name, ast.Name)}
        if isinstance(node, ast.If)
        else set()
    )
    return [] if asks & {"__name__", "TYPE_CHECKING"} else [""]


def _sets_all(node: ast.Assign) -> bool:
    """Return whether a statement lists the public names of a module."""
    return any(isinstance(target, ast.Name) and target.id == "__all__" for target in node.targets)


def _is_bare_text(node: ast.AST) -> bool:
    """Return whether a statement is a docstring."""
    return (
        isinstance(node, ast.Expr)
        and isinstance(node.value, ast.Constant)
        and isinstance(node.value.value, str)
    )


def _walked(node: ast.AST) -> Iterator[ast.AST]:
    """Yield a node and all below it, but of attributes of a name the last one alone."""
    left = [node]
    while left:
        node = left.pop()
        yield node
        if isinstance(node, ast.Attribute):
            while isinstance(node, ast.Attribute):
                node = node.value
            left += [] if isinstance(node, ast.Name) else [node]
        else:
            left += ast.iter_child_nodes(node)


def _chain(node: ast.expr) -> list[str]:
    """Return a name and the attributes asked of it; an empty name where they are asked of something else."""
    words: list[str] = []
    while isinstance(node, ast.Attribute):
        words.append(node.attr)
        node = node.value
    return [node.id if isinstance(node, ast.Name) else "", *reversed(words)]


def _last_name(node: ast.expr) -> str:
    """Return the last word of a base class or a decorator."""
    while isinstance(node, ast.Subscript | ast.Call):
        node = node.value if isinstance(node, ast.Subscript) else node.func
    return node.attr if isinstance(node, ast.Attribute) else node.id if isinstance(node, ast.Name) else ""


def _texts(value: object) -> Iterator[str]:
    """Yield a statement's nodes without docstrings and imports, and without what versions of Python write in different ways."""
    if isinstance(value, ast.AST):
        if not _is_bare_text(value) and not isinstance(value, ast.Import | ast.ImportFrom):
            yield f"({type(value).__name__}"
            for name, child in ast.iter_fields(value):
                if name not in ("ctx", "kind", "type_comment") and child not in (None, []):
                    yield f" {name}="
                    yield from _texts(child)
            yield ")"
    elif isinstance(value, list):
        for child in value:
            yield from _texts(child)
    else:
        yield repr(value)


def _commands(node: ast.List | ast.Tuple) -> Iterator[str]:
    """Yield the modules and commands that stand after ``-m``; the command line of firnline without a command is all of it."""
    words = [str(word.value) if isinstance(word, ast.Constant) else "" for word in node.elts]
    for k, word in enumerate(words[:-1]):
        if word == "-m":
            module, after = words[k + 1], words[k + 2] if k + 2 < len(words) else ""
            yield f"firnline.cli:{after}" if module in _COMMAND_LINES else f"{module}.__main__"


class Code:
    """The modules of a checkout, each parsed when it is reached.

    Parameters
    ----------
    files
        Paths of Python files and stubs from the root, each with a key of its content.
    read
        Parts of a file by that key, with the modules that its strings name or without.
    """

    def __init__(self, files: Mapping[str, str], read: Callable[[str, bool], ModuleParts]) -> None:
        self._read = read
        self._files: dict[str, list[tuple[str, str]]] = defaultdict(list)
        for path, key in files.items():
            self._files[path.rpartition(".")[0].replace("/", ".").removesuffix(".__init__")].append(
                (path, key)
            )
        self._modules: dict[str, ModuleParts] = {}

    @classmethod
    def of_checkout(cls, root: Path = ROOT) -> "Code":
        """Return the code that stands in a folder."""
        files = (file for package in PACKAGES for file in (root / package).rglob("*.py*"))
        paths = [file.relative_to(root).as_posix() for file in files if file.suffix in (".py", ".pyi")]

        def read(path: str, with_programs: bool) -> ModuleParts:
            return ModuleParts.parsed((root / path).read_text(encoding="utf-8"), with_programs=with_programs)

        return cls({path: path for path in paths}, read)

    def has(self, start: str) -> bool:
        """Return whether ``module:function`` is there."""
        module, _, name = start.partition(":")
        return module in self._files and name in self._module(module).parts

    def digest(self, start: str) -> str | None:
        """Return the digest of what ``module:function`` reaches, 16 hexadecimal digits; none where the code does not have it."""
        found = self.definitions(start)
        texts = sorted(text for each in found.values() for text in each)
        return hashlib.sha256(b"".join(texts)).hexdigest()[:16] if found else None

    def definitions(self, start: str) -> dict[str, list[bytes]]:
        """Return what ``module:function`` reaches: texts that stand for each definition, by its name; nothing where it is not there."""
        found: dict[str, list[bytes]] = defaultdict(list)
        if self.has(start):
            module, _, name = start.partition(":")
            for place in sorted(self.reached((module, name))):
                found[place[1] or f"statements of {place[0]}"] += self._digested(*place)
        return found

    def _digested(self, module: str, name: str) -> Iterator[bytes]:
        """Yield the name of a part, what it holds, and what its names mean in other projects; not where it lies in this one."""
        found = self._module(module)
        part = found.parts[name]
        heads = {dotted.partition(".")[0] for dotted in part.names} & found.imports.keys()
        bound = sorted((head, place) for head in heads for place in found.imports[head])
        foreign = [f"{head}={place}" for head, place in bound if place[0].partition(".")[0] not in PACKAGES]
        yield " ".join([name, *foreign]).encode() + b"".join(part.digests)

    def reached(self, start: Place) -> set[Place]:
        """Return the definitions that one of them reaches, itself included."""
        seen: set[Place] = set()
        asked: set[str] = set()
        waiting: dict[str, list[Place]] = defaultdict(list)
        left = [start]
        while left:
            place = left.pop()
            if place in seen or place[0] in _STORING:
                continue
            seen.add(place)
            left += self._used_by(place)
            part = self._module(place[0]).parts.get(place[1], _Part())
            for method, is_always_used in part.methods.items():
                own = (place[0], f"{place[1]}.{method}")
                (left if is_always_used or method in asked else waiting[method]).append(own)
            for attribute in part.attributes - asked:
                left += waiting.pop(attribute, [])
            asked |= part.attributes
        return {(module, name) for module, name in seen if name in self._module(module).parts}

    def _module(self, name: str) -> ModuleParts:
        """Return a module with the imports of its stub."""
        if name not in self._modules:
            merged = ModuleParts()
            for path, key in self._files.get(name, ()):
                one = self._read(key, path.startswith(_WITH_PROGRAMS))
                for bound, places in one.imports.items():
                    merged.imports[bound] |= places
                if path.endswith(".py"):
                    merged.parts = one.parts
            self._modules[name] = merged
        return self._modules[name]

    def _used_by(self, place: Place) -> Iterator[Place]:
        """Yield what a part names; with the statements of its module go those of the packages around it and of its imports."""
        module, own = place
        found = self._module(module)
        yield module, ""
        if own == "*":
            yield from ((module, name) for name in found.parts)
        elif not own:
            words = module.split(".")
            yield from ((".".join(words[:n]), "") for n in range(1, len(words)))
            bound = (each for places in found.imports.values() for each in places)
            yield from ((self._longest([*used.split("."), name])[0], "") for used, name in bound)
        part = found.parts.get(own, _Part())
        for dotted in part.names:
            yield from self._resolved(module, dotted.split("."))
        for dotted in part.modules:
            used, _, function = dotted.partition(":")
            if used == "firnline.cli":
                yield from self._command(function)
            else:
                yield from self._path([*used.split("."), *([function] if function else [])])

    def _command(self, word: str) -> list[Place]:
        """Return the function of a command, or all of the command line where the command is not known."""
        modules = [name for name in self._files if name.startswith("firnline.cli.")]
        found = [(name, word) for name in modules if word and word in self._module(name).parts]
        return found or [("firnline.cli.main", "*")]

    def _resolved(self, module: str, words: list[str]) -> Iterator[Place]:
        """Yield the definitions that a name with attributes stands for in a module."""
        found = self._module(module)
        if words[0] in found.parts:
            yield module, words[0]
        for used, name in found.imports.get(words[0], ()):
            yield from self._path([*used.split("."), *([name] if name else []), *words[1:]])

    def _path(self, words: list[str]) -> Iterator[Place]:
        """Yield the definition at the end of a path of packages, modules and names; all of a module alone."""
        module, n = self._longest(words)
        if n:
            yield from self._resolved(module, words[n:]) if n < len(words) else [(module, "*")]

    def _longest(self, words: list[str]) -> tuple[str, int]:
        """Return the module that the first words name, and how many they are; none of another project."""
        n = max((n for n in range(1, len(words) + 1) if ".".join(words[:n]) in self._files), default=0)
        return ".".join(words[:n]), n


@cache
def code_of_today() -> Code:
    """Return the code of this checkout, as it is when this process first asks."""
    return Code.of_checkout()
