"""File of a history: one JSON object a line, to which edits are appended."""

import fcntl
import json
import os
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from threading import Lock
from typing import Any, Self

from pydantic import Field, NonNegativeInt

from desk.plan.document import Place, PlanDocument, Record, Ring, Rings
from desk.plan.history import MOST_STEPS, SCHEMA_VERSION, EditStep, History, OutdatedError, Variant, Variants
from survey.core import (
    ConfigError,
    InputError,
    Section,
    parse_json,
    refusing_damage,
    validated,
    write_bytes,
)  # fmt: skip
from survey.core.config import refuse_newer_schema
from survey.core.documents import LARGEST_BYTES
from survey.core.files import existing_file, read_bytes, write_refusal

SUFFIX = ".desk.json"


class RingChange(Record):
    """Ring by what differs from the ring at its place before: an edit moves few corners of many."""

    keep: tuple[NonNegativeInt, NonNegativeInt] = (0, 0)
    """Number of corners that stay at the beginning and at the end."""
    places: tuple[Place, ...] = ()
    """Corners between them."""

    @classmethod
    def of(cls, ring: Ring, before: Ring) -> Self:
        """Return the change from one ring to another."""
        most = min(len(ring), len(before))
        first = next((k for k in range(most) if ring[k] != before[k]), most)
        last = next((k for k in range(most - first) if ring[-1 - k] != before[-1 - k]), most - first)
        return cls(keep=(first, last), places=ring[first : len(ring) - last])

    def applied(self, before: Ring) -> Ring:
        """Return the ring after the change; corners that stay are shared."""
        first, last = self.keep
        ring = before[:first] + self.places + (before[-last:] if last else ())
        if first + last > len(before) or len(ring) < 3:
            raise ValueError(f"a ring keeps {first} and {last} of {len(before)} corners")
        return before if not self.places and len(ring) == len(before) else ring


RingChanges = tuple[tuple[RingChange, ...], ...]


class DocumentChange(Record):
    """What differs between two documents."""

    stated: PlanDocument = Field(default_factory=PlanDocument)
    """The parts other than polygons that differ."""
    areas: RingChanges | None = None
    """Polygons to survey; None where they stay."""
    no_go: RingChanges | None = None
    """No-go zones; None where they stay."""

    @classmethod
    def of(cls, document: PlanDocument, before: PlanDocument) -> "DocumentChange":
        """Return the change from one document to another."""
        names = {
            name for name in PlanDocument.model_fields if getattr(document, name) != getattr(before, name)
        }
        stated = document.model_copy()
        stated.model_fields_set.clear()
        stated.model_fields_set.update(names - set(_POLYGONS))
        rings = [
            _ring_changes(getattr(document, name), getattr(before, name)) if name in names else None
            for name in _POLYGONS
        ]
        given = (names & set(_POLYGONS)) | {"stated"}
        return cls.model_construct(given, stated=stated, areas=rings[0], no_go=rings[1])

    def applied(self, before: PlanDocument) -> PlanDocument:
        """Return the document after the change."""
        update: dict[str, Any] = {name: getattr(self.stated, name) for name in self.stated.model_fields_set}
        for name in _POLYGONS:
            changes = getattr(self, name)
            if changes is not None:
                update[name] = _applied(changes, getattr(before, name))
        return before.model_copy(update=update) if update else before


_POLYGONS = ("areas", "no_go")


def _ring_changes(polygons: tuple[Rings, ...], before: tuple[Rings, ...]) -> RingChanges:
    return tuple(
        tuple(RingChange.of(ring, _ring_at(before, k, n)) for n, ring in enumerate(rings))
        for k, rings in enumerate(polygons)
    )


def _applied(changes: RingChanges, before: tuple[Rings, ...]) -> tuple[Rings, ...]:
    return tuple(
        tuple(change.applied(_ring_at(before, k, n)) for n, change in enumerate(rings))
        for k, rings in enumerate(changes)
    )


def _ring_at(polygons: tuple[Rings, ...], polygon: int, ring: int) -> Ring:
    rings = polygons[polygon] if polygon < len(polygons) else ()
    return rings[ring] if ring < len(rings) else ()


VariantChanges = tuple[tuple[str, DocumentChange], ...]
"""Names of variants, and what differs in each from the document of its step."""


def _changed_variants(variants: Variants, document: PlanDocument) -> VariantChanges:
    return tuple((one.name, DocumentChange.of(one.document, document)) for one in variants)


def _variants(changes: VariantChanges, document: PlanDocument) -> Variants:
    return tuple(Variant(name=name, document=change.applied(document)) for name, change in changes)


