"""History of a plan document: edits with undo and redo, stored in one file."""

from pathlib import Path
from threading import Lock
from typing import Annotated, Any, Self

from pydantic import Field

from desk.plan.document import PlanDocument
from survey.core import ConfigError, FirnlineError, Section, read_json, validated, write_json
from survey.core.config import refuse_newer_schema

SCHEMA_VERSION = 1
MOST_STEPS = 200
SUFFIX = ".desk.json"


class OutdatedError(FirnlineError):
    """An edit of a document that has changed meanwhile, for example in another tab."""


class Variant(Section):
    """Document that was set aside under a name, to be compared."""

    name: str = Field(min_length=1, max_length=80)
    """Its name."""
    document: PlanDocument
    """The plan."""


Variants = Annotated[tuple[Variant, ...], Field(max_length=30)]


class EditStep(Section):
    """Document after an edit, and what the edit did."""

    title: str = Field(max_length=200)
    """What was done, such as ``Move a corner``."""
    document: PlanDocument
    """Result of the edit."""
    variants: Variants | None = None
    """Plans that are set aside from this step on; None where the edit left them as they were."""


class History(Section):
    """Steps of a document; those after `at` were undone and can be done again.

    >>> begun = History.of(PlanDocument())
    >>> edited = begun.edited("Mark a start", PlanDocument(starts=((3.0, 4.0),)))
    >>> edited.moved(-1).document == PlanDocument(), edited.moved(-1).moved(1) == edited
    (True, True)
    """

    schema_version: int = SCHEMA_VERSION
    """Version of the format."""
    terrain: str = ""
    """Name of the raster of elevations, beside the file."""
    at: int = Field(default=0, ge=0)
    """Index of the step that is shown."""
    steps: tuple[EditStep, ...] = Field(min_length=1)
    """Edits in their order."""
    variants: Variants = ()
    """Plans that were set aside before the first step."""

    @classmethod
    def of(cls, document: PlanDocument, terrain: str = "") -> Self:
        """Return a history that begins with a document."""
        return cls(terrain=terrain, steps=(EditStep(title="Open", document=document),))

    @property
    def document(self) -> PlanDocument:
        """The document that is shown."""
        return self.steps[min(self.at, len(self.steps) - 1)].document

    @property
    def undo_title(self) -> str | None:
        """What the last step did; None at the first one."""
        return self.steps[self.at].title if self.at > 0 else None

    @property
    def redo_title(self) -> str | None:
        """What the next step does; None at the last one."""
        return self.steps[self.at + 1].title if self.at + 1 < len(self.steps) else None

    @property
    def set_aside(self) -> tuple[Variant, ...]:
        """The plans that are set aside at the step that is shown."""
        return self._set_aside_at(self.at)

    def edited(self, title: str, document: PlanDocument, variants: Variants | None = None) -> Self:
        """Return the history with one more step; what was undone is dropped, and the oldest step beyond `MOST_STEPS`."""
        step = EditStep(title=title, document=document, variants=variants)
        steps = (*self.steps[: self.at + 1], step)
        n_dropped = max(0, len(steps) - MOST_STEPS)
        first = self._set_aside_at(n_dropped)
        return self.model_copy(
            update={"steps": steps[n_dropped:], "at": len(steps) - n_dropped - 1, "variants": first}
        )

    def _set_aside_at(self, at: int) -> tuple[Variant, ...]:
        stated = (step.variants for step in reversed(self.steps[: at + 1]) if step.variants is not None)
        return next(stated, self.variants)

    def moved(self, by: int) -> Self:
        """Return the history some steps back (negative) or forth; it stays where there are none."""
        at = min(max(self.at + by, 0), len(self.steps) - 1)
        return self.model_copy(update={"at": at})


class StoredHistory:
    """History that is written to its file at each change.

    `path`: the file, ``.desk.json``. It is written with the first edit. `terrain`: name of the raster of
    elevations. `first`: document to begin with where there is no file.
    """

    def __init__(self, path: Path, terrain: str, first: PlanDocument) -> None:
        self.path = path
        self.revision = 0
        self._lock = Lock()
        self._history = read_history(path) if path.exists() else History.of(first, terrain)

    @property
    def history(self) -> History:
        """The history as it stands."""
        return self._history

    @property
    def document(self) -> PlanDocument:
        """The document that is shown."""
        return self._history.document

    def edit(self, revision: int, title: str, document: PlanDocument) -> None:
        """Add a step and write the file."""
        with self._lock:
            self._require(revision)
            self._store(self._history.edited(title, document))

    def move(self, revision: int, by: int) -> None:
        """Undo (negative) or redo steps and write the file; the errors are those of `edit`."""
        with self._lock:
            self._require(revision)
            self._store(self._history.moved(by))

    def set_aside(self, name: str) -> None:
        """Set the document aside as a variant, which can be undone; one of the same name is replaced."""
        with self._lock:
            others = [_plain(variant) for variant in self._history.set_aside if variant.name != name]
            values = {"title": f"Set aside {name}"[:200], "document": _plain(self.document)}
            variants = [*others, {"name": name, "document": values["document"]}]
            step = validated(EditStep, {**values, "variants": variants}, "the variant")
            self._store(self._history.edited(step.title, step.document, step.variants))

    def drop_variant(self, index: int) -> None:
        """Remove a variant by its index, which can be undone; one that does not exist is left alone."""
        with self._lock:
            variants = self._history.set_aside
            if index < len(variants):
                others = (*variants[:index], *variants[index + 1 :])
                title = f"Remove {variants[index].name}"
                self._store(self._history.edited(title, self.document, others))

    def write(self) -> None:
        """Write the file as it stands."""
        with self._lock:
            self._store(self._history)

    def _require(self, revision: int) -> None:
        if revision != self.revision:
            raise OutdatedError("the plan was changed in another window; it is shown as it is now.")

    def _store(self, history: History) -> None:
        write_json(self.path, _plain(history))
        if (history.at, history.steps) != (self._history.at, self._history.steps):
            self.revision += 1
        self._history = history


def read_history(path: Path) -> History:
    """Read a history."""
    values = read_json(path, "the plan of the desk")
    refuse_newer_schema(values, SCHEMA_VERSION, str(path))
    history = validated(History, values, str(path))
    if history.at >= len(history.steps):
        raise ConfigError(
            f"{path} shows step {history.at} of {len(history.steps)}; it was changed by hand, correct 'at'."
        )
    return history


def _plain(section: Section) -> dict[str, Any]:
    return section.model_dump(mode="json")
