"""History of a plan document: edits with undo and redo."""

from typing import Annotated, Self

from pydantic import Field

from desk.plan.document import PlanDocument, Record
from survey.core import FirnlineError

SCHEMA_VERSION = 2
MOST_STEPS = 200


class OutdatedError(FirnlineError):
    """An edit of a document that has changed meanwhile, for example in another tab."""


class Variant(Record):
    """Document that was set aside under a name, to be compared."""

    name: str = Field(min_length=1, max_length=80)
    """Its name."""
    document: PlanDocument
    """The plan."""


Variants = Annotated[tuple[Variant, ...], Field(max_length=30)]


class EditStep(Record):
    """Document after an edit, and what the edit did."""

    title: str = Field(max_length=200)
    """What was done, such as ``Move a corner``."""
    document: PlanDocument
    """Result of the edit."""
    variants: Variants | None = None
    """Plans that are set aside from this step on; None where the edit left them as they were."""


class History(Record):
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
    source: str = ""
    """Mission or run that the plan was begun from, as seen from its folder; empty for a raster."""
    source_sha256: str = ""
    """Checksum of the settings, area and prior of that source."""
    at: int = Field(default=0, ge=0)
    """Index of the step that is shown."""
    steps: tuple[EditStep, ...] = Field(min_length=1)
    """Edits in their order."""
    variants: Variants = ()
    """Plans that were set aside before the first step."""

    @classmethod
    def of(cls, document: PlanDocument, terrain: str = "", source: str = "", source_sha256: str = "") -> Self:
        """Return a history that begins with a document."""
        first = EditStep(title="Open", document=document)
        return cls(terrain=terrain, source=source, source_sha256=source_sha256, steps=(first,))

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