class StepChange(Record):
    """Line of the file: an edit, by what differs from the document before."""

    title: str
    """What was done."""
    document: DocumentChange
    """Result of the edit."""
    variants: VariantChanges | None = None
    """Plans that are set aside from this step on."""

    @classmethod
    def of(cls, step: EditStep, before: PlanDocument) -> "StepChange":
        """Return the change that a step is."""
        variants = None if step.variants is None else _changed_variants(step.variants, step.document)
        change = DocumentChange.of(step.document, before)
        return cls.model_construct(title=step.title, document=change, variants=variants)

    def step(self, before: PlanDocument) -> EditStep:
        """Return the step."""
        document = self.document.applied(before)
        variants = None if self.variants is None else _variants(self.variants, document)
        return EditStep(title=self.title, document=document, variants=variants)


class MoveChange(Record):
    """Line of the file: steps that were undone (negative) or done again."""

    by: int
    """Number of steps."""


class Beginning(Record):
    """First line of the file: the history as it stood when the whole file was written."""

    schema_version: int = SCHEMA_VERSION
    """Version of the format."""
    terrain: str = ""
    """As in `History`, like the other fields."""
    source: str = ""
    source_sha256: str = ""
    at: int = Field(default=0, ge=0)
    steps: tuple[StepChange, ...] = Field(min_length=1)
    variants: VariantChanges = ()

    @classmethod
    def of(cls, history: History) -> "Beginning":
        """Return the beginning that a history is."""
        empty = PlanDocument()
        documents = (empty, *(step.document for step in history.steps))
        steps = tuple(
            StepChange.of(step, before) for step, before in zip(history.steps, documents, strict=False)
        )
        return cls.model_construct(
            set(cls.model_fields),
            schema_version=SCHEMA_VERSION,
            terrain=history.terrain,
            source=history.source,
            source_sha256=history.source_sha256,
            at=history.at,
            steps=steps,
            variants=_changed_variants(history.variants, empty),
        )

    def history(self) -> History:
        """Return the history."""
        before, steps = PlanDocument(), []
        for change in self.steps:
            steps.append(change.step(before))
            before = steps[-1].document
        return History(
            terrain=self.terrain,
            source=self.source,
            source_sha256=self.source_sha256,
            at=self.at,
            steps=tuple(steps),
            variants=_variants(self.variants, PlanDocument()),
        )


def _line(section: Section) -> bytes:
    content = section.model_dump(mode="json", exclude_unset=True)
    return (json.dumps(content, ensure_ascii=False, allow_nan=False) + "\n").encode()


_MOST_LINES = 4 * MOST_STEPS
"""Lines after which the whole file is written again, without what was dropped."""
Stamp = tuple[int, int, int]


