"""List which stored tables and figures are of today's code, and find the code of earlier runs in the history.

``python -m benchmarks.stored check`` lists what is stale (``make results-check``); ``history`` gives tables that were stored without a
provenance the commit that stored them and the digest of the code of that commit, and computes digests of runs of committed
code again; ``why NAME`` names the definitions that have changed since; ``remark NAME TEXT ...`` stores a remark on a
table or a figure, each text a sentence or two.
"""

import json
import re
import subprocess
import sys
import tomllib
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

from benchmarks.writer import CONTENTS, TABLES, read_table
from papers.code_closure import PACKAGES, ROOT, Code, ModuleParts, code_of_today
from papers.provenance import KEY, git
from papers.studies import ABOUT, STUDIES
from survey.core import InputError
from survey.core.documents import RECORD, read_record, write_record

RESULTS = TABLES.parent
CHECKED = RESULTS / "checked.json"
FRESH, CHANGED, IN_PARTS, UNKNOWN = (
    "today's code",
    "code changed since",
    "parts of other code",
    "code unknown",
)
FROM_HISTORY = "from history"
_ABOUT_THE_RUN = (KEY, "remark", "remark_of")


@dataclass(frozen=True)
class Stored:
    """A stored table, or the figures and tables of a study."""

    name: str
    file: Path
    """The table, or the record of the study."""
    of: str
    what: str
    command: str
    note: str = ""

    @property
    def is_study(self) -> bool:
        """Whether it is a figure or a table of the papers."""
        return self.file.name == RECORD

    @property
    def content(self) -> dict[str, Any]:
        """The table or the record; an empty one where there is none."""
        return read_table(self.file)

    @property
    def outcome(self) -> dict[str, Any]:
        """The content without what is said about its run."""
        return {key: value for key, value in self.content.items() if key not in _ABOUT_THE_RUN}

    @property
    def provenance(self) -> dict[str, Any]:
        """Commit, code, machine, CPU time and date of the run; nothing where it was stored without them."""
        facts: dict[str, Any] = self.content.get(KEY, {})
        return facts

    @property
    def state(self) -> str:
        """Whether it is of today's code."""
        facts = self.provenance
        today, parts = code_of_today().digest(self.of), set(facts.get("parts", {}))
        if not facts.get("code"):
            return UNKNOWN
        if facts["code"] != today:
            return CHANGED
        return IN_PARTS if parts - {today} else FRESH

    def restored(self, facts: Mapping[str, Any]) -> None:
        """Put facts about the run into the file."""
        content = {key: value for key, value in {**self.content, **facts}.items() if value is not None}
        if self.is_study:
            if self.file.exists():
                read_record(self.file.parent)  # which refuses changed files: their checksums would be lost
            files = [path for path in self.file.parent.iterdir() if path.is_file() and path != self.file]
            own = {k: v for k, v in content.items() if k not in ("files_sha256", "record_sha256")}
            write_record(self.file.parent, files, own)
        else:
            self.file.write_text(json.dumps(content, indent=2, ensure_ascii=False) + "\n", encoding="utf-8")


def every_stored() -> list[Stored]:
    """Return the tables of the benchmarks, then the studies of the papers."""
    listed = tomllib.loads(CONTENTS.read_text(encoding="utf-8"))["table"]
    tables = [
        Stored(
            one["file"].removesuffix(".json"),
            TABLES / one["file"],
            one["of"],
            one["what"],
            one["command"],
            one.get("note", ""),
        )
        for one in listed
    ]
    studies = [
        Stored(name, RESULTS / name / RECORD, of, ABOUT[name].title, f"`firnline reproduce {name}`")
        for name, of in STUDIES.items()
    ]
    return [one for one in tables if one.file.exists()] + [one for one in studies if one.file.parent.exists()]


def check() -> dict[str, str]:
    """Return the state of everything that is stored, by its name, and print what is stale."""
    states = {one.name: one.state for one in every_stored()}
    for name, state in states.items():
        if state != FRESH:
            print(f"{name}: {state}")
    print(f"{sum(state == FRESH for state in states.values())} of {len(states)} are of today's code")
    return states


