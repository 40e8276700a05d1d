"""Public names and the modules that define them."""

from desk.plan.document import PlanDocument as PlanDocument