class StoredHistory:
    """History that is appended to its file at each change.

    `path`: the file, ``.desk.json``, of one JSON object a line. It is written with the first edit. `first`: document
    to begin with where there is no file, with the terrain and source of `History`. A file that another program changed is read again, and the edit refused.
    """

    def __init__(
        self, path: Path, first: PlanDocument, terrain: str = "", source: str = "", source_sha256: str = ""
    ) -> None:
        self.path = path
        self.revision = 0
        self._lock = Lock()
        self._n_lines = self._n_bytes = 0
        self._stamp: Stamp | None = None
        self._first = self._history = History.of(first, terrain, source, source_sha256)
        if path.exists():
            self._read()

    @property
    def history(self) -> History:
        """The history as it stands."""
        return self._history

    @property
    def document(self) -> PlanDocument:
        """The document that is shown."""
        return self._history.document

    def renew(self) -> bool:
        """Take up a source that has changed as a further step; return whether it has.

        The step is written with the first edit.
        """
        is_known = self._first.source_sha256 in ("", self._history.source_sha256)
        if is_known or not self.path.exists():
            return False
        about = {name: getattr(self._first, name) for name in ("terrain", "source", "source_sha256")}
        renewed = self._history.edited(
            f"Open {Path(self._first.source).name} as it is now", self._first.document
        )
        self._history = renewed.model_copy(update=about)
        self._n_lines = _MOST_LINES
        return True

    def edit(self, revision: int, title: str, document: PlanDocument) -> None:
        """Add a step and write the file."""
        with self._lock:
            self._require(revision)
            self._add(EditStep(title=title[:200], document=document))

    def move(self, revision: int, by: int) -> None:
        """Undo (negative) or redo steps and write the file; the errors are those of `edit`."""
        with self._lock:
            self._require(revision)
            self._store(self._history.moved(by), MoveChange(by=by))

    def set_aside(self, name: str) -> None:
        """Set the document aside as a variant, which can be undone; one of the same name is replaced."""
        with self._lock:
            others = tuple(variant for variant in self._history.set_aside if variant.name != name)
            variants = (*others, Variant(name=name, document=self.document))
            self._add(EditStep(title=f"Set aside {name}", document=self.document, variants=variants))

    def drop_variant(self, index: int) -> None:
        """Remove a variant by its index, which can be undone; one that does not exist is left alone."""
        with self._lock:
            variants = self._history.set_aside
            if index < len(variants):
                others = (*variants[:index], *variants[index + 1 :])
                title = f"Remove {variants[index].name}"
                self._add(EditStep(title=title, document=self.document, variants=others))

    def write(self) -> None:
        """Write the whole file as it stands."""
        with self._lock:
            self._n_lines = _MOST_LINES
            self._store(self._history, MoveChange(by=0))

    def _require(self, revision: int) -> None:
        if revision != self.revision:
            raise OutdatedError("the plan was changed in another window; it is shown as it is now.")

    def _add(self, step: EditStep) -> None:
        change = StepChange.of(step, self.document)
        shared = change.step(self.document)
        self._store(self._history.edited(shared.title, shared.document, shared.variants), change)

    def _store(self, history: History, change: Section) -> None:
        """Write a change where the file stands as it was left; otherwise read the file and refuse the change."""
        with _folder_locked(self.path.resolve().parent):
            if self._found_stamp() not in (self._stamp, None):
                self._read()
                self.revision += 1
                raise OutdatedError(
                    f"{self.path.name} was changed by another program; it is shown as it is now, without your last edit."
                )
            if self._found_stamp() is None or self._n_lines >= _MOST_LINES:
                content = _line(Beginning.of(history))
                write_bytes(self.path, content)
                self._n_bytes, self._n_lines = len(content), 1
            else:
                self._append(_line(change))
            self._stamp = self._found_stamp()
        if (history.at, history.steps) != (self._history.at, self._history.steps):
            self.revision += 1
        self._history = history

    def _append(self, line: bytes) -> None:
        """Append a line in place of one that was not written to its end."""
        try:
            with self.path.open("r+b") as file:
                file.truncate(self._n_bytes)
                file.seek(self._n_bytes)
                file.write(line)
                file.flush()
                os.fsync(file.fileno())
        except OSError as error:
            raise write_refusal(self.path, error) from error
        self._n_bytes += len(line)
        self._n_lines += 1

    def _found_stamp(self) -> Stamp | None:
        try:
            found = self.path.stat()
        except FileNotFoundError:
            return None
        return found.st_ino, found.st_size, found.st_mtime_ns

    def _read(self) -> None:
        self._stamp = self._found_stamp()
        content = read_bytes(existing_file(self.path, _WHAT), _WHAT, LARGEST_BYTES)
        self._history, self._n_lines = _parsed(content, self.path)
        self._n_bytes = content.rfind(b"\n") + 1


_WHAT = "the plan of the desk"


@contextmanager
def _folder_locked(folder: Path) -> Iterator[None]:
    """Keep other desks from writing into a folder for a moment; where it cannot be locked, from nothing."""
    descriptor = os.open(folder, os.O_RDONLY)
    try:
        with suppress(OSError):
            fcntl.flock(descriptor, fcntl.LOCK_EX)
        yield
    finally:
        os.close(descriptor)


def read_history(path: Path) -> History:
    """Read a history."""
    return _parsed(read_bytes(existing_file(path, _WHAT), _WHAT, LARGEST_BYTES), path)[0]


def _parsed(content: bytes, path: Path) -> tuple[History, int]:
    """Return the history of a file and its number of lines; a last line without an end was no complete edit."""
    where = f"{_WHAT} {path}"
    first, *others = content.split(b"\n")[:-1] or [content]
    is_old = first.strip() == b"{"  # version 1 is one document over many lines
    values = _object(content if is_old else first, where)
    refuse_newer_schema(values, SCHEMA_VERSION, str(path))
    if values.get("schema_version", 1) == 1:
        history, others = validated(History, values, str(path)), [b""] * _MOST_LINES
    else:
        with refusing_damage(where, "plan", _REMEDY):
            history = validated(Beginning, values, str(path)).history()
        for number, line in enumerate(others, start=2):
            history = _replayed(history, line, f"line {number} of {where}")
    if history.at >= len(history.steps):
        raise ConfigError(
            f"{path} shows step {history.at} of {len(history.steps)}; it was changed by hand, correct 'at'."
        )
    return history, 1 + len(others)


_REMEDY = "put a copy in its place, or remove it to begin a new plan"


def _object(content: bytes, where: str) -> dict[str, Any]:
    values = parse_json(content, where, _REMEDY)
    if not isinstance(values, dict):
        raise InputError(f"{where} holds no object; {_REMEDY}.")
    return values


def _replayed(history: History, line: bytes, where: str) -> History:
    values = _object(line, where)
    if "by" in values:
        return history.moved(validated(MoveChange, values, where).by)
    with refusing_damage(where, "edit", _REMEDY):
        step = validated(StepChange, values, where).step(history.document)
        return history.edited(step.title, step.document, step.variants)
