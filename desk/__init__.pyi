"""Public names and the modules that define them."""

from desk.plan.document import PlanDocument as PlanDocument
from desk.server.app import desk_app as desk_app
