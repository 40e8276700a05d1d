"""Sample site of the desk: real elevations, with an area on a flank."""

from pathlib import Path

from desk.plan.document import PlanDocument
from desk.plan.history import SUFFIX, StoredHistory
from survey.data.area import SurveyArea

_NAME = "srtm_sample"


def write_demo(folder: Path) -> Path:
    """Write the sample terrain and a plan to begin with; what is there already stays."""
    from survey.terrain.real import real_sample, sample_site

    folder.mkdir(parents=True, exist_ok=True)
    terrain, plan_file = folder / f"{_NAME}.tif", folder / f"{_NAME}{SUFFIX}"
    if not terrain.exists():
        real_sample().write(terrain)
    if not plan_file.exists():
        site = sample_site()
        west, south, east, north = (round(limit, -1) for limit in site.bounds)
        bounds = (west - 200.0, south - 200.0, east + 200.0, north + 200.0)
        area = SurveyArea.rectangle(bounds, site.prior.crs)
        document = PlanDocument.of_area(area).model_copy(update={"starts": ((west - 150.0, south - 150.0),)})
        StoredHistory(plan_file, terrain.name, document).write()
    return plan_file