class _Blobs:
    """Files of commits, read from the history and parsed once."""

    def __init__(self) -> None:
        self._process = subprocess.Popen(
            ["git", "cat-file", "--batch"], cwd=ROOT, stdin=subprocess.PIPE, stdout=subprocess.PIPE
        )
        self._parsed: dict[tuple[str, bool], ModuleParts] = {}
        self._codes: dict[str, Code] = {}

    def code(self, commit: str) -> Code:
        """Return the code of a commit."""
        if commit not in self._codes:
            listed = (git("ls-tree", "-r", commit, "--", *PACKAGES) or "").splitlines()
            files = {
                line.split("\t")[1]: line.split()[2] for line in listed if line.endswith((".py", ".pyi"))
            }
            self._codes[commit] = Code(files, self._parts)
        return self._codes[commit]

    def function_of(self, one: Stored, commit: str) -> str:
        """Return ``module:function`` of a table or a study at a commit; studies had other modules."""
        paths = (git("ls-tree", "-r", "--name-only", commit, "--", "papers", "sim") or "").splitlines()
        for path in paths if one.is_study else ():
            if re.search(r"studies(/__init__)?\.py$", path):
                found = re.search(rf'"{one.name}": "([\w.]+:\w+)"', self.text(f"{commit}:{path}"))
                if found:
                    return found[1]
        return one.of

    def _parts(self, blob: str, with_programs: bool) -> ModuleParts:
        key = (blob, with_programs)
        if key not in self._parsed:
            self._parsed[key] = ModuleParts.parsed(self.text(blob), with_programs=with_programs)
        return self._parsed[key]

    def text(self, name: str) -> str:
        """Return the text of an object, an empty one where there is none."""
        assert self._process.stdin is not None
        assert self._process.stdout is not None
        self._process.stdin.write(f"{name}\n".encode())
        self._process.stdin.flush()
        head = self._process.stdout.readline().split()
        if head[-1] == b"missing":
            return ""
        content = self._process.stdout.read(int(head[2]))
        self._process.stdout.read(1)
        return content.decode()


class _Stored(NamedTuple):
    """A commit that stored an outcome, and its date."""

    commit: str
    date: str


def _first_with_outcome(one: Stored, blobs: _Blobs) -> _Stored | None:
    """Return the commit that stored the outcome that stands there; none where it has not been committed."""
    place = str(one.file.relative_to(ROOT))
    where = [str(one.file.parent.relative_to(ROOT)), f":!{place}"] if one.is_study else [place]
    if one.is_study and git("status", "--porcelain", "--", *where):
        return None
    found = None
    for line in (git("log", "--format=%H %cs", "--", *where) or "").splitlines():
        commit, date = line.split()
        if one.is_study:
            return _Stored(commit, date)
        text = blobs.text(f"{commit}:{place}")
        then = json.loads(text) if text else None
        if (
            not isinstance(then, dict)
            or {k: v for k, v in then.items() if k not in _ABOUT_THE_RUN} != one.outcome
        ):
            break
        found = _Stored(commit, date)
    return found


def fill_from_history() -> Iterator[str]:
    """Give what was stored without provenance its commit and the digest of the code of that commit; yield what was found."""
    blobs = _Blobs()
    for one in every_stored():
        old = one.provenance
        if old:
            code = old["code"] if old["has_changes"] else blobs.code(str(old["commit"])).digest(old["of"])
            if code != old["code"]:
                yield _recomputed(one, code)
            continue
        stored = _first_with_outcome(one, blobs)
        if stored is None:
            yield f"{one.name}: is not committed as it stands; commit it first"
            continue
        function = blobs.function_of(one, stored.commit)
        code = blobs.code(stored.commit).digest(function)
        facts = {
            "source": FROM_HISTORY,
            "of": function,
            "commit": stored.commit[:12],
            "has_changes": None,
            "code": code,
        }
        facts |= {
            "machine": one.content.get("machine", {}).get("cpu"),
            "cpu_s": None,
            "date": stored.date,
            "quick": None,
        }
        one.restored({KEY: facts})
        yield f"{one.name}: {stored.commit[:12]} of {stored.date}, code {code or 'unknown'}"


def changes(one: Stored) -> Iterator[str]:
    """Yield the definitions that a stored run depends on and that have changed since its commit."""
    facts = one.provenance
    if not facts.get("commit") or facts["has_changes"]:
        raise SystemExit(f"{one.name} is not of committed code, so that nothing can be compared.")
    old, new = (
        _Blobs().code(str(facts["commit"])).definitions(facts["of"]),
        code_of_today().definitions(one.of),
    )
    for name in sorted(old.keys() | new.keys()):
        if old.get(name) != new.get(name):
            yield f"{name}: {'changed' if name in old and name in new else 'new' if name in new else 'gone'}"


def _recomputed(one: Stored, code: str | None) -> str:
    """Store another digest; one of a folder with files that are not kept stays as it is."""
    try:
        one.restored({KEY: {**one.provenance, "code": code}})
    except InputError as error:
        return f"{one.name}: {error}"
    return f"{one.name}: {one.provenance['commit']}, code {code}, as digests are computed now"


def set_remark(name: str, texts: Sequence[str]) -> None:
    """Put a remark on what is stored under a name."""
    find(name).restored({"remark": list(texts), "remark_of": None})


def find(name: str) -> Stored:
    """Return what is stored under a name."""
    one = next((one for one in every_stored() if one.name == name), None)
    if one is None:
        raise SystemExit(f"nothing is stored under the name {name!r}; `results/README.md` lists all names.")
    return one


def main(words: Sequence[str]) -> None:
    """Do what the command line asks for."""
    if words[:1] == ["history"]:
        for line in fill_from_history():
            print(line, flush=True)
    elif words[:1] == ["remark"] and len(words) > 2:
        set_remark(words[1], words[2:])
    elif words[:1] == ["why"] and len(words) == 2:
        print("\n".join(changes(find(words[1]))))
    elif list(words) == ["check"]:
        check()
    else:
        raise SystemExit(__doc__)


if __name__ == "__main__":
    main(sys.argv[1:])
